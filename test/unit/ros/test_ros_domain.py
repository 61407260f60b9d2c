"""Runs of the tests of the node have ROS domains of their own."""

import os
from pathlib import Path
import subprocess
import sys
import tempfile

import pytest
import ros_domain

ANOTHER_RUN = ('import ros_domain; ros_domain.DOMAINS = range(1, 4); '
               'print(ros_domain.own_domain())')


def test_a_domain_is_locked_until_its_process_ends(tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, 'tempdir', str(tmp_path))
    monkeypatch.setattr(ros_domain, 'DOMAINS', range(1, 4))
    taken = {ros_domain.own_domain(), ros_domain.own_domain()}
    assert len(taken) == 2
    environment = os.environ | {'TMPDIR': str(tmp_path),
                                'PYTHONPATH': str(Path(ros_domain.__file__).parent)}
    for _ in range(2):  # that of a run that has ended is free again
        run = subprocess.run([sys.executable, '-c', ANOTHER_RUN],
                             capture_output=True, text=True, env=environment, check=True)
        assert {run.stdout.strip()} == {'1', '2', '3'} - taken
    ros_domain.own_domain()
    with pytest.raises(RuntimeError, match='expected a free one'):
        ros_domain.own_domain()
