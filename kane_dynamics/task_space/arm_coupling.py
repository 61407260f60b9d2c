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

from collections.abc import Sequence
from dataclasses import replace
import math
from typing import Literal, NamedTuple

from kane_dynamics._util.attribute_hints import guarded
from kane_dynamics._util.checks import finite_row, instance, number, per_joint
from kane_dynamics._util.typing import Array
from kane_dynamics.control.terms import EVERY_TERM, Terms
from kane_dynamics.errors import InputError
from kane_dynamics.robot.robot import Robot
from kane_dynamics.task_space.joint_impedance import JointImpedance
import numpy as np
from numpy.typing import ArrayLike

FREE_DAMPING = 0.1  # of the damping, that an arm keeps which is alone and free


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


@guarded
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
        # Coriolis forces do no work. Compensated at the partner's rates they would.
        instance(compensate, Terms, 'compensate')
        terms = replace(compensate, coriolis=False, inertia=False)
        # Its spring of 1 N m/rad turns a force into a torque beside the compensation.
        self._law = JointImpedance(robot, stiffness=1.0, damping=0.0, compensate=terms,
                                   followed=followed)
        self.robot = robot
        names = self._names = self._law.followed
        self._places = [robot.coordinate_names.index(name) for name in names]
        self._stiffness = per_joint(stiffness, 'stiffness', names)
        self._damping = per_joint(damping, 'damping', names)
        self._reflection = _within('reflection', reflection, 0.0, 1.0)
        self._scale = _scales(scale, names)
        self._force_limit = per_joint(force_limit, 'force_limit', names, finite=False)
        limits = robot.limits
        self._lower = np.asarray(limits.lower, dtype=np.float64)[self._places]
        self._upper = np.asarray(limits.upper, dtype=np.float64)[self._places]
        self._speed = np.asarray(limits.velocity, dtype=np.float64)[self._places]
        if speed_limit is not None:
            self._speed = per_joint(speed_limit, 'speed_limit', names, finite=False)
        if alone not in ('hold', 'free'):
            raise InputError(f'alone: {alone!r}; expected hold or free')
        self._alone = alone
        self._timeout = _within('timeout', timeout, 1e-6, math.inf)
        self._ramp = _within('ramp', ramp, 1e-6, math.inf)
        self._align_speed = _within('align_speed', align_speed, 0.0, math.inf)
        self.engaged = False
        self.lost = ''
        self.saturated = False
        self._restart()

    def _restart(self) -> None:
        """Begin again with the next state."""
        n = len(self._names)
        self._t: float | None = None
        self._target = np.zeros(n)
        self._rates = np.zeros(n)      # that the arm is to have
        self._reflected = np.zeros(n)  # torque of the partner
        self._offset = np.zeros(n)
        self._grip = 1.0  # part of the spring that acts
        self._ramped = 0.0  # part of the ramp that is done

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
        if self._t is None:
            self._target = position.copy()
        # The spring is stretched as far as its present force asks for.
        self._target = position + self._grip * (self._target - position)
        self._grip = 1.0
        self._offset = self._target - self._scale * theirs
        self._ramped = 0.0
        self.engaged = True
        self.lost = ''

    def disengage(self, reason: str = '') -> None:
        """Hold, or free, the arm without its partner; `lost` becomes the reason."""
        self.engaged = False
        self.lost = reason

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
        t = number(t, 't', 'a finite time in s', math.isfinite)
        q = finite_row(q, 'q', self.robot.coordinate_names)
        u = finite_row(u, 'u', self.robot.speed_names)
        position = q[self._places]
        elapsed = self._elapsed(t, position)
        if self.engaged:
            if partner is not None:
                instance(partner, PartnerState, 'partner')
            fault = self._fault(t, partner)
            if fault:
                self.disengage(fault)
        if self.engaged and partner is not None:
            self._follow(partner, elapsed)
        else:
            self._fade(elapsed)
        force = self._force(position, self._joint_rates(q, u, t))
        return self._law.torque(q, u, position + force, self._rates, t=t)

    # The parts of `torque`.

    def _elapsed(self, t: float, position: Array) -> float:
        """Return the time since the last call, s; begin again after an interruption."""
        last = self._t
        if last is None or not 0.0 <= t - last <= self._timeout:
            if last is not None:
                reason = f'no state for {t - last:.3f} s'
                if t < last:
                    reason = f'time went back by {last - t:.3f} s'
                self.disengage(f'this arm: {reason}')
                self._restart()
            if not self.engaged:
                self._target = position.copy()
            self._t = t
            return 0.0
        self._t = t
        return t - last

    def _fault(self, t: float, partner: PartnerState | None) -> str:
        """Return why the partner is lost; empty if it is not."""
        if partner is None:
            return 'partner: no state'
        age = t - partner.t
        if not age <= self._timeout:
            return f'partner: no state for {age:.3f} s'
        if age < -self._timeout:  # its age is not known: another clock
            return (f'partner: a state {-age:.3f} s ahead; expected its time on the '
                    'clock of this arm')
        for name, row in zip(partner._fields[1:], partner[1:]):
            try:
                finite_row(row, f'partner: {name}', self._names)
            except InputError as error:
                return str(error)
        return ''

    def _follow(self, partner: PartnerState, elapsed: float) -> None:
        """Move the target with the partner, and the offset towards zero."""
        self._ramped = min(1.0, self._ramped + elapsed / self._ramp)
        share = self._ramped**2 * (3.0 - 2.0 * self._ramped)
        step = self._align_speed * elapsed
        aligned = np.clip(self._offset, -step, step)
        self._offset = self._offset - aligned

        # Within the speed and position limits of this arm
        goal = self._scale * np.asarray(partner.q) + self._offset
        reach: Array = np.zeros(len(goal))
        if elapsed > 0.0:
            reach = self._speed * elapsed
        moved = self._target + np.clip(goal - self._target, -reach, reach)
        self._target = np.clip(moved, self._lower, self._upper)
        rates = share * self._scale * np.asarray(partner.u)
        self._rates = np.clip(rates, -self._speed, self._speed)
        external = np.asarray(partner.external)
        self._reflected = share * self._reflection * external / self._scale

    def _fade(self, elapsed: float) -> None:
        """Bring the target to rest, and let the partner's torque vanish."""
        kept = math.exp(-3.0 * elapsed / self._ramp)
        moved = self._target + self._rates * elapsed
        self._target = np.clip(moved, self._lower, self._upper)
        self._rates = kept * self._rates
        self._reflected = kept * self._reflected
        if self._alone == 'free':
            self._grip *= kept

    def _force(self, position: Array, rates: Array) -> Array:
        """Return the force of the coupling on its joints, (n,), within its limit."""
        damping = max(self._grip, FREE_DAMPING) * self._damping
        force = (self._grip * self._stiffness * (self._target - position)
                 + damping * (self._rates - rates) + self._reflected)
        size = np.abs(force)
        self.saturated = bool((size > self._force_limit).any())
        if self.saturated:
            force = force * (self._force_limit[size > 0.0] / size[size > 0.0]).min()
        return force

    def _joint_rates(self, q: Array, u: Array, t: float) -> Array:
        """Return the rates of the coupled joints, (n,)."""
        if self.robot.equations.in_joint_rates:
            return u
        return self.robot.joint_rates(q, u, t=t)[self._places]


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
        raise InputError(f"scale of joint '{joint}': 0; expected another number")
    return scales
