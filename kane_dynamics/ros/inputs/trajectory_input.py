"""Schedule joint trajectories as desired motions."""

from collections.abc import Callable, Mapping
import math
from typing import Any, NamedTuple

from kane_dynamics.control.elastic_control import derivatives_of
from kane_dynamics.control.terms import Mode
from kane_dynamics.errors import InputError
from kane_dynamics.motion.motion import Motion
from kane_dynamics.motion.smooth_motion import require_smooth
from kane_dynamics.ros.common.conversion import (Array, motion_from_message, NANO,
                                                 nanoseconds, read_message)
from kane_dynamics.ros.torque_path.torque_path import TorquePath
import numpy as np
from trajectory_msgs.msg import JointTrajectory


# S by which a motion begins before or after its reception, beyond which that is said:
# more than a message takes, or a client plans ahead.
NOTED = 0.5
Refusal = Callable[[Motion, Array | None, float, Array | None], None]
JUDGED = NANO // 20  # ns: a check of a motion that takes longer is repeated


class PastMotionError(InputError):
    """A motion ended in the past."""


def follow_trajectory(path: TorquePath, data: bytes, received: int,
                      values: Mapping[str, Any], refuse: Refusal) -> str:
    """
    Make the torque path follow a serialized JointTrajectory.

    An empty one ends the motion.

    If the first point is later than 0, the motion begins at the desired state at its
    start time: that of the previous motion, the held pose, or the last measured state.

    Parameters
    ----------
    path : TorquePath
        The running torque path.
    data : bytes
        The serialized message.
    received : int
        System time of reception, ns; 0 if unknown.
    values : mapping
        The node's parameters.
    refuse : callable
        Called with the motion, the place of its joints when it begins, (n,) rad or m or
        None, the time of the motion then, s, and the desired speeds until then, (n,) or
        None; raises KaneError if the arm cannot move like that.

    Returns
    -------
    str
        What the message does, where it is no motion that begins now; else empty.

    Raises
    ------
    InputError
        The message is invalid, the arm cannot move like that, or no motion can be
        followed now.

    """
    active_motion = path.active_motion
    now = path.now
    generation = active_motion.generation
    # A message that was under way while the motion was cleared belongs to the past.
    if 0 < received < active_motion.cleared_at:
        raise InputError('joint_trajectory: received before the node was activated, '
                         'ended its motion, timed out, or changed clock or mode; '
                         'expected a later one')
    message = read_message(data, JointTrajectory)
    if not message.points:
        active_motion.clear('a trajectory without points on ~/joint_trajectory')
        return 'no points; the desired motion ends'
    _, start = schedule_motion(path, message, now, generation, values, refuse)
    return start_in_words(start, path.now)


def start_in_words(start: int, now: int) -> str:
    """
    Return when a motion begins, in words; empty if it is about now.

    A stamp far from now is valid, but mostly one of another clock.

    Parameters
    ----------
    start, now : int
        Start of the motion and time of its reception, ns.

    """
    ahead = (start - now) / NANO
    if ahead > NOTED:
        return (f'begins in {ahead:.1f} s, by its stamp; what is followed now goes on '
                'until then')
    if ahead < -NOTED:
        return (f'began {-ahead:.1f} s ago, by its stamp; followed from that time of the '
                'motion on')
    return ''


def schedule_motion(path: TorquePath, message: JointTrajectory, now: int,
                    generation: int, values: Mapping[str, Any],
                    refuse: Refusal) -> tuple[Motion, int]:
    """
    Make the torque path follow a trajectory; return the motion and its start, ns.

    Parameters
    ----------
    path : TorquePath
        The running torque path.
    message : JointTrajectory
        The trajectory.
    now, generation : int
        Node's clock, ns, and `generation` of the active motion, when the message was
        read.
    values : mapping
        The node's parameters.
    refuse : callable
        As for `follow_trajectory`.

    Raises
    ------
    JointNamesError
        The message lacks a joint, or names one twice.
    PastMotionError
        The motion ended in the past.
    InputError
        The message is invalid otherwise, the arm cannot move like that, or no motion can
        be followed now.

    """
    # What refuses any motion at present.
    if not path.controller.mode.follows_motions:
        raise InputError(f'mode: {path.controller.mode}; expected a mode that follows '
                         'motions')
    path.catch_up()
    if path.timed_out:
        raise InputError(f'joint states: none for {path.state_age:.3f} s; expected one '
                         'within state_timeout')
    if path.fault:
        raise InputError(f'joint states: {path.fault}; expected possible ones')
    if not now:
        raise InputError('use_sim_time: true without a message on /clock; expected '
                         'simulated time')
    judged = _judged(path, message, now, values, refuse)
    if path.now > judged.entry + JUDGED:
        # The check took long, as while kernels are compiled: the arm would jump to where
        # the motion is by now.
        now = path.now
        judged = _judged(path, message, now, values, refuse)
    motion, start, entry = judged
    if path.controller.mode == Mode.MOTOR_SIDE:
        moment = (entry - start) / NANO
        _require_smooth_entry(path, motion, moment, entry)
    if not path.active_motion.follow(motion, start, now, generation):
        raise InputError('joint_trajectory: received while the node was stopped, ended '
                         'its motion, timed out, or changed clock or mode; expected a '
                         'later one')
    return motion, start


class _JudgedMotion(NamedTuple):
    """A motion that the arm can make, its start, and when it is followed first, both ns."""

    motion: Motion
    start: int
    entry: int


def _judged(path: TorquePath, message: JointTrajectory, now: int,
            values: Mapping[str, Any], refuse: Refusal) -> _JudgedMotion:
    """Return the motion of a message for a time `now`, ns; raise as `schedule_motion`."""
    # A stamp of zero begins on receipt; later ones are in the future or in progress.
    start = nanoseconds(message.header.stamp) or now
    entry = max(now, start)
    motion = motion_from_message(message, path.controller.followed,
                                 values['trajectory.max_points'], path.desired(start))
    if start != now and start + motion.duration * NANO < now:
        raise PastMotionError('end of the motion: '
                              f'{(now - start) / NANO - motion.duration:.3f} s ago; '
                              'expected a time in the future')
    # Where the motion sets out from: the state that is desired when it begins to act.
    place = path.desired(entry)
    if place is None and values['trajectory.start_tolerance'] < math.inf:
        raise InputError('joint states: none yet; expected one, from which the motion '
                         'sets out')
    departure = (None, None) if place is None else place[:2]
    refuse(motion, departure[0], (entry - start) / NANO, departure[1])
    return _JudgedMotion(motion, start, entry)


def _require_smooth_entry(path: TorquePath, motion: Motion, moment: float,
                          entry: int) -> None:
    """
    Raise InputError if speed, acceleration or jerk jump in a motion or on the way into it.

    `moment` is the time of the motion, s, at which it is followed first, and `entry` that
    of the node's clock, ns.
    """
    # The motion that is followed until then, or a held pose.
    last, last_moment = path.active_motion.at(entry)
    before = None
    if last is not None:
        before = derivatives_of(last, np.array([last_moment]))[0, 1:4]
    require_smooth(motion, moment, before)
