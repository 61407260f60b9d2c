"""Read serialized joint states into arrays in the order of the node's joints."""

from collections.abc import Mapping, Sequence
import math
from typing import NamedTuple

from kane_dynamics.errors import InputError
from kane_dynamics.ros.common.cdr import (MessageBuffer, Reader, STAMP, STAMP_AT,
                                          TooShortError, write_joint_state)
from kane_dynamics.ros.common.conversion import (Array, Index, joint_places, NANO,
                                                 read_message)
from kane_dynamics.ros.common.stamped_numbers import MALFORMED, NOT_FINITE
from kane_dynamics.ros.torque_path.drop_reasons import (ELSEWHERE, FOREIGN, MISSING,
                                                        NO_VELOCITY, SHORT, TWICE)
import numpy as np
from sensor_msgs.msg import JointState

MAX_LAYOUTS = 8  # cached layouts, one for each publisher


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
    The layout of the messages of one publisher: constant bytes, and offsets.

    Two messages have the same layout if encapsulation, frame, names and counts are
    equal. Numbers, stamp, padding and trailing bytes may differ.

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
        frame_id = reader.text()
        names = reader.texts()
        counts = [len(reader.doubles()) for _ in range(3)]
        if reader.order != '<' or counts[0] != len(names):
            raise InputError('message: big endian or positions missing; expected little '
                             'endian and a position for each name')
        writer, (positions, velocities, efforts) = write_joint_state(names, frame_id,
                                                                     counts)
        full, _ = write_joint_state(names, frame_id, counts, fill=0xff)
        # Comparing whole messages as masked integers is the fastest comparison in
        # Python.
        self.expected = int.from_bytes(writer.data, 'little')
        self.mask = int.from_bytes(b'\xff' * len(full.data), 'little') & ~(
            self.expected ^ int.from_bytes(full.data, 'little'))
        self.positions_at = positions  # offset of the first position
        block = MessageBuffer(len(data))
        self.buffer = memoryview(block.bytes)
        self.has_velocity = counts[1] == len(names)
        self.efforts = block.doubles(efforts,
                                     len(names)) if counts[2] == len(names) else None
        # One view covers positions and velocities, so that one gather reads both.
        self.velocity_offset = (velocities - positions) // 8
        self.numbers = block.doubles(positions, self.velocity_offset + len(names)
                                     if self.has_velocity else len(names))
        self.entry: Index = np.zeros(0, dtype=np.intp)
        self.index = self.entry
        self.others = NO_OTHERS

    def fits(self, data: bytes) -> bool:
        """Return whether a message has this layout."""
        return len(data) == len(self.buffer) and (
            int.from_bytes(data, 'little') & self.mask) == self.expected

    def select(self, index: Index, others: 'OtherJoints') -> None:
        """
        Gather the joints with these indices: positions, then velocities.

        Other joints that are needed are gathered too.
        """
        self.entry = index
        self.others = others
        self.index = (np.concatenate([index, index + self.velocity_offset])
                      if self.has_velocity else index)


class JointStateReader:
    """
    Reads serialized joint states into the arrays `q` and `u`, in the order of `joints`.

    A message with a cached layout needs one comparison and two gathers. Any other
    message is deserialized by rclpy, with the same result, and its layout is cached.

    Parameters
    ----------
    joints : sequence of n str
        The joints that every message must have.
    optional : sequence of str
        Joints whose positions are read from messages that have them.
    actuated : sequence of str, optional
        Joints of the efforts; default: `joints`.

    Attributes
    ----------
    state : (2 n,) array
        Positions and velocities of `joints` in the latest message, accepted or not.
    q, u : (n,) arrays
        The latest state; undefined after `read` returned a reason.
    others : tuple of int
        Indices of the optional joints that the latest message has.
    positions : array
        Their positions.
    sec, nanosec : int
        Stamp of the latest state.
    effort : array
        The efforts of the latest state, N m or N, if `has_effort`.
    has_effort : bool
        Whether the latest state has a finite effort for each joint.
    has_velocity : bool
        Whether the latest state has velocities; else `u` is zero.
    need_effort : bool
        Whether efforts are read; initially False.
    locked : mapping of str to float
        Joints that the model has locked at 0, and the largest position at which each may
        be, rad or m, in the first message of a layout; initially empty.
    judged : bool
        Whether the caller refuses states that are not finite (`StateCheck`); initially
        False.
    foreign_joints : set
        Name lists of messages that contain none of `joints`; the caller may clear it.
    partial_joints : set
        Those of `joints` that messages have which lack others; the caller may clear it.
    detail : str
        Details of the latest reason to drop a message.
    full_parses : int
        Number of messages that rclpy deserialized.

    """

    def __init__(self, joints: Sequence[str], optional: Sequence[str] = (),
                 actuated: Sequence[str] | None = None) -> None:
        self.joints = tuple(joints)
        self.optional = tuple(optional)
        self._actuated = None if actuated is None else tuple(actuated)
        self.need_effort = False
        self.has_velocity = False
        self.judged = False
        self.locked: Mapping[str, float] = {}
        # Joints of messages that were warned of already.
        self.foreign_joints: set[tuple[str, ...]] = set()
        self.partial_joints: set[tuple[str, ...]] = set()
        # Arrays that are filled in place at each message: q and u are views of the
        # state.
        self.state = np.zeros(2 * len(self.joints))
        self._q, self._u = np.split(self.state, 2)
        self.q = self._q
        self.u = self._u
        self.others: tuple[int, ...] = ()
        self.positions = np.zeros(0)
        self.effort = np.zeros(len(self.joints if actuated is None else actuated))
        self.has_effort = False
        self.sec = self.nanosec = 0
        self.detail = ''
        self.full_parses = 0
        self._layouts: dict[int, JointStateLayout] = {}  # by length of the message

    @property
    def stamp(self) -> int:
        """Return the stamp of the latest state, ns."""
        return self.sec * NANO + self.nanosec

    @property
    def layouts(self) -> list[JointStateLayout]:
        """Return the cached layouts."""
        return list(self._layouts.values())

    def read(self, data: bytes, need_velocity: bool) -> str | None:
        """Read one message; return None, or the reason to drop it."""
        # A message of a known layout is one copy and one gather; all others are parsed.
        layout = self._layouts.get(len(data))
        if layout is None or (int.from_bytes(data, 'little')
                              & layout.mask) != layout.expected or (
                need_velocity and not layout.has_velocity):
            return self._parse(data, need_velocity)
        self.sec, self.nanosec = STAMP.unpack_from(data, STAMP_AT)
        layout.buffer[:] = data
        self.has_velocity = layout.has_velocity
        if layout.has_velocity:
            layout.numbers.take(layout.index, out=self.state, mode='clip')
        else:
            layout.numbers.take(layout.index, out=self._q, mode='clip')
            self._u.fill(0.0)

        # Joints that no law needs, but closed loops may compare.
        if self.optional:
            self.others = layout.others.places
            self.positions = layout.numbers[layout.others.entries]
        if self.need_effort:
            index = layout.entry if self._actuated is None else layout.others.efforts
            self._gather_effort(layout.efforts, index)
        return None if self.judged and not self.others else self._finite()

    def complete(self) -> str | None:
        """Compute what a state lacks; return None, or the reason to drop it."""
        return None

    def _parse(self, data: bytes, need_velocity: bool) -> str | None:
        """Deserialize a message with rclpy; cache its layout if it is valid."""
        self.full_parses += 1
        layout = None
        try:
            layout = JointStateLayout(data)
        # rclpy rejects it too, but prints an error each time
        except TooShortError as error:
            self.detail = str(error)
            return MALFORMED
        except InputError:  # rclpy reads more encodings than plain CDR
            pass
        try:
            message = read_message(data, JointState)
        except InputError as error:
            self.detail = str(error)
            return MALFORMED
        stamp = message.header.stamp
        self.sec = stamp.sec
        self.nanosec = stamp.nanosec
        index = self._index(message.name)
        if isinstance(index, str):
            return index
        others = self._other_joints(message.name)
        fault = self._gather(message, index, others, need_velocity)
        if fault is None and self._is_elsewhere(message):
            return ELSEWHERE
        if fault in (None, NOT_FINITE) and layout is not None:
            layout.select(index, others)
            self._cache_layout(data, layout)
        return fault

    def _other_joints(self, names: list[str]) -> OtherJoints:
        """Return the optional joints among `names`, and the places of the efforts."""
        if not self.optional:
            return NO_OTHERS
        present = tuple(k for k, name in enumerate(self.optional) if name in names)
        entries = joint_places([self.optional[k] for k in present], names)
        # Efforts count only if the message has those of all actuators.
        efforts = None
        actuated = self._actuated or ()
        if set(actuated) <= set(names):
            efforts = joint_places(actuated, names)
        return OtherJoints(present, entries, efforts)

    def _gather(self, message: JointState, index: Index, others: OtherJoints,
                need_velocity: bool) -> str | None:
        # Positions are complete or the message is refused; speeds may be missing where
        # no law needs them.
        count = len(message.name)
        if len(message.position) != count:
            self.detail = f'{len(message.position)} positions for {count} names'
            return SHORT
        positions = np.frombuffer(message.position)
        positions.take(index, out=self._q, mode='clip')
        self.others = others.places
        self.positions = positions[others.entries]
        speeds = len(message.velocity)
        self.has_velocity = speeds == count
        if self.has_velocity:
            np.frombuffer(message.velocity).take(index, out=self._u, mode='clip')
        elif need_velocity:
            self.detail = f'{speeds} velocities for {count} names'
            return SHORT if speeds else NO_VELOCITY
        else:
            self._u.fill(0.0)
        # Efforts of only some joints are as good as none.
        if self.need_effort:
            complete = len(message.effort) == count
            self._gather_effort(np.frombuffer(message.effort) if complete else None,
                                index if self._actuated is None else others.efforts)
        return self._finite()

    def _is_elsewhere(self, message: JointState) -> bool:
        """Return whether a locked joint is where the model does not describe the arm."""
        for name, position in zip(message.name, message.position, strict=True):
            if abs(position) > self.locked.get(name, math.inf):
                self.detail = (f'{name} at {position:.3g}, which the model has at 0; '
                               'expected it there, or among `joints`')
                return True
        return False

    def _gather_effort(self, efforts: Array | None, index: Index | None) -> None:
        """Gather efforts; a driver may omit them or send NaN."""
        self.has_effort = efforts is not None and index is not None
        if efforts is not None and index is not None:
            efforts.take(index, out=self.effort, mode='clip')
            self.has_effort = math.isfinite(sum(self.effort.tolist()))

    def _index(self, names: list[str]) -> Index | str:
        """Return the index of each joint in `names`, or the reason to drop."""
        missing = [joint for joint in self.joints if joint not in names]
        if missing:
            self.detail = ', '.join(missing)
            return self._note_missing(names, missing)
        # Joints that are not used may be there twice.
        used = (*self.joints, *self.optional)
        repeated = [joint for joint in used if names.count(joint) > 1]
        if repeated:
            self.detail = ', '.join(repeated)
            return TWICE
        return joint_places(self.joints, names)

    def _note_missing(self, names: list[str], missing: list[str]) -> str:
        """
        Note the names of a message that lacks joints.

        Return the reason to drop it.
        """
        # A message of other joints is from another device; one of some is a part of the
        # arm's.
        if names and len(missing) == len(self.joints):
            if len(self.foreign_joints) < MAX_LAYOUTS:
                self.foreign_joints.add(tuple(names))
            return FOREIGN
        if len(self.partial_joints) < MAX_LAYOUTS:
            part = tuple(joint for joint in self.joints if joint in names)
            self.partial_joints.add(part)
        return MISSING

    def _finite(self) -> str | None:
        """Return None if the state is finite, else the reason to drop it."""
        # Sums of lists are faster than numpy for short rows.
        if math.isfinite(sum(self.state.tolist())) and (
                not self.others or math.isfinite(sum(self.positions.tolist()))):
            return None
        # A speed that is NaN is absent: the caller that judges states derives it.
        speeds = np.isfinite(self._u) | (np.isnan(self._u) & self.judged)
        bad = [*np.compress(~(np.isfinite(self._q) & speeds), self.joints),
               *(self.optional[k] for k, x in zip(self.others, self.positions)
                 if not math.isfinite(x))]
        if not bad:  # only speeds are absent, or the sum overflowed
            return None
        self.detail = ', '.join(bad)
        return NOT_FINITE

    def _cache_layout(self, data: bytes, layout: JointStateLayout) -> None:
        """
        Cache the layout of a valid message.

        Drop the oldest one if the cache is full.
        """
        self._layouts.pop(len(data), None)
        if len(self._layouts) >= MAX_LAYOUTS:
            del self._layouts[next(iter(self._layouts))]
        self._layouts[len(data)] = layout
