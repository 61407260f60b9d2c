"""Joint states as they come from the wire, into arrays in the node's order."""

from collections.abc import Sequence
import math

from kane_dynamics.errors import InputError
from kane_dynamics.ros.common.conversion import Array, Index, NANO
from kane_dynamics.ros.torque_path.cdr import (Block, Reader, STAMP, STAMP_AT, TooShortError,
                                               write_joint_state)
import numpy as np
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState

# Why a joint state was dropped; the diagnostics count each of them.
MISSING, TWICE, SHORT, NO_VELOCITY, NOT_FINITE, GARBLED = (
    'joint missing', 'joint named twice', 'arrays of unequal length', 'no velocity', 'not finite',
    'not a joint state')
OLD, FUTURE, DISORDER, NO_CLOCK = (
    'older than state_timeout', 'stamp from the future', 'stamp before the last one',
    'nothing on /clock')
OTHERS = 'of other joints'  # such as a gripper's own: no fault, and counted by itself
MOST_LAYOUTS = 8  # kept at a time: that many publishers may differ


def time_fault(stamp: int, now: int, last: int, timeout: int,
               old: str = OLD) -> tuple[str, str] | None:
    """
    Return why a message of this stamp must not be used, and the details, if so.

    Parameters
    ----------
    stamp, now, last : int
        Of the message, of the node's clock, and of the last good message, ns.
    timeout : int
        Age from which on it is stale, and the most that clocks may differ, ns.
    old : str
        The reason to give for a stale one.

    """
    if now - stamp > timeout:
        return old, f'{(now - stamp) / NANO:.3f} s old'
    if stamp - now > timeout:
        return FUTURE, f'{(stamp - now) / NANO:.3f} s ahead of the clock'
    if stamp < last:
        return DISORDER, f'{(last - stamp) / NANO:.6f} s before'
    return None


class JointStateLayout:
    """
    What the messages of one publisher have in common, and where their numbers stand.

    Two messages have the same layout if they are equal in every byte that is neither a number,
    nor stamp, nor padding, nor after the end: encapsulation, frame, names, counts.

    Parameters
    ----------
    data : bytes
        A message of this layout.

    Raises
    ------
    InputError
        The message is big endian, has not a position for each name, or is not what CDR says it
        must be.

    """

    def __init__(self, data: bytes) -> None:
        reader = Reader(data)
        reader.pair()
        frame_id, names = reader.text(), reader.texts()
        counts = [len(reader.doubles()) for _ in range(3)]
        if reader.order != '<' or counts[0] != len(names):
            raise InputError('the message is big endian, or not a position for each name')
        writer, (positions, velocities, efforts) = write_joint_state(names, frame_id, counts)
        full, _ = write_joint_state(names, frame_id, counts, fill=0xff)
        # Whole messages as numbers: the fastest masked comparison that the language has.
        self.expected = int.from_bytes(writer.data, 'little')
        self.mask = int.from_bytes(b'\xff' * len(full.data), 'little') & ~(
            self.expected ^ int.from_bytes(full.data, 'little'))
        block = Block(len(data))
        self.landing = memoryview(block.bytes)
        self.moving = counts[1] == len(names)  # whether each joint has a velocity
        # Efforts, which lie apart: most nodes have no use for them.
        self.efforts = block.doubles(efforts, len(names)) if counts[2] == len(names) else None
        # Eight bytes lie between positions and velocities, the count of these and padding: both
        # are gathered from one row of doubles.
        self.between = (velocities - positions) // 8
        self.numbers = block.doubles(positions, self.between + len(names) if self.moving
                                     else len(names))
        self.entry: Index = np.zeros(0, dtype=np.intp)
        self.index = self.entry

    def choose(self, index: Index) -> None:
        """Gather the joints that have these entries: their positions, then their velocities."""
        self.entry = index
        self.index = np.concatenate([index, index + self.between]) if self.moving else index


class JointStateReader:
    """
    Reads serialised joint states into `q` and `u`, arrays that stay, in the order of `joints`.

    A message laid out like an earlier one costs a comparison and two gathers. Any other takes the
    normal road through rclpy, with the same result, and its layout is learned.

    Attributes
    ----------
    q, u : (n,) arrays
        The last state; as good as meaningless after `read` has returned a reason.
    sec, nanosec : int
        Its stamp.
    effort : (n,) array
        The efforts of the last state, N m or N, if `measured`.
    measured : bool
        Whether that state had a finite effort for each joint.
    moving : bool
        Whether that state had velocities; else `u` is zero.
    need_effort : bool
        Whether efforts are read at all; False at first.
    others : set
        Names of the messages read that hold none of `joints`; whoever looks may empty it.
    detail : str
        What exactly was wrong with the last message that was not good.
    normal : int
        Messages that took the normal road.

    """

    def __init__(self, joints: Sequence[str]) -> None:
        self.joints = tuple(joints)
        self.need_effort, self.moving = False, False
        self.others: set[tuple[str, ...]] = set()
        self._state = np.zeros(2 * len(self.joints))
        self.q, self.u = np.split(self._state, 2)
        self.effort, self.measured = np.zeros(len(self.joints)), False
        self.sec = self.nanosec = 0
        self.detail = ''
        self.normal = 0
        self._layouts: dict[int, JointStateLayout] = {}  # by length of the message

    @property
    def stamp(self) -> int:
        """Return the stamp of the last state, ns."""
        return self.sec * NANO + self.nanosec

    def read(self, data: bytes, need_velocity: bool) -> str | None:
        """Read one message; return None if it is good, else the reason to drop it."""
        layout = self._layouts.get(len(data))
        if layout is None or (int.from_bytes(data, 'little') & layout.mask) != layout.expected or (
                need_velocity and not layout.moving):
            return self._read_normally(data, need_velocity)
        self.sec, self.nanosec = STAMP.unpack_from(data, STAMP_AT)
        layout.landing[:] = data
        self.moving = layout.moving
        if layout.moving:
            layout.numbers.take(layout.index, out=self._state, mode='clip')
        else:
            layout.numbers.take(layout.index, out=self.q, mode='clip')
            self.u.fill(0.0)
        if self.need_effort:
            self._take_effort(layout.efforts, layout.entry)
        return self._finite()

    def _read_normally(self, data: bytes, need_velocity: bool) -> str | None:
        """Read a message as rclpy does; learn its layout if it is good."""
        self.normal += 1
        layout = None
        try:
            layout = JointStateLayout(data)
        except TooShortError as error:  # rclpy would refuse it too, but print that every time
            self.detail = str(error)
            return GARBLED
        except InputError:  # rclpy reads more than plain CDR: such messages stay on its road
            pass
        try:
            message = deserialize_message(data, JointState)
        except (RuntimeError, MemoryError, ValueError) as error:  # RMWError is a RuntimeError
            self.detail = f'{len(data)} bytes: {str(error)[:100]}'
            return GARBLED
        stamp = message.header.stamp
        self.sec, self.nanosec = stamp.sec, stamp.nanosec
        index = self._index(message.name)
        if isinstance(index, str):
            return index
        fault = self._gather(message, index, need_velocity)
        if fault is None and layout is not None:
            layout.choose(index)
            self._learn(data, layout)
        return fault

    def _gather(self, message: JointState, index: Index, need_velocity: bool) -> str | None:
        count = len(message.name)
        if len(message.position) != count:
            self.detail = f'{len(message.position)} positions for {count} names'
            return SHORT
        np.frombuffer(message.position).take(index, out=self.q, mode='clip')
        speeds = len(message.velocity)
        self.moving = speeds == count
        if self.moving:
            np.frombuffer(message.velocity).take(index, out=self.u, mode='clip')
        elif need_velocity:
            self.detail = f'{speeds} velocities for {count} names'
            return SHORT if speeds else NO_VELOCITY
        else:
            self.u.fill(0.0)
        if self.need_effort:
            self._take_effort(np.frombuffer(message.effort) if len(message.effort) == count
                              else None, index)
        return self._finite()

    def _take_effort(self, efforts: Array | None, index: Index) -> None:
        """Gather efforts, which a driver may leave out or fill with NaN: that is no fault."""
        self.measured = efforts is not None
        if efforts is not None:
            efforts.take(index, out=self.effort, mode='clip')
            self.measured = math.isfinite(sum(self.effort.tolist()))

    def _index(self, names: list[str]) -> Index | str:
        """Return the entry of each joint, or why there is not one of each."""
        entry = {name: i for i, name in enumerate(names)}
        missing = [joint for joint in self.joints if joint not in entry]
        self.detail = ', '.join(missing)
        if names and len(missing) == len(self.joints):
            if len(self.others) < MOST_LAYOUTS:
                self.others.add(tuple(names))
            return OTHERS
        twice = [joint for joint in self.joints if names.count(joint) > 1]
        if missing or twice:
            self.detail = ', '.join(missing or twice)
            return MISSING if missing else TWICE
        return np.array([entry[joint] for joint in self.joints], dtype=np.intp)

    def _finite(self) -> str | None:
        if math.isfinite(sum(self._state.tolist())):  # short rows: faster than numpy
            return None
        bad = ~(np.isfinite(self.q) & np.isfinite(self.u))
        if not bad.any():  # the sum alone left the finite numbers
            return None
        self.detail = ', '.join(self.joints[i] for i in np.flatnonzero(bad))
        return NOT_FINITE

    def _learn(self, data: bytes, layout: JointStateLayout) -> None:
        """Keep the layout of a good message, in place of the oldest if there are many."""
        self._layouts.pop(len(data), None)
        if len(self._layouts) >= MOST_LAYOUTS:
            del self._layouts[next(iter(self._layouts))]
        self._layouts[len(data)] = layout
