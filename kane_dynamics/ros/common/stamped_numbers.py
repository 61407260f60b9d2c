"""Read small serialized messages, a header and numbers, and compare their stamps."""

from collections.abc import Callable
import struct
from typing import Any, NamedTuple

from kane_dynamics.ros.common.conversion import Array, NANO, nanoseconds, read_message

# Reasons to drop a message
NOT_FINITE, MALFORMED = 'not finite', 'malformed message'
FUTURE, OUT_OF_ORDER = 'stamp in the future', 'stamp before the latest one'

LITTLE_ENDIAN = 1  # in the second byte of a message
NO_STAMP = bytes(8)


class StampedNumbers(NamedTuple):
    """Stamp, ns, frame_id and numbers of a message, in the order of its fields."""

    stamp: int
    frame: str
    numbers: Array


def read_stamped(data: bytes, kind: Any,
                 numbers_of: Callable[[Any], Array]) -> StampedNumbers:
    """
    Read a serialized message of a header and numbers.

    Parameters
    ----------
    data : bytes
        The serialized message.
    kind : message type
        Of the message.
    numbers_of : callable
        Returns the numbers of a message.

    Raises
    ------
    InputError
        The message is malformed.

    """
    message = read_message(data, kind)
    header = message.header
    return StampedNumbers(nanoseconds(header.stamp), header.frame_id, numbers_of(message))


def with_stamp(data: bytes, received: int) -> bytes:
    """
    Return a serialized message that begins with a Header, and has a stamp.

    Parameters
    ----------
    data : bytes
        The message. Returned unchanged if it has a stamp, or is not little-endian CDR.
    received : int
        The stamp of a message that has none, ns: a message that has waited is not of the
        time at which it is read. 0 if the time is unknown.

    """
    if data[4:12] != NO_STAMP or data[1] != LITTLE_ENDIAN or received <= 0:
        return data
    return data[:4] + struct.pack('<iI', *divmod(received, NANO)) + data[12:]


def time_fault(stamp: int, now: int, last: int, timeout: int, stale: str
               ) -> tuple[str, str] | None:
    """
    Return the reason and the details for which a stamp is invalid; None if it is valid.

    Parameters
    ----------
    stamp, now, last : int
        Stamp of the message, time of the node's clock, stamp of the latest valid
        message, ns.
    timeout : int
        Age above which a message is stale, and largest difference of clocks, ns.
    stale : str
        Reason to return for a stale message.

    """
    # In either direction of time, then in order.
    if now - stamp > timeout:
        return stale, f'{(now - stamp) / NANO:.3f} s old'
    if stamp - now > timeout:
        return FUTURE, f'{(stamp - now) / NANO:.3f} s ahead of the clock'
    if stamp < last:
        return OUT_OF_ORDER, f'{(last - stamp) / NANO:.6f} s before it'
    return None
