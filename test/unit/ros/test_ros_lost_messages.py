"""Lost messages: counted by their numbers, for every executor, and never guessed."""

import inspect

from kane_dynamics.ros.common.lost_messages import LostMessages, with_info
import pytest


def numbered(*numbers):
    """Return the count after messages with these numbers."""
    lost = LostMessages()
    for number in numbers:
        lost.note({'publication_sequence_number': number})
    return lost


@pytest.mark.parametrize('numbers, count, share', [
    ((), 0, 0.0), ((1, 2, 3), 0, 0.0),
    ((7, 8, 11, 12), 2, 2 / 6), ((40, 42, 1, 2, 4), 2, 2 / 7)],
                         ids=['none', 'all received', 'missing', 'restarted publisher'])
def test_missing_numbers_are_lost_messages(numbers, count, share):
    lost = numbered(*numbers)
    assert lost.period(1) == (pytest.approx(share), str(count))
    assert lost.period(1) == (0.0, str(count))


def test_the_numbers_of_several_publishers_give_no_count():
    lost = numbered(1, 3)
    assert lost.period(1) == (pytest.approx(1 / 3), '1')
    for number in (1000, 4, 1001, 5):
        lost.note({'publication_sequence_number': number})
    assert lost.period(2) == (0.0, '1, now unknown: several publishers')
    lost.note({'publication_sequence_number': 6})
    lost.note({'publication_sequence_number': 7})
    assert lost.period(1) == (0.0, '1')


def test_without_numbers_the_count_is_unknown():
    assert numbered(None, None).period(1) == (
        0.0, 'unknown: the middleware does not number messages')


def test_a_callback_receives_the_info_from_every_executor():
    received = []
    call = with_info(lambda data, info: received.append((data, info)))
    call(b'1', {})
    call((b'2', {}))
    assert received == [(b'1', {}), (b'2', {})]
    with pytest.raises(TypeError):  # by which rclpy knows that it wants the info
        inspect.signature(call).bind(object())
    inspect.signature(call).bind(object(), object())
