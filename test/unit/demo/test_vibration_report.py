"""The verdict of the demonstration of elastic joints."""

from kane_dynamics.demo.demo_settings import AFTER, FAST, ROBOTS
from kane_dynamics.demo.vibration_report import report_vibration, VibrationLog
import numpy as np
import pytest


def log(amplitude, travel):
    """Return a record: a motion along x, then a vibration that ends earlier."""
    t = np.linspace(0.0, FAST + AFTER, 400)
    settled = t - FAST
    place = np.zeros((len(t), 3))
    place[:, 0] = travel * np.minimum(t / FAST - 1.0, 0.0)
    place[:, 2] = amplitude * np.where(settled >= 0.0, np.exp(-20.0 * settled), 0.0)
    began = 3.0
    record = VibrationLog(t=t, started=np.array(began), command=np.ones((len(t), 7)),
                          place=place)
    return record.since(began + FAST)


@pytest.mark.parametrize('amplitude, travel, code', [
    (1e-6, 0.5, 0), (2e-4, 0.5, 1), (1e-6, 0.01, 1)])
def test_the_elastic_feedforward_must_move_the_arm_and_leave_a_twentieth(
        amplitude, travel, code, tmp_path, monkeypatch, capsys):
    robot = next(iter(ROBOTS.values()))
    runs = {'rigid feedforward': log(1e-3, travel),
            'elastic feedforward': log(amplitude, travel)}
    if code:  # the picture is the same
        monkeypatch.setattr('kane_dynamics.demo.vibration_report._plot_runs',
                            lambda *_: None)
    assert report_vibration(robot, runs, tmp_path) == code
    printed = capsys.readouterr().out
    assert f'{1e3 * runs["rigid feedforward"].vibration:.4f} mm' in printed
    assert runs['rigid feedforward'].vibration == pytest.approx(1e-3, rel=0.1)
    assert ('expected at least 20' in printed) == bool(code)
    assert code or (tmp_path / 'demo_elastic.png').stat().st_size > 1e4
