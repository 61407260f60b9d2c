"""Read small serialized messages: a header, then numbers."""

from collections.abc import Callable
from typing import Any, NamedTuple

from kane_dynamics.errors import InputError
from kane_dynamics.ros.common.cdr import Reader, TooShortError
from kane_dynamics.ros.common.conversion import Array, NANO
import numpy as np
from rclpy.serialization import deserialize_message


class StampedNumbers(NamedTuple):
    """Stamp, ns, frame_id and numbers of a message, in the order of its fields."""

    stamp: int
    frame: str
    numbers: Array


def read_stamped(data: bytes, kind: Any, count: int,
                 numbers_of: Callable[[Any], Array]) -> StampedNumbers:
    """
    Read a message that is a Header, then doubles.

    Parameters
    ----------
    data : bytes
        The serialized message.
    kind : message type
        Of the message.
    count : int
        Number of doubles.
    numbers_of : callable
        Returns the doubles of a message, for encodings other than plain CDR.

    Raises
    ------
    InputError
        The message is malformed.

    """
    try:
        reader = Reader(data)
        sec, nanosec = reader.pair()
        frame = reader.text()
        begin = reader.advance(8, count)
        numbers = np.frombuffer(data, reader.order + 'f8', count, begin)
        numbers = numbers.astype(np.float64)
    except TooShortError:  # rclpy rejects it too, but prints an error each time
        raise
    except InputError:  # rclpy reads more encodings than plain CDR
        try:
            message = deserialize_message(data, kind)
        # RMWError is a RuntimeError
        except (RuntimeError, MemoryError, ValueError) as error:
            raise InputError(f'{kind.__name__} of {len(data)} bytes: '
                             f'{str(error)[:100]}; expected a message in a valid '
                             'encoding') from None
        sec = message.header.stamp.sec
        nanosec = message.header.stamp.nanosec
        frame = message.header.frame_id
        numbers = numbers_of(message)
    return StampedNumbers(sec * NANO + nanosec, frame, numbers)
