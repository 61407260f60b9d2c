"""
Judge joint states by what the arm can do: its limits, and its last state.

A state is impossible if it is not finite, if a joint lies far outside its position
limits, is faster than it can be, or is farther from its last accepted position than it
can have moved since then. One native call compares all joints; the reason is found only
for a state that is refused.
"""

from collections.abc import Mapping, Sequence
import math
from typing import Any, NamedTuple

from kane_dynamics._util.typing import Scalar, Vector
from kane_dynamics.control.terms import Mode
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.algebra.dual import select
from kane_dynamics.native.runtime.kernel import Kernel
from kane_dynamics.robot.robot import Robot
from kane_dynamics.ros.common.conversion import Array, NANO
from kane_dynamics.ros.parameters.parameter_checks import per_joint
from kane_dynamics.ros.torque_path.joint_state_reader import NOT_FINITE
import numpy as np

JUMP, TOO_FAST, OUTSIDE = (
    'position jumped', 'velocity beyond its limit', 'position beyond its limits')
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
        self._possible = np.zeros(1)
        self._judge = state_kernel(robot, count).bind(
            [state, self.accepted, self.bounds.ravel(), self._elapsed], self._possible,
            'Judge a joint state.')
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
        # Continuous joints, whose angle a driver may publish between -pi and pi.
        unlimited = np.isinf(limits.lower[places]) & np.isinf(limits.upper[places])
        sliding = [name in self._robot.model.sliding for name in self._joints]
        self.turning = unlimited & ~np.array(sliding, dtype=bool)
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
        if self._is_possible():
            self._confirmed = True
            return None
        reason = self._explain()
        if reason is not None and not self._confirmed and reason is JUMP:
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
        reason = self._explain()
        if reason is None:  # the last accepted state was not reported
            return (JUMP if jumped else OUTSIDE), 'compared with an unknown state'
        return reason, self.detail

    def _first(self, stamp: int) -> str | None:
        """Judge a state without an earlier one."""
        self._to[:] = self._from
        self._elapsed[()] = 0.0
        if not self._is_possible():
            return self._explain()
        self.accept(stamp)
        self._confirmed = not self.compares
        return None if self._confirmed else FIRST

    def _is_possible(self) -> bool:
        """Return whether the state is finite and within its bounds."""
        try:
            self._judge()
        except InputError:  # not finite
            return False
        return bool(self._possible[0])

    def _explain(self) -> str | None:
        """
        Return the reason why the last state is impossible, with details.

        The result is None if it is possible.
        """
        q, u = np.split(self._state, 2)
        lower, upper, fastest, slope, step = self.bounds

        # In the order of the kernel: finite, positions, speeds, then the change since
        # the last state.
        finite = np.isfinite(q) & np.isfinite(u)
        if not finite.all():
            self.detail = ', '.join(np.compress(~finite, self._joints))
            return NOT_FINITE
        outside = np.maximum(lower - q, q - upper)
        if not (outside < 0.0).all():
            j = int(np.argmax(outside))
            limits = self._robot.limits
            place = self._places[j]
            self.detail = (f"'{self._joints[j]}' at {q[j]:.6g} rad or m; expected "
                           f'{lower[j]:.4g} to {upper[j]:.4g}, its limits with '
                           'state_check.position_margin'
                           + looks_like_degrees(float(q[j]), float(limits.lower[place]),
                                                float(limits.upper[place])))
            return OUTSIDE
        if not (np.abs(u) < fastest).all():
            j = int(np.argmax(np.abs(u) / fastest))
            self.detail = (f"'{self._joints[j]}' at {u[j]:.6g} rad/s or m/s; expected "
                           f'at most {fastest[j]:.4g}, its limit times '
                           'state_check.speed_factor')
            return TOO_FAST
        moved = q - self.accepted[:len(q)]
        # A driver may publish the angle of such a joint between -pi and pi
        if self.turns:
            moved = np.where(self.turning, np.remainder(moved + math.pi,
                                                        WHOLE_TURN) - math.pi,
                             moved)
        allowed = step + slope * self._elapsed
        if (np.abs(moved) < allowed).all():
            self._confirmed = True
            return None
        j = int(np.argmax(np.abs(moved) / allowed))
        self.detail = (f"'{self._joints[j]}' moved by {moved[j]:.4g} rad or m in "
                       f'{float(self._elapsed):.4f} s; expected at most '
                       f'{allowed[j]:.4g}, as its speed limit, '
                       'state_check.speed_factor, jitter and noise allow')
        return JUMP


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


class JointBounds(NamedTuple):
    """Position limits, largest speed and largest change of the position of a joint."""

    lower: Scalar
    upper: Scalar
    fastest: Scalar
    change: Scalar


def joint_bounds(bounds: Vector, n: int, j: int, elapsed: Scalar) -> JointBounds:
    """
    Return the bounds of joint j for the time since the last state, s.

    `bounds`, (5 n,), are lower and upper positions, speeds, and the largest change of a
    position as slope and constant.
    """
    lower, upper, fastest, slope, step = np.split(bounds, 5)
    return JointBounds(lower[j], upper[j], fastest[j], step[j] + slope[j] * elapsed)


def state_kernel(robot: Robot, count: int) -> Kernel:
    """
    Return the kernel that judges a state: 1 if every joint is within its bounds, else 0.

    Its arguments are positions and velocities of the state and of the last one, (2 n,)
    each; the bounds, (5 n,): lower and upper positions, speeds, and the largest change
    of a position as slope and constant; and the time between the states, s.
    """
    def judged(state: Any, last: Any, bounds: Any, elapsed: Any) -> Any:
        possible: Any = 1.0
        for j in range(count):
            bound = joint_bounds(bounds, count, j, elapsed)
            position = state[j]
            speed = state[count + j]
            moved = position - last[j]
            # NaN fails every comparison, so that it is impossible as well.
            for small, large in ((bound.lower, position), (position, bound.upper),
                                 (-bound.fastest, speed), (speed, bound.fastest),
                                 (-bound.change, moved), (moved, bound.change)):
                possible = select(small < large, possible, 0.0)
        return [possible]
    return robot.compiled(judged, name=f'state_check_{count}', state=(2 * count,),
                          last=(2 * count,), bounds=(5 * count,), elapsed=(), shape=(1,))
