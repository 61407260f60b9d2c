"""The helper that ends the nodes of a test."""

import pytest

pytest.importorskip('rclpy')

from node_process import end_all, Process, wait_until  # noqa: E402, I100

# SIGINT ends it, as it ends a node, also where the tests run in the background of a
# shell.
SLEEP = """
import signal, time
signal.signal(signal.SIGINT, signal.default_int_handler)
print('ready', flush=True)
time.sleep(60.0)
"""


def test_a_node_that_ended_by_a_segmentation_fault_fails_its_test_after_all_have_ended():
    crashed = Process(
        program=['-c', 'import os, signal; os.kill(os.getpid(), signal.SIGSEGV)'])
    waiting = Process(program=['-c', SLEEP])
    waiting.wait_for('ready')
    assert wait_until(lambda: not crashed.alive(), 30.0)
    with pytest.raises(AssertionError, match='-11'):
        end_all([crashed, waiting])
    assert not waiting.alive()
    end_all([waiting])
