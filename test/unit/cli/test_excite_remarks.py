"""`kane-dynamics excite` warns of a motion that does not reach what was asked."""

from types import SimpleNamespace

from kane_dynamics.cli.commands.excite_command import remarks
import pytest


@pytest.mark.parametrize(('condition', 'nearest', 'distance', 'words'), [
    (50.0, 0.06, 0.05, []), (50.0, 0.011, None, []),
    (50.0, 0.011, 0.05, ["distance: 0.011 m between 'a' and 'b'"]),
    (1.4e6, 0.06, 0.05, ['condition number: 1.4e+06; expected at most 1000'])])
def test_a_smaller_distance_and_a_large_condition_number_are_said(
        condition, nearest, distance, words):
    motion = SimpleNamespace(condition=condition, nearest=('a', 'b', nearest))
    said = remarks(motion, distance)
    assert len(said) == len(words)
    assert all(line.startswith(start) for line, start in zip(said, words, strict=True))
