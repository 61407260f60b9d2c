"""
Frames that only tf2 knows, placed on the bodies of the model.

A message may name a frame that the URDF lacks, such as that of a camera or of the map
around the arm. Its transforms lead to a frame of the model, up or down the tree of tf2:
on the body of that frame it is placed. Transforms between frames of the model are not
used, because the model knows them. A transform of /tf counts for `timeout` from its
stamp on, one of /tf_static without end.
"""

from collections.abc import Callable, Mapping
from importlib import import_module
import math
from typing import Any, NamedTuple

from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.algebra.quaternion import rotation_matrix
from kane_dynamics.model.model import Frame, Model
from kane_dynamics.ros.common.conversion import Array, NANO, nanoseconds
import numpy as np

REFUSED = 'transform'  # reason of rejected transforms
QUATERNION = 0.01  # largest difference of the length of a quaternion from 1
MOST_FRAMES = 4096


def tf_message_type() -> Any:
    """
    Return the message type tf2_msgs/TFMessage.

    Raise InputError if not installed.
    """
    try:
        return import_module('tf2_msgs.msg').TFMessage
    except (ImportError, AttributeError) as error:
        raise InputError(f"parameter 'tf.enabled': true without tf2_msgs/TFMessage ({error}); "
                         'expected false, or an installed package tf2_msgs') from None


class _Transform(NamedTuple):
    """Pose (4, 4) of a frame in its parent; stamp, ns, None if static; time of receipt, ns."""

    parent: str
    pose: Array
    stamp: int | None
    received: int


class TransformTree:
    """
    The latest transforms, and the frames that they place on the model.

    One thread stores messages, and any may look for frames.

    Parameters
    ----------
    model : Model
    now : callable
        Returns the node's clock, ns.
    timeout : float
        Age above which a transform of /tf is stale, s.
    reject : callable
        Called with the reason and the details of each transform that is not stored.

    """

    def __init__(self, model: Model, now: Callable[[], int], timeout: float,
                 reject: Callable[[str, str], None]) -> None:
        self.timeout = timeout
        self._now = now
        self._reject = reject
        self._frames = {frame.name: frame for frame in model.frames}
        # Replaced whole, so that other threads see all transforms of a message or none.
        self._transforms: Mapping[str, _Transform] = {}

    def on_message(self, message: Any, *, static: bool) -> None:
        """Store the transforms of a TFMessage."""
        transforms = dict(self._transforms)
        for stated in message.transforms:
            try:
                self._store(transforms, stated, static)
            except InputError as error:
                self._reject(REFUSED, str(error))
        self._transforms = transforms

    def _store(self, transforms: dict[str, _Transform], stated: Any,
               static: bool) -> None:
        """Store one TransformStamped; InputError if it is not valid."""
        parent, child = stated.header.frame_id, stated.child_frame_id
        # Frames of the model are known better from the model.
        if child in self._frames and parent in self._frames:
            return
        what = f"transform of '{child}' in '{parent}'"
        if not parent or not child:
            raise InputError(f'{what}: an empty name; expected two frames')
        if len(transforms) >= MOST_FRAMES and child not in transforms:
            raise InputError(f'{what}: more than {MOST_FRAMES} frames; expected fewer')
        if child in _ancestors(transforms, parent):
            raise InputError(f'{what}: a cycle; expected a tree of frames')
        # A static transform is valid for ever.
        now = self._now()
        stamp = None if static else nanoseconds(stated.header.stamp) or now
        previous = transforms.get(child)
        # Messages may arrive in another order, unless the clock has jumped back.
        if (stamp is not None and previous is not None and previous.stamp is not None
                and stamp < previous.stamp and now >= previous.received):
            return
        transforms[child] = _Transform(parent, _pose(what, stated.transform), stamp, now)

    def frame(self, name: str) -> Frame:
        """
        Return a frame as one that is fixed to a body of the model, or to the world.

        Raises
        ------
        InputError
            The frame is unknown, its transforms do not lead to the model, or they are
            stale.

        """
        known = self._frames.get(name)
        if known is not None:
            return known
        transforms = self._transforms
        at, pose = self._above(transforms, name)
        if at in self._frames:
            return _placed(name, self._frames[at], pose)
        # Not below a frame of the model, but maybe beside or above one, as a map is.
        for below in sorted(transforms.keys() & self._frames.keys()):
            root, pose_of_body = self._above(transforms, below)
            if root == at:
                return _placed(name, self._frames[below],
                               np.linalg.inv(pose_of_body) @ pose)
        known_to_tf = ''
        if name in transforms:
            known_to_tf = f", whose transforms end at '{at}'"
        raise InputError(f"frame '{name}'{known_to_tf}; expected a frame of the model, or one "
                         'that transforms of /tf and /tf_static connect with one: '
                         f'{", ".join(sorted(self._frames))}')

    def _above(self, transforms: Mapping[str, _Transform],
               name: str) -> tuple[str, Array]:
        """Return the first frame of the model above a frame, else the root, and the pose in it."""
        # From frame to frame toward the root, up to one that the model has.
        pose = np.eye(4)
        at = name
        while at in transforms and (at == name or at not in self._frames):
            transform = transforms[at]
            self._require_fresh(name, at, transform)
            pose = transform.pose @ pose
            at = transform.parent
        return at, pose

    def _require_fresh(self, name: str, at: str, transform: _Transform) -> None:
        """Raise InputError if a transform on the way from a frame is stale."""
        if transform.stamp is None:
            return
        age = (self._now() - transform.stamp) / NANO
        if age > self.timeout:
            raise InputError(
                f"frame '{name}': the transform of '{at}' in '{transform.parent}' is {age:.3g} s "
                f'old; expected at most {self.timeout:g} s, or a static one')


def _ancestors(transforms: Mapping[str, _Transform], name: str) -> list[str]:
    """Return a frame and those above it; the transforms have no cycle."""
    names = [name]
    while names[-1] in transforms:
        names.append(transforms[names[-1]].parent)
    return names


def _pose(what: str, transform: Any) -> Array:
    """Return the pose (4, 4) of a transform; InputError if it is none."""
    p, r = transform.translation, transform.rotation
    numbers = np.array([p.x, p.y, p.z, r.x, r.y, r.z, r.w])
    length = math.hypot(*numbers[3:])
    if not np.isfinite(numbers).all() or not abs(length - 1.0) <= QUATERNION:
        raise InputError(f'{what}: {numbers.tolist()}; expected finite numbers, and a '
                         'quaternion of length 1')
    pose = np.eye(4)
    pose[:3, :3] = rotation_matrix(numbers[3:])
    pose[:3, 3] = numbers[:3]
    return pose


def _placed(name: str, carrier: Frame, pose: Array) -> Frame:
    """Return the frame that has a pose (4, 4) in another one."""
    rotation = carrier.rotation @ pose[:3, :3]
    translation = carrier.translation + carrier.rotation @ pose[:3, 3]
    return Frame(name, carrier.body, rotation, translation)
