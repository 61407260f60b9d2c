"""Slow compiling is logged, and long programs compile quickly to the same function."""

import logging
import time
from types import SimpleNamespace

from kane_dynamics import Inertial, InputError, Robot
from kane_dynamics.native.machine_code import compiling
from kinds_of_mechanism import case
from mechanisms import wheel
import numpy as np
import pytest


def test_a_line_says_what_is_compiled_and_one_how_long_it_took(caplog, monkeypatch):
    monkeypatch.setattr(compiling, 'SLOW', 0.05)
    # Kernels of other tests belong to another series.
    monkeypatch.setattr(compiling, '_series', compiling.Series())
    with caplog.at_level(logging.INFO, logger=compiling.LOGGER):
        with compiling.logged('a quick one'):
            pass
        assert not caplog.messages
        with compiling.logged('inverse_dynamics'):
            # A busy machine runs the timer's thread late.
            deadline = time.monotonic() + 10.0
            while not caplog.messages and time.monotonic() < deadline:
                time.sleep(0.01)
            assert caplog.messages == [
                'compiling inverse_dynamics, more than 0.05 s so far']
    assert caplog.messages[1].startswith('compiled inverse_dynamics in ')


def test_short_kernels_of_a_long_series_are_reported_with_how_many_are_ready(
        monkeypatch):
    monkeypatch.setattr(compiling, 'SLOW', 2.0)
    clock = SimpleNamespace(now=0.0)
    monkeypatch.setattr(compiling, 'time', SimpleNamespace(monotonic=lambda: clock.now))
    series = compiling.Series()
    lines = []
    for k in range(6):  # 0.9 s each
        clock.now = 100.0 + k
        with series.counted(f'kernel{k}') as line:
            lines.append(line)
            clock.now = 100.9 + k
    assert lines == ['', '', '', 'compiling kernel3; kernels ready: 3, after 3 s', '',
                     '']
    clock.now = 106.0
    with series.counted('kernel6') as line:
        assert line == 'compiling kernel6; kernels ready: 6, after 6 s'
        # A kernel that another thread compiles meanwhile does not begin a series of its
        # own.
        clock.now = 110.0
        with series.counted('kernel7') as line:
            assert line == 'compiling kernel7; kernels ready: 6, after 10 s'
            clock.now = 111.0
        clock.now = 112.0
    clock.now = 115.0
    with series.counted('later') as line:
        assert line == ''
        assert series.ready == 0


def test_lines_go_where_a_program_asks_for_them(caplog, monkeypatch):
    monkeypatch.setattr(compiling, 'SLOW', 0.01)
    lines = []
    with caplog.at_level(logging.INFO, logger=compiling.LOGGER):
        with compiling.reported_to(lines.append), compiling.logged('one'):
            time.sleep(0.02)
        assert lines[-1].startswith('compiled one in ')
        assert not caplog.messages
        with compiling.logged('another'):
            time.sleep(0.02)
    assert caplog.messages[-1].startswith('compiled another in ')
    assert not any('another' in line for line in lines)


def test_a_workspace_that_is_given_arguments_says_what_it_reads():
    workspace = wheel().bind()
    for arguments in ((np.zeros(1),), (1, 2)):
        with pytest.raises(InputError,
                           match=r'workspace: mass_matrix\(.*expected no arguments'):
            workspace.mass_matrix(*arguments)


def test_a_payload_is_an_inertial_or_its_ten_parameters():
    load = Inertial(2.0, (0.1, 0.02, -0.03), np.diag([0.01, 0.02, 0.025]))
    robot = Robot(case('tree').robot.model, payload_frame='tool')
    robot.parameters.payload = load
    block = robot.parameters.block.copy()
    robot.parameters.payload = load.parameters
    np.testing.assert_allclose(robot.parameters.block, block, atol=1e-15)
    assert robot.parameters.payload.mass == pytest.approx(2.0)
    with pytest.raises(InputError,
                       match='payload: a list; expected an Inertial, its ten'):
        robot.parameters.payload = [1.0, 2.0]
