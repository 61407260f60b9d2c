"""The layout of serialized joint states of one publisher."""

from typing import NamedTuple

from kane_dynamics.errors import InputError
from kane_dynamics.ros.common.conversion import Index
from kane_dynamics.ros.torque_path.cdr import MessageBuffer, Reader, write_joint_state
import numpy as np


class OtherJoints(NamedTuple):
    """
    Optional joints of a message.

    Attributes
    ----------
    places : tuple of int
        Their indices in `JointStateReader.optional`.
    entries : array of int
        Their indices in the message.
    efforts : array of int or None
        Indices in the message of the joints with efforts; None if one is missing.

    """

    places: tuple[int, ...]
    entries: Index
    efforts: Index | None


NO_OTHERS = OtherJoints((), np.zeros(0, dtype=np.intp), None)


class JointStateLayout:
    """
    The layout of the messages of one publisher: the constant bytes, and the offsets of numbers.

    Two messages have the same layout if encapsulation, frame, names and counts are equal. Numbers,
    stamp, padding and trailing bytes may differ.

    Parameters
    ----------
    data : bytes
        A message of this layout.

    Raises
    ------
    InputError
        The message is big endian, lacks a position for a name, or is not valid CDR.

    """

    def __init__(self, data: bytes) -> None:
        reader = Reader(data)
        reader.pair()
        frame_id, names = reader.text(), reader.texts()
        counts = [len(reader.doubles()) for _ in range(3)]
        if reader.order != '<' or counts[0] != len(names):
            raise InputError('message: big endian or positions missing; expected little endian '
                             'and a position for each name')
        writer, (positions, velocities, efforts) = write_joint_state(names, frame_id, counts)
        full, _ = write_joint_state(names, frame_id, counts, fill=0xff)
        # Comparing whole messages as masked integers is the fastest comparison in Python.
        self.expected = int.from_bytes(writer.data, 'little')
        self.mask = int.from_bytes(b'\xff' * len(full.data), 'little') & ~(
            self.expected ^ int.from_bytes(full.data, 'little'))
        block = MessageBuffer(len(data))
        self.buffer = memoryview(block.bytes)
        self.has_velocity = counts[1] == len(names)
        self.efforts = block.doubles(efforts, len(names)) if counts[2] == len(names) else None
        # One view covers positions and velocities, so that one gather reads both.
        self.velocity_offset = (velocities - positions) // 8
        self.numbers = block.doubles(positions, self.velocity_offset + len(names)
                                     if self.has_velocity else len(names))
        self.entry: Index = np.zeros(0, dtype=np.intp)
        self.index, self.others = self.entry, NO_OTHERS

    def select(self, index: Index, others: 'OtherJoints') -> None:
        """Gather the joints with these indices: positions, then velocities; and other joints."""
        self.entry, self.others = index, others
        self.index = (np.concatenate([index, index + self.velocity_offset])
                      if self.has_velocity else index)
