"""The torque path in steady state, as in its benchmark: no cycle leaves memory."""

from benchmarks import torque_path
import numpy as np


def test_cycles_are_timed_and_hold_no_memory():
    rig = torque_path.Rig(torque_path.OFF, 300)
    rig.run(300)
    assert rig.done == 300
    assert np.array(rig.took).min() > 1000  # ns
    assert not np.array_equal(np.frombuffer(rig.commands.data[-8:]), [0.0])
    # Another thread of the test runner may allocate in one of the windows, but not in
    # all.
    windows = [torque_path.steady_memory(rig, 500) for _ in range(5)]
    assert min(window[torque_path.BYTES] for window in windows) <= 0
    assert min(window[torque_path.BLOCKS] for window in windows) <= 0
    leak = []
    observed = rig.path.on_state

    def leaking(data):
        leak.append(bytearray(100))
        observed(data)
    rig.path.on_state = leaking
    windows = [torque_path.steady_memory(rig, 500) for _ in range(3)]
    assert min(window[torque_path.BLOCKS] for window in windows) >= 500
