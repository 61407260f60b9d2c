"""A damaged URDF either loads or raises an error with its reason."""

import re
import warnings

from hypothesis import given, settings
from hypothesis import strategies as st
from kane_dynamics.errors import KaneError, ModelWarning
from kane_dynamics.urdf import load_urdf
from urdf_writer import joint, link, robot

SOUND = robot(
    link('a'), link('b'), link('c'), link('d'), link('e', None),
    joint('free', 'a', 'b', 'floating', limit=''),
    joint('follow', 'b', 'c', more='<mimic joint="lead" multiplier="2" offset="0.1"/>'),
    joint('lead', 'c', 'd', 'prismatic', more='<dynamics damping="1" friction="0.5"/>'),
    joint('tool', 'd', 'e', 'fixed', xyz='1 2 3', rpy='0.1 0.2 0.3'),
    '<transmission name="t"><joint name="lead"/></transmission>')
VALUES = re.compile(r'(?<==")[^"]*(?=")')
ELEMENTS = re.compile(r'<[^/>]*/>|</?\w+[^>]*>')
PIECES = [
    '', ' ', '0', '-1', '-0', 'nan', '1e999', '1e59', '-1e59', '1e-320', '1 2 3',
    '0 0 0',
    'a', 'b', 'c', 'lead', 'follow', 'free', 'floating', 'planar', 'fixed', 'revolute',
    '&#10;', '&amp;', '\U0001f600', '"', '<', '>', '\0', '<!-- -->', '<!DOCTYPE x>']


@st.composite
def damaged(draw):
    """Return a valid URDF after a few replacements, deletions and repetitions."""
    text = SOUND
    for _ in range(draw(st.integers(1, 4))):
        pattern = draw(st.sampled_from([VALUES, VALUES, ELEMENTS]))
        spans = [match.span() for match in pattern.finditer(text)]
        start, end = draw(st.sampled_from(spans or [(0, 0)]))
        twice = st.just(text[start:end] * 2)
        piece = draw(st.sampled_from(PIECES) | st.floats().map(repr) | twice)
        text = text[:start] + piece + text[end:]
    return text


@settings(max_examples=300, deadline=None)
@given(damaged(), st.booleans())
def test_damaged_urdf_loads_or_is_rejected_with_its_reason(text, strict):
    message = 'valid'
    with warnings.catch_warnings():
        warnings.simplefilter('ignore', ModelWarning)
        try:
            load_urdf(text, strict=strict)
        except KaneError as error:
            message = str(error)
    assert re.search(r'valid|expected|must|may', message)
    assert len(message) < 3000
