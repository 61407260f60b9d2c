"""The demo says what its figures are worth, and repeats a spoiled run."""

from kane_dynamics.demo import tracking_report as demo
from kane_dynamics.demo.demo_settings import DURATION, FR3, RATE, STATE_TIMEOUT
import numpy as np
import pytest

MOTION = FR3.motion()


def log(error, late=1e-4, answered=1.0):
    """Return a run that misses the motion by an error, rad, states late by s."""
    t = np.arange(0.0, DURATION, 1.0 / RATE)
    q = MOTION.sample(t)[0] + error
    answered_times = t[:round(answered * len(t))]
    return demo.TrackingLog(
        t, q, *np.zeros((3, *q.shape)), np.full(len(t), late),
        np.stack([answered_times, np.full(len(answered_times), 1e-3)], axis=1))


def without_states():
    """Return a run of which no state came during the motion."""
    return log(0.02).within(2.0 * DURATION, 3.0 * DURATION)


@pytest.mark.parametrize('spoiled', [log(0.02, late=2.0 * STATE_TIMEOUT),
                                     log(0.02, answered=0.4), without_states()])
def test_a_run_with_late_states_is_repeated_once(spoiled, capsys):
    runs = [spoiled, good := log(0.001)]
    assert demo.repeated_if_late(MOTION, log(0.1), lambda: runs.pop(0)) is good
    assert 'the machine is too busy' in capsys.readouterr().out
    runs = [spoiled, spoiled, good]
    assert demo.repeated_if_late(MOTION, log(0.1), lambda: runs.pop(0)) is spoiled
    assert runs == [good]


@pytest.mark.parametrize('run', [log(0.02), log(0.001, answered=0.4)])
def test_a_run_in_time_or_good_enough_is_not_repeated(run):
    runs = [run]
    assert demo.repeated_if_late(MOTION, log(0.1), lambda: runs.pop(0)) is run


@pytest.mark.filterwarnings('error')
@pytest.mark.parametrize('alone', [log(0.1), without_states()])
def test_runs_without_states_are_named_as_such(alone, capsys):
    """The ratio was nan without a reason, and warnings of NumPy came before it."""
    ratio = demo.improvement(MOTION, alone, without_states())
    assert demo.verdict(ratio, demo.lateness(MOTION, without_states())) == 1
    printed = capsys.readouterr().out
    for words in ('too busy', 'no state of the arm came during the motion', 'not valid'):
        assert words in printed


def test_the_demonstration_succeeds_only_with_good_feedforward(capsys):
    ratios = [demo.improvement(MOTION, log(0.1), log(error)) for error in (0.001, 0.02)]
    assert ratios == pytest.approx([100.0, 5.0])
    late = demo.lateness(MOTION, log(0.02, late=0.158, answered=0.375))
    assert demo.verdict(ratios[0], None) == 0
    assert capsys.readouterr().out == ''
    assert demo.verdict(ratios[1], None) == 1
    assert 'busy' not in capsys.readouterr().out
    assert demo.verdict(ratios[1], late) == 1
    printed = capsys.readouterr().out
    for words in ('too busy', '1500 of 4000 states', '158 ms late', 'errors: 5.0',
                  'not valid'):
        assert words in printed
