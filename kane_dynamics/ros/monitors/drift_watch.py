"""Warn of an arm that leaves its motion, or its place without one."""

from collections.abc import Callable, Sequence
import math
from typing import Any

from kane_dynamics.control.terms import Mode
from kane_dynamics.control_cycle.cycle import turning_joints
from kane_dynamics.ros.common.conversion import Array
from kane_dynamics.ros.common.service_errors import reported
from kane_dynamics.ros.torque_path.state_check import WHOLE_TURN
from kane_dynamics.ros.torque_path.torque_path import TorquePath
from rclpy.clock import Clock, ClockType
from rclpy.node import Node

PERIOD = 1.0  # s between two looks at the arm
ANGLE, LENGTH = 0.2, 0.05  # rad and m: no sound arm is so far from its motion
# What to look at, in the modes that follow a motion; others yield by intention.
EXPECTED = {
    Mode.INVERSE_DYNAMICS: 'expected a position loop of the arm, or mode '
    'computed_torque, because this mode has no feedback; and payload, friction and '
    'arm_compensates of this arm',
    Mode.COMPUTED_TORQUE: 'expected payload, friction and arm_compensates of this arm, '
    'or larger gains'}


class DriftWatch:
    """
    Compares the measured positions with the motion that the arm is to follow.

    Without a motion they are compared with where the arm was when it had none first.

    Parameters
    ----------
    node : Node
    path : TorquePath
    names : sequence of str
        The joints with motors.
    now : callable
        The node's clock, ns.
    has_listeners : callable
        Returns whether anything subscribes to the commands.
    log : rclpy logger

    Attributes
    ----------
    warning : str
        Which joint is how far off, and what to look at; empty if none is.

    """

    def __init__(self, node: Node, path: TorquePath, names: Sequence[str],
                 now: Callable[[], int], has_listeners: Callable[[], bool],
                 log: Any) -> None:
        self._node = node
        self._path = path
        self._now = now
        self._has_listeners = has_listeners
        self._log = log
        robot = path.controller.robot
        self._places = {name: robot.coordinate_names.index(name) for name in names}
        self._sliding = robot.model.sliding
        self._turning = dict(zip(names, turning_joints(robot, names), strict=True))
        self._generation = -1  # of the motions, which every activation changes
        self._mode: Mode | None = None
        self._place: Array | None = None  # of all joints, since there is no motion
        self.warning = ''
        # In steady time: a simulated clock that stands must not stop the watch.
        self._timer = node.create_timer(PERIOD, reported(self._examine, log),
                                        clock=Clock(clock_type=ClockType.STEADY_TIME))

    def close(self) -> None:
        """Stop looking."""
        self._node.destroy_timer(self._timer)

    def _examine(self) -> None:
        """Warn of the joint that is farthest off, if one is too far."""
        generation = self._path.active_motion.generation
        mode = self._path.controller.mode
        if generation != self._generation or mode != self._mode:
            self._generation = generation
            self._mode = mode
            self._place = None
        warning = ''
        q = self._path.measured()
        if q is None or mode not in EXPECTED or not self._has_listeners():
            self._place = None
        else:
            warning = self._words(mode, q)
        if warning and not self.warning:
            self._log.warning(warning)
        self.warning = warning

    def _words(self, mode: Mode, q: Array) -> str:
        """Return the warning of measured positions, (n_q,); empty without one."""
        motion, moment = self._path.active_motion.at(self._now())
        if motion is None:
            if self._place is None:
                self._place = q
            reference = self._place
            deviation = 'from where it was, without a motion; if nothing else moves it'
        else:
            self._place = None
            reference = q.copy()
            desired = motion.sample(moment)[0]
            for name, position in zip(motion.joint_names, desired):
                if name in self._places:
                    reference[self._places[name]] = position
            deviation = 'from its motion'
        # The joint with the largest share of what is too far for its kind.
        distances = {}
        shares = {}
        for name, place in self._places.items():
            distance = float(q[place] - reference[place])
            # A driver may publish the angle of such a joint between -pi and pi.
            if self._turning[name]:
                distance = math.remainder(distance, WHOLE_TURN)
            bound = LENGTH if name in self._sliding else ANGLE
            distances[name] = distance
            shares[name] = abs(distance) / bound
        worst = max(shares, key=shares.__getitem__)
        if shares[worst] <= 1.0:
            return ''
        unit = 'm' if worst in self._sliding else 'rad'
        return (f"{mode}: joint '{worst}' is {distances[worst]:.2g} {unit} {deviation}: "
                f'{EXPECTED[mode]}')
