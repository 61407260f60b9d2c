"""
Serialised messages, as far as the node reads and writes them itself: plain CDR, version 1.

A message is four bytes of encapsulation and a body. Every number stands at a multiple of its own
size from the beginning of the body; what lies between is padding and may be anything (Fast DDS
leaves there what the memory held). A string is its length with the final NUL, then its bytes; a
sequence is its count, then its elements, with no padding where there are none. Source: OMG
DDSI-RTPS 2.5, chapter 10, and CORBA 3.3, section 9.3.
"""

from collections.abc import Sequence
import struct

from kane_dynamics.errors import InputError
import numpy as np
from numpy.typing import NDArray

HEAD = 4        # bytes of encapsulation
STAMP = struct.Struct('<iI')
STAMP_AT = HEAD  # a Header begins with its stamp, and a JointState with its Header


class TooShortError(InputError):
    """A message ends before what it announces."""


class Reader:
    """
    Reads one serialised message from its beginning to its end.

    Parameters
    ----------
    data : bytes
        Encapsulation and body, big or little endian.

    Attributes
    ----------
    order : str
        Byte order in the words of `struct`: '<' or '>'.
    at : int
        Where the next read begins.

    Raises
    ------
    InputError
        From here and from every method: says what is not as it must be, and where.

    """

    def __init__(self, data: bytes) -> None:
        if len(data) < HEAD or data[0] != 0 or data[1] > 1:
            raise InputError(f'the encapsulation is {data[:2].hex() or "absent"}; valid: 0000 or '
                             '0001, plain CDR')
        self._data, self.at = data, HEAD
        self.order = '<' if data[1] else '>'
        self._word, self._pair = struct.Struct(self.order + 'I'), struct.Struct(self.order + 'iI')

    def take(self, size: int, count: int) -> int:
        """Return where `count` numbers of `size` bytes begin, and go past them."""
        begin = self.at + -(self.at - HEAD) % size
        end = begin + size * count
        if end > len(self._data):
            raise TooShortError(f'{count} elements of {size} bytes from byte {begin} on in a '
                                f'message of {len(self._data)} bytes')
        self.at = end
        return begin

    def word(self) -> int:
        """Return an unsigned number of 32 bits."""
        return int(self._word.unpack_from(self._data, self.take(4, 1))[0])

    def pair(self) -> tuple[int, int]:
        """Return the two numbers of a Time or a Duration: s, and ns on top."""
        sec, nanosec = self._pair.unpack_from(self._data, self.take(4, 2))
        return sec, nanosec

    def text(self) -> str:
        """Return a string."""
        length = self.word()
        begin = self.take(1, length)
        body = self._data[begin:self.at]
        if not body.endswith(b'\0') or body.count(b'\0') > 1:
            raise InputError(f'the string at byte {begin} does not end with its only NUL')
        try:
            return body[:-1].decode()
        except UnicodeDecodeError:
            raise InputError(f'the string at byte {begin} is not UTF-8') from None

    def texts(self) -> list[str]:
        """Return a sequence of strings."""
        count = self.word()
        if 4 * count > len(self._data) - self.at:  # each has its length
            raise TooShortError(f'{count} strings from byte {self.at} on in a message of '
                                f'{len(self._data)} bytes')
        return [self.text() for _ in range(count)]

    def doubles(self) -> NDArray[np.float64]:
        """Return a sequence of doubles, (count,)."""
        count = self.word()
        if count == 0:
            return np.zeros(0)
        begin = self.take(8, count)
        return np.frombuffer(self._data, self.order + 'f8', count, begin)


class Writer:
    """
    Lays out one little-endian message; numbers are filled in later.

    Parameters
    ----------
    fill : int
        The byte that stands wherever the layout says nothing: in numbers, stamps and padding.

    """

    def __init__(self, fill: int = 0) -> None:
        self.data = bytearray((0, 1, fill, fill))
        self._fill = bytes([fill])

    def take(self, size: int, count: int) -> int:
        """Append `count` numbers of `size` bytes; return where they begin."""
        padding = -(len(self.data) - HEAD) % size
        self.data += self._fill * (padding + size * count)
        return len(self.data) - size * count

    def word(self, value: int) -> None:
        """Append an unsigned number of 32 bits."""
        struct.pack_into('<I', self.data, self.take(4, 1), value)

    def text(self, value: str) -> None:
        """Append a string."""
        body = value.encode() + b'\0'
        self.word(len(body))
        self.data += body

    def texts(self, values: Sequence[str]) -> None:
        """Append a sequence of strings."""
        self.word(len(values))
        for value in values:
            self.text(value)

    def doubles(self, count: int) -> int:
        """Append a sequence of doubles; return where they begin, or end where there are none."""
        self.word(count)
        return self.take(8, count) if count else len(self.data)


def write_joint_state(names: Sequence[str], frame_id: str, counts: Sequence[int],
                      fill: int = 0) -> tuple[Writer, list[int]]:
    """
    Lay out a sensor_msgs/JointState.

    Parameters
    ----------
    names : sequence of str
        Of the joints.
    frame_id : str
        Of the header.
    counts : three int
        Numbers of positions, velocities and efforts.
    fill : int
        As for `Writer`.

    Returns
    -------
    writer : Writer
    offsets : list of int
        Where positions, velocities and efforts begin.

    """
    writer = Writer(fill)
    writer.take(4, 2)
    writer.text(frame_id)
    writer.texts(names)
    return writer, [writer.doubles(count) for count in counts]


class Block:
    """Bytes of one message that stay in place, with views of the doubles in it."""

    def __init__(self, size: int) -> None:
        # The body begins at a multiple of 8, so that its doubles do.
        self.bytes = np.zeros(size + HEAD, dtype=np.uint8)[HEAD:]

    def doubles(self, offset: int, count: int) -> NDArray[np.float64]:
        """Return a view of `count` little-endian doubles."""
        return self.bytes[offset:offset + 8 * count].view('<f8')


class Prepared(Block):
    """
    A message to be sent again and again, in which only numbers and stamp change.

    Attributes
    ----------
    numbers : (n,) array
        The doubles of the message; write into them.

    """

    def __init__(self, writer: Writer, offset: int, count: int) -> None:
        super().__init__(len(writer.data))
        self.bytes[:] = np.frombuffer(writer.data, dtype=np.uint8)
        self.numbers = self.doubles(offset, count)

    def stamp(self, sec: int, nanosec: int) -> None:
        """Set the stamp of a message that begins with a Header."""
        STAMP.pack_into(self.bytes, STAMP_AT, sec, nanosec)

    def serialized(self) -> bytes:
        """Return the message as it is now."""
        return self.bytes.tobytes()


def joint_efforts(names: Sequence[str]) -> Prepared:
    """Return a sensor_msgs/JointState that holds an effort for each name and nothing else."""
    writer, offsets = write_joint_state(names, '', (0, 0, len(names)))
    return Prepared(writer, offsets[2], len(names))


def wrench_stamped(frame_id: str) -> Prepared:
    """Return a geometry_msgs/WrenchStamped at a frame; its numbers are force, then torque."""
    writer = Writer()
    writer.take(4, 2)
    writer.text(frame_id)
    return Prepared(writer, writer.take(8, 6), 6)


def numbers(count: int) -> Prepared:
    """Return a std_msgs/Float64MultiArray of `count` numbers without a layout."""
    writer = Writer()
    writer.word(0)  # dimensions
    writer.word(0)  # offset of the data
    return Prepared(writer, writer.doubles(count), count)
