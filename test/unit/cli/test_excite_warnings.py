"""`kane-dynamics excite` warns of a motion that does not reach what was asked."""

from types import SimpleNamespace

from kane_dynamics.cli.commands.excite_command import bad_condition, missed_distance
import pytest


def motion(condition=50.0, nearest=0.06):
    """Return the figures of a motion."""
    return SimpleNamespace(condition=condition, nearest=('a', 'b', nearest))


@pytest.mark.parametrize(('nearest', 'distance'), [(0.06, 0.05), (0.011, None)])
def test_a_distance_that_is_kept_gives_no_warning(nearest, distance):
    assert missed_distance(motion(nearest=nearest), distance) is None


def test_a_missed_distance_names_the_links_and_the_distance_that_they_keep():
    warning = missed_distance(motion(nearest=0.011), 0.05)
    assert warning.startswith(
        "--distance: 0.05 m is missed, exit code 1: 'a' and 'b' come to "
        '0.011 m')
    assert 'expected --distance 0.011 or less' in warning


def test_a_large_condition_number_is_a_warning():
    assert bad_condition(motion()) is None
    assert bad_condition(motion(condition=1.4e6)).startswith(
        'condition number: 1.4e+06; expected at most 1000')
