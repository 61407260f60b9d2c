"""
Coupling of two arms, as of a leader that is led by hand and a follower that works.

Each side holds its joints c to those of its partner p by a spring and a damper, and adds
the external torque that the partner feels (four channels: positions and torques, both
ways), beside the compensation of its own gravity and friction:

    force = K (s q_p + o - q_c) + D (s q'_p - q'_c) + f e_p / s

with the scale s, an offset o, and the reflection f. At rest, with e the torques of hand
and environment and equal stiffness, the sums of both sides give e_hand = -e_environment
for every f, and K (q_leader - q_follower) = (1 - f) e_hand. For f = 1 and equal arms
both accelerations are the same, so that the springs are not stretched by motion either.
For f = 0 the coupling is passive, apart from delay and different friction. Source of
four channels: D. A. Lawrence, "Stability and transparency in bilateral teleoperation",
IEEE Trans. Robotics and Automation 9(5), 1993.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import deepcopy
from dataclasses import replace
import math
from typing import Any, Literal, NamedTuple

from kane_dynamics._util.checks import finite_row, instance, number, per_joint
from kane_dynamics._util.fixed_attributes import guarded_class
from kane_dynamics._util.typing import Array, Scalar, Vector
from kane_dynamics.control.computed_torque import followed_joints
from kane_dynamics.control.terms import EVERY_TERM, Terms
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.algebra.dual import magnitude, select
from kane_dynamics.mechanics.ball_joints import require_angles
from kane_dynamics.robot.robot import Robot
from kane_dynamics.task_space.joint_impedance import compensated_torques
from kane_dynamics.task_space.law_kernel import (identifier, LanesOf, Law, law_kernel,
                                                 Settings)
from kane_dynamics.task_space.reference_dynamics import compensation_weights, WEIGHTS
import numpy as np
from numpy.typing import ArrayLike

FREE_DAMPING = 0.1  # of the damping, that an arm keeps which is alone and free
# The last entries of the memory: the part of the spring that acts, the part of the
# ramp that is done, and whether the force limit acts.
GRIP, RAMPED, SATURATED = -3, -2, -1


class PartnerState(NamedTuple):
    """
    The state of the other arm, in the order of the joints that are coupled.

    Attributes
    ----------
    t : float
        Time of the state, s, on the clock of `ArmCoupling.torque`.
    q, u : (n,) arrays
        Positions and rates, rad or m, s.
    external : (n,) array
        External torque on it, N m or N, as `MomentumObserver` estimates it.

    """

    t: float
    q: Array
    u: Array
    external: Array


@guarded_class
class ArmCoupling:
    """
    One side of two coupled arms: the torque that makes an arm feel the other.

    Alone, as before `engage` and after the partner is lost, an arm holds its position or
    is free. Neither makes its torque jump, nor does `engage` at any distance: the arms
    then come together at `align_speed`, while they already follow each other's motion.

    Parameters
    ----------
    robot : Robot
        Of this side, without beams and ball joints.
    stiffness, damping : float or (n,) array_like
        K, N m/rad or N/m, and D, N m s/rad or N s/m, of the joints that are coupled. A
        delay between the arms should be shorter than D / K.
    reflection : float
        f, 0 to 1: the part of the partner's external torque that is added.
    scale : float or (n,) array_like
        s: motion of this arm over that of its partner; negative for a mirrored joint.
    force_limit : float or (n,) array_like
        Largest torque of the coupling beyond the compensation of the model, N m or N. It
        keeps its direction.
    speed_limit : float or (n,) array_like, optional
        Largest speed at which the arm follows. Default: the limits of the robot.
    alone : 'hold' or 'free'
        What the arm does without partner; free: only `FREE_DAMPING` of the damping acts
        beside the model.
    timeout : float
        Age of a partner's state above which it is lost, s; also how far a state may be
        ahead of the clock of this arm.
    ramp : float
        Time in which rates and torques of the partner fade in, s, and three times the
        time constant with which they fade out.
    align_speed : float
        Speed at which the distance at engagement vanishes, rad/s or m/s; 0 keeps it.
    compensate : Terms
        The terms of the model that are compensated: gravity, and friction at the rates
        of the partner. Inertia and Coriolis terms never are, as this would add energy.
    followed : sequence of str, optional
        With chosen speeds or constraints: the joints that are coupled, as many as there
        are independent speeds.

    Attributes
    ----------
    engaged : bool
        Whether the arm follows its partner.
    lost : str
        Why the partner was lost last; empty if it was not since `engage`.
    saturated : bool
        Whether `force_limit` acted at the last call.

    Raises
    ------
    InputError
        Names the argument, the joint, the value and what is expected.

    """

    def __init__(self, robot: Robot, *, stiffness: ArrayLike, damping: ArrayLike,
                 reflection: float = 0.8, scale: ArrayLike = 1.0,
                 force_limit: ArrayLike = math.inf,
                 speed_limit: ArrayLike | None = None,
                 alone: Literal['hold', 'free'] = 'hold', timeout: float = 0.1,
                 ramp: float = 0.5, align_speed: float = 0.2,
                 compensate: Terms = EVERY_TERM,
                 followed: Sequence[str] | None = None) -> None:
        """Check the settings and compile the law."""
        instance(robot, Robot, 'robot')
        instance(compensate, Terms, 'compensate')
        require_angles(robot.model, 'ArmCoupling')
        self.robot = robot
        self._places = list(followed_joints(robot, followed))
        self._names = [robot.coordinate_names[k] for k in self._places]
        if alone not in ('hold', 'free'):
            raise InputError(f'alone: {alone!r}; expected hold or free')
        self._timeout = _within('timeout', timeout, 1e-6, math.inf)

        names = self._names
        limits = robot.limits
        speed = np.asarray(limits.velocity, dtype=np.float64)[self._places]
        if speed_limit is not None:
            speed = per_joint(speed_limit, 'speed_limit', names, finite=False)
        # Coriolis forces do no work. Compensated at the partner's rates they would.
        terms = replace(compensate, coriolis=False, inertia=False)
        self._scale = _scales(scale, names)
        # Settings of the law in one row, so that they change without a new kernel.
        n = robot.n
        of_joints = ('stiffness', 'damping', 'scale', 'force_limit', 'speed', 'lower',
                     'upper')
        shapes = dict.fromkeys(of_joints, (n,))
        self._shapes = Settings({**shapes, 'reflection': (), 'ramp': (), 'align_speed': (),
                                 'is_freed': (), 'weights': (len(WEIGHTS),)})
        self._settings = self._shapes.packed({
            'stiffness': per_joint(stiffness, 'stiffness', names),
            'damping': per_joint(damping, 'damping', names), 'scale': self._scale,
            'force_limit': per_joint(force_limit, 'force_limit', names, finite=False),
            'speed': speed, 'lower': np.asarray(limits.lower)[self._places],
            'upper': np.asarray(limits.upper)[self._places],
            'reflection': _within('reflection', reflection, 0.0, 1.0),
            'ramp': _within('ramp', ramp, 1e-6, math.inf),
            'align_speed': _within('align_speed', align_speed, 0.0, math.inf),
            'is_freed': float(alone == 'free'), 'weights': compensation_weights(terms)})
        self.engaged = False
        self.lost = ''
        self._memory = _Memory(n)
        # The partner of an arm that is alone, which the law ignores.
        none = np.zeros(n)
        self._nobody = PartnerState(0.0, none, none, none)
        self._prepare()

    def _prepare(self) -> None:
        """Make what a call writes into, and compile the law for the robot."""
        self._clock = np.zeros(2)
        # Numbers are written to it faster than to the array.
        self._clock_entries: Any = memoryview(self._clock)
        self._law = self._compiled()

    def __getstate__(self) -> dict[str, Any]:
        """Return the attributes of a copy: its own memory, and no compiled function."""
        state = {**self.__dict__, '_memory': deepcopy(self._memory)}
        for name in ('_clock', '_clock_entries', '_law'):
            state.pop(name)
        return state

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore a copy, which goes on where the original is."""
        self.__dict__.update(state)
        self._prepare()

    @property
    def saturated(self) -> bool:
        """Return whether `force_limit` acted at the last call."""
        return bool(self._memory.row[SATURATED])

    def engage(self, q: ArrayLike, partner: PartnerState) -> None:
        """
        Follow the partner from the next call of `torque` on.

        Parameters
        ----------
        q : (n_q,) array_like
            The measured positions of this arm, rad or m.
        partner : PartnerState
            Its state; positions are used.

        Raises
        ------
        InputError
            A number is missing or not finite.

        """
        position = finite_row(q, 'q', self.robot.coordinate_names)[self._places]
        instance(partner, PartnerState, 'partner')
        theirs = finite_row(partner.q, 'q of the partner', self._names)
        memory = self._memory
        # From here on the offset between both arms is kept: neither moves when they
        # engage.
        target, _, _, offset = memory.rows
        if memory.t is None:
            target[:] = position
        # The spring is stretched as far as its present force asks for.
        grip = memory.row[GRIP]
        target[:] = position + grip * (target - position)
        offset[:] = target - self._scale * theirs
        memory.row[GRIP] = 1.0
        memory.row[RAMPED] = 0.0
        self.engaged = True
        self.lost = ''

    def disengage(self, reason: str = '') -> None:
        """Hold, or free, the arm without its partner; `lost` becomes the reason."""
        self.engaged = False
        self.lost = reason

    def restart(self) -> None:
        """Begin again alone, where the arm is at the next state."""
        self._memory.restart()
        self.disengage('this arm: began again')

    def is_usable(self, t: float, partner: PartnerState) -> bool:
        """Return whether a state of the partner is of the time t, within the timeout."""
        return not self._lateness(t, partner)

    def torque(self, t: float, q: ArrayLike, u: ArrayLike,
               partner: PartnerState | None = None) -> Array:
        """
        Return the torques of the joints, (n_q,).

        Parameters
        ----------
        t : float
            Time of the measured state, s, also that of speeds or constraints which depend
            on it. After an interruption of `timeout`, or a step
            back, the arm begins alone where it is.
        q, u : (n_q,), (n,) array_like
            The measured state, rad or m, s.
        partner : PartnerState, optional
            The last state of the partner. The arm disengages when it is too old.

        Raises
        ------
        InputError
            A wrong shape, or a number that is not finite.
        ConstraintError
            The configuration is open or singular.

        """
        if type(t) is not float:
            t = number(t, 't', 'a finite time in s', math.isfinite)
        # Each attribute of a class with hints takes as long to read as ten of these.
        fields = self.__dict__
        memory: _Memory = fields['_memory']
        clock = fields['_clock_entries']
        timeout = fields['_timeout']
        last = memory.t
        # A first call, or one after a pause: the memory begins again at this state.
        if last is not None and 0.0 <= t - last <= timeout:
            clock[0] = t - last
        else:  # also for a time that is not finite
            self._begin(number(t, 't', 'a finite time in s', math.isfinite), q)
            clock[0] = 0.0
        # A partner whose state is missing or late ends the coupling.
        if fields['engaged']:
            if type(partner) is not PartnerState and partner is not None:
                instance(partner, PartnerState, 'partner')
            if partner is None or not -timeout <= t - partner.t <= timeout:
                self.disengage(self._lateness(t, partner))
        if fields['engaged'] and partner is not None:
            clock[1] = 1.0
        else:
            clock[1] = 0.0
            partner = fields['_nobody']
        _, q_p, u_p, external = partner
        law: Callable[..., Array] = fields['_law']
        settings = fields['_settings']
        try:
            torques = law(q, u, q_p, u_p, external, memory.row, fields['_clock'], settings,
                          t)
        except _PartnerFault as error:
            self.disengage(str(error))
            return self.torque(t, q, u)
        # States that are refused do not count: the memory is that of the one before.
        memory.t = t
        return torques

    # The parts of `torque`.

    def _begin(self, t: float, q: ArrayLike) -> None:
        """Begin where the arm is, for the first time or after an interruption."""
        memory = self._memory
        last = memory.t
        position = finite_row(q, 'q', self.robot.coordinate_names)[self._places]
        # After an interruption the partner's motion is unknown: the coupling disengages.
        if last is not None:
            reason = f'no state for {t - last:.3f} s'
            if t < last:
                reason = f'time went back by {last - t:.3f} s'
            self.disengage(f'this arm: {reason}')
            memory.restart()
        if not self.engaged:
            memory.rows[0] = position

    def _lateness(self, t: float, partner: PartnerState | None) -> str:
        """Return why the partner's state is of no use by its time; empty if it is."""
        if partner is None:
            return 'partner: no state'
        age = t - partner.t
        if not age <= self._timeout:
            return f'partner: no state for {age:.3f} s'
        if age < -self._timeout:  # its age is not known: another clock
            return (f'partner: a state {-age:.3f} s ahead; expected its time on the '
                    'clock of this arm')
        return ''

    def _compiled(self) -> Callable[..., Array]:
        """Return the entry point of the law."""
        robot = self.robot
        shapes = self._shapes
        places = self._places
        n = robot.n
        size = len(self._memory.row)

        # Positions, rates and forces of the partner are checked only when the result is
        # not finite.
        def law_of(choice: Robot, _: LanesOf) -> Law:
            return _law(choice, places, shapes)
        inputs = {'q': (robot.n_q,), 'u': (n,), 'q_p': (n,), 'u_p': (n,),
                  'external': (n,), 'memory': (size,), 'clock': (2,),
                  'settings': (shapes.size,)}
        name = identifier('arm_coupling', *map(str, places))
        kernel = law_kernel(robot, law_of, name, inputs, (robot.n_q + size,), places)

        def explained(q: Any, u: Any, *others: Any) -> Array:
            for what, row in zip(PartnerState._fields[1:], others):
                try:
                    finite_row(row, f'partner: {what}', self._names)
                except InputError as error:
                    raise _PartnerFault(str(error)) from None
            result: Array = kernel(q, u, *others)
            return result
        return kernel.entry_with_memory('', 'memory', explained)


class _PartnerFault(Exception):
    """A row of the partner's state is not usable; says why."""


class _Memory:
    """
    Numbers of a coupling from one call to the next.

    Attributes
    ----------
    t : float or None
        Time of the last call, s; None before the first one.
    row : (4 n + 3,) array
        Which every call of the law updates: target of the spring, rates that the arm is
        to have, torque of the partner, and distance that is left from engagement; then
        the entries `GRIP`, `RAMPED` and `SATURATED`.

    """

    def __init__(self, n: int) -> None:
        self._n = n
        self.restart()

    def restart(self) -> None:
        """Begin again with the next state."""
        self.t: float | None = None
        self.row = np.zeros(4 * self._n + 3)
        self.row[GRIP] = 1.0

    @property
    def rows(self) -> Array:
        """Return target, rates, reflected and offset, (4, n), a view."""
        return self.row[:GRIP].reshape(4, self._n)


def _law(robot: Robot, followed: Sequence[int], shapes: Settings) -> Law:
    """Return the law as a function over any scalar: torques, then the memory."""
    equations = robot.equations
    places = list(followed)
    n = robot.n

    def law(q: Vector, u: Vector, q_p: Vector, u_p: Vector, external: Vector,
            memory: Vector, clock: Vector, settings: Vector, *, t: Scalar,
            parameters: Vector) -> Vector:
        values = shapes.unpacked(settings)
        motion = equations.joint_motion(q, u, equations.zeros, t)
        elapsed, engaged = clock
        is_engaged = engaged > 0.5
        # Both motions are computed; which one counts depends on the coupling.
        following = _following(memory, (q_p, u_p, external), elapsed, values)
        fading = _fading(memory, elapsed, values)
        state = np.array([select(is_engaged, x, y) for x, y in zip(following, fading)])

        # The force on the joints, within its limit.
        target, rates, reflected, _ = state[:-2].reshape(4, n)
        grip = state[-2]
        resisting = select(grip < FREE_DAMPING, FREE_DAMPING, grip) * values['damping']
        force = (grip * values['stiffness'] * (target - q[places])
                 + resisting * (rates - motion.qdot[places]) + reflected)
        # All components keep their ratio: the one that exceeds its limit by most
        # decides.
        share: Scalar = 1.0
        for component, limit in zip(force, values['force_limit']):
            size = magnitude(component)
            exceeds = limit < size
            reduced = select(exceeds, limit / select(exceeds, size, 1.0), 1.0)
            share = select(reduced < share, reduced, share)
        saturated = select(share < 1.0, 1.0, 0.0)

        tau = compensated_torques(robot, places, (q, u, t, parameters), motion,
                                  (rates, 0.0 * rates), share * force, values['weights'])
        return np.concatenate([tau, state, [saturated]])
    return law


def _following(memory: Vector, partner: tuple[Vector, Vector, Vector], elapsed: Scalar,
               values: Mapping[str, Any]) -> Vector:
    """Return the memory after a step with the partner: the offset goes to zero."""
    scale = values['scale']
    n = len(scale)
    target, _, _, offset = memory[:GRIP].reshape(4, n)
    q_p, u_p, external = partner
    ramped = memory[RAMPED] + elapsed / values['ramp']
    ramped = select(ramped < 1.0, ramped, 1.0)
    share = ramped * ramped * (3.0 - 2.0 * ramped)
    step = values['align_speed'] * elapsed
    left = offset - _bounded(offset, [-step] * n, [step] * n)

    # Within the speed and position limits of this arm
    reach = values['speed'] * elapsed
    moved = target + _bounded(scale * q_p + left - target, -reach, reach)
    bounded = _bounded(moved, values['lower'], values['upper'])
    rates = _bounded(share * scale * u_p, -values['speed'], values['speed'])
    reflected = share * values['reflection'] * external / scale
    # Since `engage` the spring acts as a whole.
    return np.concatenate([bounded, rates, reflected, left, [memory[GRIP], ramped]])


def _fading(memory: Vector, elapsed: Scalar, values: Mapping[str, Any]) -> Vector:
    """Return the memory after a step alone: the target rests, the torque vanishes."""
    n = len(values['scale'])
    target, rates, reflected, offset = memory[:GRIP].reshape(4, n)
    kept = np.exp(-3.0 * elapsed / values['ramp'])
    moved = _bounded(target + rates * elapsed, values['lower'], values['upper'])
    loosened = select(values['is_freed'] > 0.5, kept, 1.0)
    numbers = [loosened * memory[GRIP], memory[RAMPED]]
    return np.concatenate([moved, kept * rates, kept * reflected, offset, numbers])


def _bounded(x: Vector, lower: Sequence[Scalar], upper: Sequence[Scalar]) -> Vector:
    """Return numbers within bounds, over any scalar."""
    result = []
    for value, low, high in zip(x, lower, upper):
        value = select(value < low, low, value)
        result.append(select(high < value, high, value))
    return np.array(result)


def _within(name: str, value: float, low: float, high: float) -> float:
    """Return a number within bounds; InputError otherwise."""
    most = '' if math.isinf(high) else f', at most {high:g}'
    return number(value, name, f'a number, at least {low:g}{most}',
                  lambda checked: low <= checked <= high)


def _scales(scale: ArrayLike, names: Sequence[str]) -> Array:
    """Return the scales of the joints, (n,), none of them zero."""
    row = np.full(len(names), scale) if np.ndim(scale) == 0 else scale
    scales = finite_row(row, 'scale', names)
    if not scales.all():
        joint = names[int(np.flatnonzero(scales == 0.0)[0])]
        raise InputError(f"scale of joint '{joint}': 0; expected a nonzero number")
    return scales.copy()  # callers may change their array
