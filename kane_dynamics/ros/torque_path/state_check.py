"""
Judge joint states by what the arm can do: its limits, and its last state.

A state is impossible if it is not finite, if a joint lies far outside its position
limits, is faster than it can be, or is farther from its last accepted position than it
can have moved since then. One native call compares all joints; the reason is found only
for a state that is refused.
"""

from collections.abc import Mapping, Sequence
import math
from typing import Any

from kane_dynamics._util.typing import Scalar, Vector
from kane_dynamics.control.terms import Mode
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.algebra.dual import select
from kane_dynamics.mechanics.algebra.flags import flag
from kane_dynamics.mechanics.algebra.vector import is_zero
from kane_dynamics.native.runtime.kernel import Kernel
from kane_dynamics.robot.robot import Robot
from kane_dynamics.ros.common.conversion import Array, NANO
from kane_dynamics.ros.parameters.parameter_checks import per_joint
from kane_dynamics.ros.torque_path.joint_state_reader import NOT_FINITE
import numpy as np

JUMP, TOO_FAST, OUTSIDE = (
    'position jumped', 'velocity beyond its limit', 'position beyond its limits')
FAULTS = None, NOT_FINITE, OUTSIDE, TOO_FAST, JUMP  # in the order in which they are named
FIRST = 'first state'  # no fault: it is compared with the next one
UNLIMITED = float(np.finfo(np.float64).max)  # stands for an infinite bound
ROUNDING = 1e-9  # rad or m
WHOLE_TURN = 2.0 * math.pi


class StateCheck:
    """
    Compares each joint state with the limits and with the last accepted state.

    The first state after `forget` is compared with the next one: a command follows only
    from two states that agree, so that a false first state is not answered. A first
    state older than the timeout confirms no other: meanwhile the arm can have moved
    anywhere.

    Parameters
    ----------
    robot : Robot
        Its joint limits are used; joints without a limit are not compared with it.
    joints : sequence of n str
        The joints that are measured.
    state : (2 n,) array
        Positions and velocities of the state to judge, rad or m and s; overwritten by
        the caller.
    values : mapping
        The node's parameters; state_check.*, state_timeout and limits.velocity are used.

    Attributes
    ----------
    accepted : (2 n,) array
        The last accepted state.
    detail : str
        Details of the last reason.
    bounds : (5, n) array
        Lower and upper positions, speeds, and the largest change of a position as slope
        and constant.
    turns : bool
        Whether joints without limits may jump by whole turns.
    turning : (n,) array of bool
        The joints without limits.
    compares : bool
        Whether a first state needs a second one that agrees.

    """

    def __init__(self, robot: Robot, joints: Sequence[str], state: Array,
                 values: Mapping[str, Any]) -> None:
        self._robot = robot
        self._joints = tuple(joints)
        self._places = [robot.coordinate_names.index(name) for name in joints]
        count = len(self._joints)
        self._state = state
        self.accepted = np.zeros(2 * count)
        # The byte views are copied several times as fast as the arrays.
        self._from = memoryview(state).cast('B')
        self._to = memoryview(self.accepted).cast('B')
        self.bounds = np.zeros((5, count))
        self._elapsed = np.zeros(())
        # Continuous joints, whose angle a driver may publish between -pi and pi.
        lower = robot.limits.lower[self._places]
        upper = robot.limits.upper[self._places]
        sliding = [name in robot.model.sliding for name in joints]
        self.turning = np.isinf(lower) & np.isinf(upper) & ~np.array(sliding, dtype=bool)
        self._turned = np.zeros(count)
        self._fault_of_state = np.zeros(1)
        self._judge = state_kernel(robot, self.turning).bind(
            [state, self.accepted, self.bounds.ravel(), self._turned, self._elapsed],
            self._fault_of_state, 'Judge a joint state.')
        self.detail = ''
        self.update(values)
        self.forget()

    def update(self, values: Mapping[str, Any]) -> None:
        """Use checked parameters from the next state on."""
        limits = self._robot.limits
        places = self._places
        margin = values['state_check.position_margin']
        factor = values['state_check.speed_factor']
        noise = values['state_check.noise']
        jitter = values['state_check.jitter']
        fastest = factor * speed_limits(self._robot, values)[places]
        self.turns = not Mode(values['mode']).is_stiff
        limited = np.isfinite(fastest)
        slope = np.where(limited, fastest, 0.0)
        step = np.where(limited, noise + jitter * slope, UNLIMITED)
        margin += ROUNDING
        lower = limits.lower[places] - margin
        upper = limits.upper[places] + margin
        self._turned[:] = self.turning * self.turns
        self.bounds[:] = np.clip([lower, upper, fastest, slope, step], -UNLIMITED,
                                 UNLIMITED)
        self.compares = bool(limited.any())
        self._grace = round(values['state_check.grace'] * NANO)
        self._timeout = round(values['state_timeout'] * NANO)

    def forget(self) -> None:
        """Compare the next state with no earlier one."""
        self._stamp = self._latest = 0
        self._confirmed = False

    def freeze(self) -> None:
        """
        Compare states as if no more than the grace time had passed.

        This ends with the next accepted state.

        A fault that lasts must not become possible because time passes.
        """
        self._latest = self._stamp + self._grace

    def expect(self, positions: Array) -> None:
        """Compare the next states with a state at rest at these positions, (n,)."""
        q, u = np.split(self.accepted, 2)
        q[:] = positions
        u[:] = 0.0

    @property
    def stamp(self) -> int:
        """Return the stamp of the last accepted state, ns."""
        return self._stamp

    @property
    def speeds(self) -> Array:
        """Return a copy of the speeds of the last accepted state, (n,)."""
        _, u = np.split(self.accepted, 2)
        return u.copy()

    @property
    def known(self) -> bool:
        """Return whether there is an accepted state."""
        return self._confirmed

    def reason(self, stamp: int) -> str | None:
        """
        Return why the state with this stamp, ns, is refused.

        The result is None if it is possible.
        """
        confirms = self._confirmed or stamp - self._stamp <= self._timeout
        if not self._stamp or not confirms:
            return self._first(stamp)
        # After `freeze` no more than the grace time counts.
        compared = min(stamp, self._latest) if self._latest else stamp
        self._elapsed[()] = max(compared - self._stamp, 0) / NANO
        reason = self._reason()
        if reason is None:
            self._confirmed = True
        elif not self._confirmed and reason is JUMP:
            # One of the two is false: compare the next one with this one
            self.accept(stamp)
        return reason

    def accept(self, stamp: int) -> None:
        """Keep the state as the last accepted one."""
        self._to[:] = self._from
        self._stamp = stamp
        self._latest = 0

    def mirror(self, accepted: Array, known: bool) -> None:
        """Use the last accepted state of another judge."""
        self.accepted[:] = accepted
        self._confirmed = known

    def explain(self, elapsed: float, jumped: bool) -> tuple[str, str]:
        """
        Return the reason and the details for which another judge refused the state.

        `elapsed` is the time since the last accepted state, s.
        """
        self._elapsed[()] = elapsed
        reason = self._reason()
        if reason is None:  # the last accepted state was not reported
            return (JUMP if jumped else OUTSIDE), 'compared with an unknown state'
        return reason, self.detail

    def _first(self, stamp: int) -> str | None:
        """Judge a state without an earlier one."""
        self._to[:] = self._from
        self._elapsed[()] = 0.0
        reason = self._reason()
        if reason is not None:
            return reason
        self.accept(stamp)
        self._confirmed = not self.compares
        return None if self._confirmed else FIRST

    def _reason(self) -> str | None:
        """Return why the last state is impossible; None if it is possible."""
        try:
            self._judge()
        except InputError:  # not finite
            self._fault_of_state[0] = FAULTS.index(NOT_FINITE)
        fault = FAULTS[int(self._fault_of_state[0])]
        if fault is not None:
            self.detail = self._explained(fault)
        return fault

    def _explained(self, fault: str) -> str:
        """Return the details of a fault of the last state."""
        q, u = np.split(self._state, 2)
        lower, upper, fastest, slope, step = self.bounds
        if fault is NOT_FINITE:
            finite = np.isfinite(q) & np.isfinite(u)
            return ', '.join(np.compress(~finite, self._joints))
        if fault is OUTSIDE:
            j = int(np.argmax(np.maximum(lower - q, q - upper)))
            limits = self._robot.limits
            place = self._places[j]
            return (f"'{self._joints[j]}' at {q[j]:.6g} rad or m; expected "
                    f'{lower[j]:.4g} to {upper[j]:.4g}, its limits with '
                    'state_check.position_margin'
                    + looks_like_degrees(float(q[j]), float(limits.lower[place]),
                                         float(limits.upper[place])))
        if fault is TOO_FAST:
            j = int(np.argmax(np.abs(u) / fastest))
            return (f"'{self._joints[j]}' at {u[j]:.6g} rad/s or m/s; expected at most "
                    f'{fastest[j]:.4g}, its limit times state_check.speed_factor')
        moved = q - self.accepted[:len(q)]
        # A driver may publish the angle of such a joint between -pi and pi.
        wrapped = np.remainder(moved + math.pi, WHOLE_TURN) - math.pi
        moved = np.where(self._turned > 0.0, wrapped, moved)
        allowed = step + slope * self._elapsed
        j = int(np.argmax(np.abs(moved) / allowed))
        return (f"'{self._joints[j]}' moved by {moved[j]:.4g} rad or m in "
                f'{float(self._elapsed):.4f} s; expected at most {allowed[j]:.4g}, as '
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


def state_fault(state: Vector, last: Vector, bounds: Vector, turned: Vector,
                elapsed: Scalar) -> Scalar:
    """
    Return the index in `FAULTS` of the first fault of a finite state, over any scalar.

    Parameters
    ----------
    state, last : (2 n,) arrays
        Positions and velocities of the state, and of the last accepted one.
    bounds : (5 n,) array
        Lower and upper positions, speeds, and the largest change of a position as slope
        and constant.
    turned : (n,) array
        1 for joints that may jump by whole turns, else 0.
    elapsed : Scalar
        Time between both states, s.

    """
    n = len(last) // 2
    lower, upper, fastest, slope, step = np.split(bounds, 5)
    inside: Scalar = 1.0
    slow: Scalar = 1.0
    near: Scalar = 1.0
    for j in range(n):
        position = state[j]
        speed = state[n + j]
        moved = position - last[j]
        change = step[j] + slope[j] * elapsed
        inside = select(between(lower[j], position, upper[j]) > 0.5, inside, 0.0)
        slow = select(between(-fastest[j], speed, fastest[j]) > 0.5, slow, 0.0)
        # Modulo whole turns two angles are as near as their cosine says.
        widest = select(change < math.pi, change, math.pi)
        straight = between(-change, moved, change)
        if not is_zero(turned[j]):
            on_circle = turned[j] * flag(np.cos(widest) < np.cos(moved))
            straight = select(straight > 0.5, 1.0, on_circle)
        near = select(straight > 0.5, near, 0.0)
    fault = select(near > 0.5, 0.0, float(FAULTS.index(JUMP)))
    fault = select(slow > 0.5, fault, float(FAULTS.index(TOO_FAST)))
    return select(inside > 0.5, fault, float(FAULTS.index(OUTSIDE)))


def between(low: Scalar, x: Scalar, high: Scalar) -> Scalar:
    """Return 1 if a number lies between two others, else 0."""
    return select(low < x, flag(x < high), 0.0)


def state_kernel(robot: Robot, turning: Array) -> Kernel:
    """Return the kernel of `state_fault`, (1,); some of its joints may turn, (n,)."""
    count = len(turning)

    def judged(state: Vector, last: Vector, bounds: Vector, turned: Vector,
               elapsed: Scalar) -> list[Scalar]:
        # Joints that have limits need no comparison on the circle.
        can_turn = np.where(turning, turned, 0.0)
        return [state_fault(state, last, bounds, can_turn, elapsed)]
    joints = ''.join(str(int(turns)) for turns in turning)
    return robot.compiled(judged, name=f'state_fault_{joints}', state=(2 * count,),
                          last=(2 * count,), bounds=(5 * count,), turned=(count,),
                          elapsed=(), shape=(1,))
