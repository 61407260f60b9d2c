"""The report of mode cartesian counts deflections from before the first force."""

from kane_dynamics.demo import deflection_report as demo
from kane_dynamics.demo.demo_settings import FR3
import numpy as np

RATE = 1000.0
REST = np.array([0.0, -0.7, 0.0, -2.2, 0.0, 1.5, 0.785])


def test_the_picture_has_no_deflection_before_the_first_force(
        tmp_path, monkeypatch, capsys):
    # The servo leaves the arm elsewhere; then rest, a force that moves nothing, and
    # rest.
    t = np.arange(0.0, 2.0, 1.0 / RATE)
    q = np.tile(REST, (len(t), 1))
    q[t < 0.3, 1] += 0.01
    wrench = np.zeros((len(t), 6))
    wrench[(t >= 1.0) & (t < 1.5), 1] = 30.0
    run = demo.DeflectionLog(t, q, np.zeros_like(q), wrench)
    drawn = []
    monkeypatch.setattr(demo, 'plot_deflection', lambda *args, **_: drawn.append(args))
    assert demo.report_deflections(
        FR3, run, tmp_path) == 1, 'the force has to move the arm'
    deflection = drawn[0][1]
    np.testing.assert_allclose(deflection[t > 0.4], 0.0, atol=1e-12)
    assert np.linalg.norm(deflection[0]) > 1e-3
    assert '50.00 mm' in capsys.readouterr().out
