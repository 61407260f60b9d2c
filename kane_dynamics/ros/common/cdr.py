"""
Read and write serialized messages: plain CDR, version 1.

A message is four bytes of encapsulation and a body. Each number is aligned to a multiple
of its own size from the start of the body; the content of padding bytes is undefined
(Fast DDS does not clear them). A string is its length including the final NUL, then its
bytes. A sequence is its count, then its elements; an empty sequence has no padding.
Source: OMG DDSI-RTPS 2.5, chapter 10, and CORBA 3.3, section 9.3.
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
    """A message is shorter than its contents require."""


class Reader:
    """
    Reads the fields of one serialized message in order.

    Parameters
    ----------
    data : bytes
        Encapsulation and body, big or little endian.

    Attributes
    ----------
    order : str
        Byte order as in `struct`: '<' or '>'.
    offset : int
        Offset of the next field, bytes.

    Raises
    ------
    InputError
        Here and in every method: the message is not valid CDR.

    """

    def __init__(self, data: bytes) -> None:
        if len(data) < HEAD or data[0] != 0 or data[1] > 1:
            raise InputError(f'encapsulation: {data[:2].hex() or "absent"}; expected '
                             '0000 or 0001, plain CDR')
        self._data = data
        self.offset = HEAD
        self.order = '<' if data[1] else '>'
        self._word = struct.Struct(self.order + 'I')
        self._pair = struct.Struct(self.order + 'iI')

    def advance(self, size: int, count: int) -> int:
        """Skip `count` numbers of `size` bytes; return their offset."""
        begin = self.offset + -(self.offset - HEAD) % size
        end = begin + size * count
        if end > len(self._data):
            raise TooShortError(f'message: {len(self._data)} bytes; expected at least '
                                f'{end} for {count} elements of {size} bytes')
        self.offset = end
        return begin

    def word(self) -> int:
        """Read an unsigned 32-bit integer."""
        return int(self._word.unpack_from(self._data, self.advance(4, 1))[0])

    def pair(self) -> tuple[int, int]:
        """Read a Time or a Duration: seconds and nanoseconds."""
        sec, nanosec = self._pair.unpack_from(self._data, self.advance(4, 2))
        return sec, nanosec

    def text(self) -> str:
        """Read a string."""
        # The length counts the NUL at the end.
        length = self.word()
        begin = self.advance(1, length)
        body = self._data[begin:self.offset]
        if not body.endswith(b'\0') or body.count(b'\0') > 1:
            raise InputError(f'string at byte {begin}: {body[:40]!r}; expected a single '
                             'NUL, at its end')
        try:
            return body[:-1].decode()
        except UnicodeDecodeError:
            raise InputError(f'string at byte {begin}: {body[:40]!r}; expected '
                             'UTF-8') from None

    def texts(self) -> list[str]:
        """Read a sequence of strings."""
        count = self.word()
        if 4 * count > len(self._data) - self.offset:  # each string has a 4-byte length
            raise TooShortError(f'message: {len(self._data)} bytes; expected at least '
                                f'{self.offset + 4 * count} for {count} strings')
        return [self.text() for _ in range(count)]

    def doubles(self) -> NDArray[np.float64]:
        """Read a sequence of doubles, (count,)."""
        count = self.word()
        if count == 0:
            return np.zeros(0)
        begin = self.advance(8, count)
        return np.frombuffer(self._data, self.order + 'f8', count, begin)


class Writer:
    """
    Builds the layout of one little-endian message; numbers are written later.

    Parameters
    ----------
    fill : int
        Value of the bytes of numbers, stamps and padding.

    """

    def __init__(self, fill: int = 0) -> None:
        self.data = bytearray((0, 1, fill, fill))
        self._fill = bytes([fill])

    def reserve(self, size: int, count: int) -> int:
        """Append `count` numbers of `size` bytes; return their offset."""
        padding = -(len(self.data) - HEAD) % size
        self.data += self._fill * (padding + size * count)
        return len(self.data) - size * count

    def word(self, value: int) -> None:
        """Append an unsigned 32-bit integer."""
        struct.pack_into('<I', self.data, self.reserve(4, 1), value)

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
        """Append a sequence of doubles; return the offset of the first."""
        self.word(count)
        return self.reserve(8, count) if count else len(self.data)


def write_joint_state(names: Sequence[str], frame_id: str, counts: Sequence[int],
                      fill: int = 0) -> tuple[Writer, list[int]]:
    """
    Build the layout of a sensor_msgs/JointState.

    Parameters
    ----------
    names : sequence of str
        Names of the joints.
    frame_id : str
        Frame of the header.
    counts : three int
        Numbers of positions, velocities and efforts.
    fill : int
        As for `Writer`.

    Returns
    -------
    writer : Writer
    offsets : list of int
        Offsets of positions, velocities and efforts.

    """
    writer = Writer(fill)
    writer.reserve(4, 2)
    writer.text(frame_id)
    writer.texts(names)
    return writer, [writer.doubles(count) for count in counts]


class MessageBuffer:
    """The bytes of one message at a fixed address, with views of its doubles."""

    def __init__(self, size: int) -> None:
        # The body is aligned to 8 bytes, and so are its doubles.
        self.bytes = np.zeros(size + HEAD, dtype=np.uint8)[HEAD:]

    def doubles(self, offset: int, count: int) -> NDArray[np.float64]:
        """Return a view of `count` little-endian doubles."""
        return self.bytes[offset:offset + 8 * count].view('<f8')


class PreparedMessage(MessageBuffer):
    """
    A serialized message with a fixed layout, of which numbers and stamp are rewritten.

    Attributes
    ----------
    numbers : (n,) array
        View of the doubles of the message; write into it.

    """

    def __init__(self, writer: Writer, offset: int, count: int) -> None:
        super().__init__(len(writer.data))
        self.bytes[:] = np.frombuffer(writer.data, dtype=np.uint8)
        self.numbers = self.doubles(offset, count)

    def stamp(self, sec: int, nanosec: int) -> None:
        """Set the stamp of a message that begins with a Header."""
        STAMP.pack_into(self.bytes, STAMP_AT, sec, nanosec)

    def read(self, data: bytes) -> bool:
        """
        Copy a message of this layout into this one.

        Return False if its size differs.
        """
        if len(data) != self.bytes.size:
            return False
        self.bytes[:] = np.frombuffer(data, dtype=np.uint8)
        return True

    def serialized(self) -> bytes:
        """Return a copy of the message."""
        return self.bytes.tobytes()


def joint_state_of_efforts(names: Sequence[str]) -> PreparedMessage:
    """Return a sensor_msgs/JointState with one effort per name and no other numbers."""
    writer, offsets = write_joint_state(names, '', (0, 0, len(names)))
    return PreparedMessage(writer, offsets[2], len(names))


def wrench_stamped(frame_id: str) -> PreparedMessage:
    """Return a geometry_msgs/WrenchStamped at a frame: force, then torque."""
    writer = Writer()
    writer.reserve(4, 2)
    writer.text(frame_id)
    return PreparedMessage(writer, writer.reserve(8, 6), 6)


def joint_command(names: Sequence[str], interface: str) -> PreparedMessage:
    """Return a control_msgs/JointCommand of one interface, with one number per name."""
    writer = Writer()
    writer.reserve(4, 2)
    writer.text('')
    writer.texts(names)
    writer.text(interface)
    return PreparedMessage(writer, writer.doubles(len(names)), len(names))


def interface_groups(names: Sequence[str], interfaces: Sequence[str]) -> PreparedMessage:
    """
    Return a control_msgs/DynamicInterfaceGroupValues with the same interfaces of all names.

    Its numbers are (interfaces, names).
    """
    writer = Writer()
    writer.reserve(4, 2)
    writer.text('')
    writer.texts(names)
    writer.word(len(names))
    offsets = []
    for _ in names:
        writer.texts(interfaces)
        offsets.append(writer.doubles(len(interfaces)))
    message = PreparedMessage(writer, offsets[0], len(interfaces))
    # Entries of equal text have equal lengths, and doubles are aligned to 8 bytes.
    step = (len(writer.data) - offsets[0] - 8 * len(interfaces)) // max(len(names) - 1, 1)
    message.numbers = np.lib.stride_tricks.as_strided(
        message.numbers, (len(interfaces), len(names)), (8, step))
    return message


def float64_multi_array(count: int) -> PreparedMessage:
    """Return a std_msgs/Float64MultiArray of `count` numbers with an empty layout."""
    writer = Writer()
    writer.word(0)  # dimensions
    writer.word(0)  # data offset
    return PreparedMessage(writer, writer.doubles(count), count)
