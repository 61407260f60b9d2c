"""
The settings by which joint states are judged, and why a state was refused.

The rule is `state_judgement.judged`. Details are found only for a state that is refused.
"""

from collections.abc import Mapping, Sequence
import math
from typing import Any

from kane_dynamics.control.terms import Mode
from kane_dynamics.control_cycle.cycle import turning_joints
from kane_dynamics.control_cycle.cycle_results import NOT_FINITE, OUTSIDE, TOO_FAST
from kane_dynamics.control_cycle.state_judgement import (state_fault, StateMemory,
                                                         UNLIMITED)
from kane_dynamics.native.backends.llvm_math import POSITION_LIMIT
from kane_dynamics.robot.robot import Robot
from kane_dynamics.ros.common.conversion import Array, NANO
from kane_dynamics.ros.parameters.parameter_checks import per_joint
import numpy as np

ROUNDING = 1e-9  # rad or m
WHOLE_TURN = 2.0 * math.pi


class StateCheck:
    """
    The settings by which joint states are judged, and why states are refused.

    Parameters
    ----------
    robot : Robot
        Its joint limits are used; joints without a limit are not compared with it.
    joints : sequence of n str
        The joints that are measured.
    state : (2 n,) array
        Positions and velocities of the state that is judged, rad or m and s; overwritten
        by the caller.
    values : mapping
        The node's parameters; state_check.*, state_timeout and limits.velocity are used.

    Attributes
    ----------
    bounds : (5, n) array
        Lower and upper positions, speeds, and the largest change of a position as slope
        and constant.
    turned : (n,) array
        1 for joints without limits if they may jump by whole turns, else 0.
    compares : bool
        Whether a first state needs a second one that agrees.
    compares_speeds : bool
        Whether speeds are compared with positions: gravity compensation uses none, and
        takes states without.
    timeout, grace : int
        Age of the last state after which the path times out, and how long states are
        refused before it gives up, ns.
    holds : bool
        Whether the arm is then brought to rest and held, or has no torque.
    stop_time : float
        In which time it comes to rest, s.

    """

    def __init__(self, robot: Robot, joints: Sequence[str], state: Array,
                 values: Mapping[str, Any]) -> None:
        self._robot = robot
        self._joints = tuple(joints)
        self._places = list(map(robot.coordinate_names.index, joints))
        self._state = state
        self._turning = turning_joints(robot, joints)
        self.turned = np.zeros(len(self._joints))
        self.bounds = np.zeros((5, len(self._joints)))
        self.update(values)

    def update(self, values: Mapping[str, Any]) -> None:
        """Use checked parameters from the next state on."""
        self.timeout = round(values['state_timeout'] * NANO)
        self.grace = round(values['state_check.grace'] * NANO)
        self.holds = values['state_check.action'] == 'hold'
        self.stop_time = float(values['state_check.stop_time'])
        limits = self._robot.limits
        places = self._places
        margin = values['state_check.position_margin']
        factor = values['state_check.speed_factor']
        noise = values['state_check.noise']
        jitter = values['state_check.jitter']
        fastest = factor * speed_limits(self._robot, values)[places]
        may_turn = not Mode(values['mode']).is_stiff
        # Joints without a limit of speed are not compared with the last state.
        limited = np.isfinite(fastest)
        slope = np.where(limited, fastest, 0.0)
        step = np.where(limited, noise + jitter * slope, UNLIMITED)
        margin += ROUNDING
        # Compiled laws are not defined beyond.
        lower = np.maximum(limits.lower[places] - margin, -POSITION_LIMIT)
        upper = np.minimum(limits.upper[places] + margin, POSITION_LIMIT)
        # A joint without limits may have turned by whole turns between two states.
        self.turned[:] = self._turning * may_turn
        self.bounds[:] = np.clip([lower, upper, fastest, slope, step], -UNLIMITED,
                                 UNLIMITED)
        self.compares = bool(limited.any())
        self.compares_speeds = Mode(values['mode']) is not Mode.GRAVITY_COMPENSATION

    def finds(self, fault: int, before: StateMemory, after: StateMemory) -> bool:
        """Return whether the limits of now show a fault that a thread has found."""
        if fault == NOT_FINITE:
            return True
        moved, allowed = self._moved(before.accepted, after.elapsed)
        jumped = np.where(np.abs(moved) < allowed, after.jumped, 1.0)
        return int(state_fault(self._state, self.bounds.ravel(), jumped,
                               before.wrong)) == fault

    def _moved(self, accepted: Array, elapsed: float) -> tuple[Array, Array]:
        """Return the distances that joints moved in a time, s, and could have moved, (n,)."""
        n = len(self._joints)
        moved = self._state[:n] - accepted[:n]
        # A driver may publish the angle of such a joint between -pi and pi.
        if self.turned.any():
            wrapped = np.remainder(moved + math.pi, WHOLE_TURN) - math.pi
            moved = np.where(self.turned > 0.0, wrapped, moved)
        _, _, _, slope, step = self.bounds
        return moved, step + slope * elapsed

    def explain(self, fault: int, before: StateMemory, after: StateMemory) -> str:
        """Return the details of a fault of the state, by the memories before and after it."""
        n = len(self._joints)
        q, u = self._state[:n], self._state[n:]
        lower, upper, fastest, _, _ = self.bounds
        # The joint that is furthest off explains the fault.
        if fault == NOT_FINITE:
            finite = np.isfinite(q) & (np.isfinite(u) | np.isnan(u))
            return ', '.join(np.compress(~finite, self._joints))
        if fault == OUTSIDE:
            j = int(np.argmax(np.maximum(lower - q, q - upper)))
            limits = self._robot.limits
            place = self._places[j]
            return (f"'{self._joints[j]}' at {q[j]:.6g} rad or m; expected "
                    f'{lower[j]:.4g} to {upper[j]:.4g}, its limits with '
                    'state_check.position_margin'
                    + looks_like_degrees(float(q[j]), float(limits.lower[place]),
                                         float(limits.upper[place])))
        # Speeds, then distances from the last accepted state.
        if fault == TOO_FAST:
            u = np.where(np.isnan(u), fastest, u)  # derived ones are within the limit
            j = int(np.argmax(np.abs(u) / fastest))
            return (f"'{self._joints[j]}' at {u[j]:.6g} rad/s or m/s; expected at most "
                    f'{fastest[j]:.4g}, its limit times state_check.speed_factor')
        moved, allowed = self._moved(before.accepted, after.elapsed)
        share = np.abs(moved) / allowed
        if share.max() < 1.0:
            j = int(np.argmax(after.jumped * np.abs(moved)))
            return (f"'{self._joints[j]}' still is {moved[j]:.4g} rad or m from its last "
                    'accepted position, after a jump; expected a jump back, or speeds that '
                    'explain the distance')
        # The distance itself is too long for the time.
        j = int(np.argmax(share))
        return (f"'{self._joints[j]}' moved by {moved[j]:.4g} rad or m in "
                f'{after.elapsed:.4f} s; expected at most {allowed[j]:.4g}, as '
                'its speed limit, state_check.speed_factor, jitter and noise allow')


def speed_limits(robot: Robot, values: Mapping[str, Any]) -> Array:
    """
    Return the speed limits of the joints, (n_q,).

    Raise InputError if the parameter does not fit.
    """
    stated = per_joint(values, 'limits.velocity', robot.joint_names, math.inf)
    return np.minimum(robot.limits.velocity, stated)


def looks_like_degrees(value: float, lower: float, upper: float) -> str:
    """Return a hint if a position outside its limits is within them as degrees."""
    if abs(value) <= WHOLE_TURN:
        return ''
    turned = math.radians(value)
    finite = math.isfinite(lower) and math.isfinite(upper)
    within = lower <= turned <= upper if finite else abs(turned) <= WHOLE_TURN
    return f' ({turned:.3g} rad, if these are degrees)' if within else ''
