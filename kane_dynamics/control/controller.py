"""Controller: torques to command for a measured state and a motion, without ROS."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
import math
from typing import Any, Protocol

from kane_dynamics._util.checks import (constant, finite_row, number,
                                        per_joint, robot_like)
from kane_dynamics._util.fixed_attributes import fixed
from kane_dynamics._util.fork_safety import lazy_property
from kane_dynamics._util.typing import Array, Scalar, Vector
from kane_dynamics.control.computed_torque import (corrected_acceleration,
                                                   followed_friction, KD, KP,
                                                   law_kernel, require_rigid)
from kane_dynamics.control.followed_motion import FollowedMotion
from kane_dynamics.control.quasi_static import QuasiStatic
from kane_dynamics.control.stopping import motion_to_rest, state_after
from kane_dynamics.control.terms import EVERY_TERM, Mode, Terms
from kane_dynamics.control.torque_blend import TorqueBlend
from kane_dynamics.control.torque_limiter import Command, lowered_efforts, TorqueLimiter
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.ball_joints import require_angles
from kane_dynamics.motion.motion import Motion
from kane_dynamics.native.runtime.threads import run_concurrently
from kane_dynamics.robot.feedforward_friction import change_kernel, changes_friction
from kane_dynamics.robot.methods.configuration_methods import warn_of_degrees
from kane_dynamics.robot.robot import Robot, TORQUE_TERMS
import numpy as np
from numpy.typing import ArrayLike

__all__ = ['Controller', 'Mode', 'Terms']

CORIOLIS = TORQUE_TERMS.index('coriolis')
FRICTION = TORQUE_TERMS.index('friction')
# Modes whose law is a method of `Controller`.
OWN_MODES = (Mode.INVERSE_DYNAMICS, Mode.COMPUTED_TORQUE, Mode.GRAVITY_COMPENSATION)
PREDICTION_STEP = 1e-3  # s


class ModeLaw(Protocol):
    """The law of a mode that `Controller` does not compute itself."""

    @property
    def pose(self) -> Array | None:
        """Return the positions that are held, as `Controller.pose`."""

    def restart(self) -> None:
        """Begin at the next state, as after a change of mode or a stop."""

    def torque(self, q: Array, u: Array, motion: Motion | None, moment: float,
               t: float) -> Array:
        """Return joint torques (n_q,) before the limits, as `Controller.torque`."""


@fixed
class Controller:
    """
    Computes torque commands for successive measured states.

    Modes, with (q, u) measured and (q_d, u_d, udot_d) desired:

    inverse_dynamics
        The torque of the model at (q_d, u_d, udot_d); without a motion, gravity at q.
    computed_torque
        The torque of the model at q, u and udot_d + kd (u_d - u) + kp (q_d - q), but
        friction at the desired speed: compensation at the measured one would accelerate
        an arm at rest. Without a motion it holds the first measured pose.
    gravity_compensation
        Gravity at q. The speed is not used.
    joint_impedance, cartesian_impedance, hand_guiding
        The law that `laws` has for the mode, of `kane_dynamics.task_space`.

    `compensate` switches torque terms off in every mode. The springs of the model have
    no switch: they are part of the model's torque, and not of gravity. Switching inertia
    off leaves out M udot_d; the feedback of computed torque stays.

    Each torque is clamped to the effort limit, then its change from the last command to
    the rate limit times the time between the stamps. After construction or `stop` the
    previous command is zero at the stamp of the first state, so with a rate limit the
    torque starts at zero. With `blend_time` a change of mode or of gains is continuous:
    the torque goes on from the last command, and the difference vanishes in that time.

    Parameters
    ----------
    robot : Robot
    mode : Mode or str
    compensate : Terms
    kp : float or (n,) array_like
        1/s^2, for computed torque.
    kd : float or (n,) array_like
        1/s, for computed torque.
    effort_limit : float or (n,) array_like, optional
        N m or N, at most those of the robot, which apply too; one number limits the
        joints whose own limit is larger. Infinite, the default: the robot's limits alone.
    rate_limit : float or (n,) array_like
        N m/s or N/s; infinite for no limit.
    blend_time : float
        s; 0: a change takes effect at once, within the limits.
    laws : mapping of Mode to ModeLaw, optional
        The laws of further modes; a mode without a law is refused.
    bending : QuasiStatic, optional
        The flexible arm of which `robot` is the rigid model; its torques are commanded
        then.
    followed, preload : optional
        With chosen speeds or constraints: the joints that follow the motion, as for
        `ComputedTorque`, in the order of the gains; and joint torques (n_q,), to which
        those of redundant actuators are nearest. The commands are torques of all joints,
        (n_q,), zero without an actuator (`Robot.joint_torques`). Inverse dynamics closes
        the loops on the branch of the first measured state; under constraints on
        velocities it needs a motion of all joints.

    Raises
    ------
    InputError
        Names the argument, the joint, the value and what is expected.

    """

    def __init__(self, robot: Robot, *, mode: Mode | str = Mode.INVERSE_DYNAMICS,
                 compensate: Terms = EVERY_TERM, kp: ArrayLike = KP, kd: ArrayLike = KD,
                 effort_limit: ArrayLike = math.inf, rate_limit: ArrayLike = math.inf,
                 blend_time: float = 0.0,
                 laws: Mapping[Mode, ModeLaw] | None = None,
                 bending: QuasiStatic | None = None,
                 followed: Sequence[str] | None = None,
                 preload: ArrayLike | None = None) -> None:
        robot_like(robot)
        require_rigid(robot)
        self.robot = robot
        self.laws = dict(laws or {})
        self.bending = bending
        self._source = robot if bending is None else bending
        # In joint rates the torques are those of the joints, and all joints follow
        # motions.
        self._direct = robot.equations.in_joint_rates
        if not self._direct:
            require_angles(robot.model, 'Controller')
        elif followed is not None or preload is not None:
            raise InputError('followed, preload: given; expected a robot with chosen '
                             'speeds or constraints')
        self._motion = FollowedMotion(robot, followed)
        self._names = tuple(robot.joint_names)  # of the commands
        self._speeds = robot.speed_names
        self._follow = self._motion.names  # of the gains
        if bending is not None:
            if not self._direct:
                bending.require_drives('followed', self._follow)
                bending.require_drives('actuated', robot.actuated_names)
            bending.require_rigid_model(robot)
        self._preload: Array | None = None
        if preload is not None:
            self._preload = _checked_preload(robot, preload)
        self._zero = np.zeros(len(self._follow))
        self._zero.flags.writeable = False
        self._pose: Array | None = None  # held while there is no motion
        self._fitting: Motion | None = None  # the last motion whose joints fit
        self._limiter = TorqueLimiter(self._names)
        self._blend = TorqueBlend()
        self._mode = Mode.INVERSE_DYNAMICS
        self._law_of_mode: ModeLaw | None = None
        self._reached_of: dict[Terms, Callable[..., Array]] = {}
        self._kp = self._zero
        self._kd = self._zero
        self._gains = np.zeros(2 * len(self._follow))
        self.update(mode=mode, compensate=compensate, kp=kp, kd=kd,
                    effort_limit=effort_limit, rate_limit=rate_limit,
                    blend_time=blend_time)

    # Settings, which may change between two commands.

    def update(self, *, mode: Mode | str | None = None, compensate: Terms | None = None,
               kp: ArrayLike | None = None, kd: ArrayLike | None = None,
               effort_limit: ArrayLike | None = None,
               rate_limit: ArrayLike | None = None,
               blend_time: float | None = None) -> None:
        """
        Change settings between two commands; None keeps a setting.

        On an InputError no setting changes. The rate limit continues from the last
        command; a new mode holds a new pose.
        """
        # All checks come before the first change.
        if mode is not None and mode not in self.modes:
            raise InputError(f'mode: {mode!r}; expected one of {", ".join(self.modes)}')
        if blend_time is not None:
            blend_time = number(blend_time, 'blend_time', 'a finite time in s, not negative',
                                lambda x: 0.0 <= x < math.inf)
        names = self._names
        new_kp = self._kp if kp is None else per_joint(kp, 'kp', self._follow)
        new_kd = self._kd if kd is None else per_joint(kd, 'kd', self._follow)
        effort: Array | None = None
        rate: Array | None = None
        if effort_limit is not None:
            lowered_efforts(self.robot.limits.effort, effort_limit, names)
            effort = per_joint(effort_limit, 'effort_limit', names, finite=False)
        if rate_limit is not None:
            rate = per_joint(rate_limit, 'rate_limit', names, finite=False)
        if compensate is not None and compensate.arm is not None and (
                self.bending is not None):
            raise InputError('compensate.arm: given for flexible links; expected rigid links')
        # From here on nothing is refused.
        if blend_time is not None:
            self._blend.duration = blend_time
        gains = np.concatenate([new_kp, new_kd])
        # New gains would make the torque jump: blend from the last one.
        if mode in (None, self._mode) and not np.array_equal(gains, self._gains):
            self._blend.begin()
        self._kp = new_kp
        self._kd = new_kd
        self._gains = gains
        if effort is not None:
            self._effort = effort
            self._limit_efforts()
        if rate is not None:
            self._limiter.set_rate(rate)
        if mode is not None and mode != self._mode:
            self._mode = Mode(mode)
            self._law_of_mode = self.laws.get(self._mode)
            self._restart()
            self._blend.begin()
        if compensate is not None:
            self._compensate = compensate
            arm = compensate.arm
            self._arm = None if arm is None else arm.entry(self.robot)
            self._back = compensate.of_feedback.weights

    def _limit_efforts(self) -> None:
        """Limit the torques by the setting and by the robot's present limits."""
        self._limits = self.robot.limits
        self._limiter.set_effort(np.minimum(self._effort, self._limits.effort))

    @property
    def followed(self) -> tuple[str, ...]:
        """Return the names of the joints that follow motions, in the gains' order."""
        return self._follow

    @property
    def preload(self) -> Array | None:
        """Return the preload of redundant actuators, (n_q,), N m or N; None by default."""
        return None if self._preload is None else self._preload.copy()

    @property
    def modes(self) -> tuple[Mode, ...]:
        """Return the modes for which this controller has a law."""
        return (*OWN_MODES, *self.laws)

    @property
    def mode(self) -> Mode:
        """Return the mode; `update` changes it."""
        return self._mode

    @property
    def compensate(self) -> Terms:
        """Return the torque terms of the command; `update` changes them."""
        return self._compensate

    @property
    def kp(self) -> Array:
        """Return the gains of the position, (n,) 1/s^2; `update` changes them."""
        return self._kp

    @property
    def kd(self) -> Array:
        """Return the gains of the speed, (n,) 1/s; `update` changes them."""
        return self._kd

    @property
    def pose(self) -> Array | None:
        """Return the positions that are held, (n,) rad or m; None with a motion."""
        return self._pose if self._law_of_mode is None else self._law_of_mode.pose

    @property
    def blend_time(self) -> float:
        """Return the time in which a change of the law takes effect, s."""
        return self._blend.duration

    @property
    def effort_limit(self) -> Array:
        """Return the effort limits, (n,) N m or N: the robot's, or smaller ones."""
        if self.robot.limits is not self._limits:
            self._limit_efforts()
        return self._limiter.effort

    @property
    def rate_limit(self) -> Array:
        """Return the largest change of each torque, (n,) N m/s or N/s."""
        return self._limiter.rate

    def compile(self) -> None:  # noqa: A003
        """Compile the kernels that commands need."""
        # Further kernels, as the terms and the speeds of the robot need them.
        source = self.robot if self.bending is None else self.bending.robot
        quantities = ('inverse_dynamics', 'torque_terms', 'gravity_force',
                      'friction_force')
        jobs: list[Callable[[], object]] = [self._reached, self._motion.compile,
                                            partial(source.compile, *quantities)]
        if self.bending is None:
            jobs.append(lambda: self._law)
        if self._compensate.friction and self._needs_friction_kernel:
            jobs.append(lambda: self._friction_kernel)
        if self._compensate.changes_friction(self._source):
            jobs.append(partial(change_kernel, source))
        if not self._direct:
            jobs.append(partial(self.robot.compile, 'joint_torques', 'joint_rates',
                                'mass_matrix'))
        run_concurrently(jobs)

    # Commands.

    def command(self, t: float, q: ArrayLike, u: ArrayLike | None = None,
                motion: Motion | None = None, motion_time: float | None = None,
                external: ArrayLike | None = None) -> Command:
        """
        Return the torques to apply at the measured state.

        Parameters
        ----------
        t : float
            Stamp of the state, s on any clock; the rate limit uses the time between
            stamps, zero for a backward jump.
        q : (n,) array_like
            Measured positions, rad or m.
        u : (n,) array_like, optional
            Measured speeds, rad/s or m/s; optional in gravity compensation only.
        motion : Motion, optional
            The desired motion, of the robot's joints in the robot's order.
        motion_time : float, optional
            Time since the motion began, s. Default: t.
        external : (n,) array_like, optional
            Known external generalized force (`Robot.external_force`), N m or N; the
            command compensates it, except in gravity compensation and in the modes of
            `laws`, where the arm yields.

        Returns
        -------
        Command

        Raises
        ------
        InputError
            A number of the state is missing or not finite, or the motion has other
            joints. The controller does not change then.

        """
        t = number(t, 't', 'a finite time in s', math.isfinite)
        q = finite_row(q, 'the measured position', self._names)
        if u is not None:
            u = finite_row(u, 'the measured speed', self._speeds)
        elif self._mode is Mode.GRAVITY_COMPENSATION:
            u = np.zeros(len(self._speeds))
        else:
            raise InputError('u: missing; expected the measured speeds, which '
                             f'{self._mode} needs')
        # A motion is checked once, not in every cycle.
        if motion is not None and motion is not self._fitting:
            self._motion.check(motion)
            if motion.n == len(self._names):
                warn_of_degrees(self.robot, motion.positions, 'motion')
            self._fitting = motion
        if external is not None:
            external = finite_row(external, 'the measured external torque', self._speeds)
        moment = t if motion_time is None else motion_time
        # Sampled at the time of the state, unless the motion has a time of its own.
        # The law, a blend from the torques of another mode, and the limits.
        tau = self.torque(q, u, motion, moment, external, t)
        if self._blend.active:
            tau = self._blend.apply(t, tau, self._limiter.last)
        if self.robot.limits is not self._limits:
            self._limit_efforts()
        return self._limiter.apply(t, tau)

    def torque(self, q: Array, u: Array, motion: Motion | None, moment: float,
               external: Array | None = None, t: float = 0.0) -> Array:
        """
        Return the torques of `command`, (n,), before blending and limits, without checks.

        For a loop that has checked the arguments: `q` and `u` are (n,) float64, finite
        and contiguous, and the motion is of the robot's joints in the robot's order.
        """
        tau = self._whole_torque(q, u, motion, moment, external, t)
        return tau if self._arm is None else tau - self._arm_torque(q, t)

    def _arm_torque(self, q: Array, t: float) -> Array:
        """Return the torque that the arm adds for the gravity and payload it was told."""
        assert self._arm is not None
        force = self._arm(q, t)
        return self._shared(force, q, t)

    def _whole_torque(self, q: Array, u: Array, motion: Motion | None, moment: float,
                      external: Array | None, t: float) -> Array:
        """Return `torque` with the gravity that the arm itself compensates."""
        # Laws of task space are complete; the others add what is measured.
        if self._law_of_mode is not None:
            tau = self._law_of_mode.torque(q, u, motion, moment, t)
            return tau if self.bending is None else tau + self._sag_torque(q, t)
        at = q  # the configuration at which the model is evaluated
        if self._mode is Mode.COMPUTED_TORQUE:
            tau = self._computed_torque(q, u, motion, moment, t)
        # Feedforward alone: everything at the desired state.
        elif self._mode is Mode.INVERSE_DYNAMICS and motion is not None:
            at, tau = self._feedforward(q, motion, moment, t)
        else:
            tau = self._gravity(q, t)
            if not self._direct:
                tau = self._joint_torques(tau, q, t)
        if external is not None and self._mode is not Mode.GRAVITY_COMPENSATION:
            tau = tau - self._shared(external, at, t)
        return tau

    def _sag_torque(self, q: Array, t: float) -> Array:
        """Return the torque of the deflection under gravity, beyond the rigid model's."""
        if not self._compensate.gravity:
            return np.zeros(len(self._names))
        rigid = self.robot.gravity_force(q, **self._time(t))
        return self._shared(self._gravity(q, t) - rigid, q, t)

    def gravity_torque(self, q: Array, t: float = 0.0) -> Array:
        """Return the torque that holds q, (n,), against gravity, or zeros without it."""
        if not self._compensate.gravity:
            return np.zeros(len(self._names))
        tau = self._joint_torques(self._gravity(q, t), q, t)
        return tau if self._arm is None else tau - self._arm_torque(q, t)

    def motion_torque(self, q: Array, motion: Motion, moment: float, t: float = 0.0
                      ) -> Array:
        """
        Return the torque of the model along a motion, (n,), without feedback or limits.

        Closed loops are on the branch of q (n_q,), the last measured configuration.
        """
        at, tau = self._feedforward(q, motion, moment, t)
        return tau if self._arm is None else tau - self._arm_torque(at, t)

    def interrupted(self, motion: Motion, moment: float, duration: float) -> Motion:
        """
        Return the stop of the joints that follow, from a motion at a time, s.

        It comes to rest after half its duration, s, times the speeds of the motion.
        """
        begin, speeds, _ = self._motion.desired(motion, moment)
        return motion_to_rest(begin, speeds, duration, self._follow)

    def stopping_motion(self, q: Array, u: Array, tau: Array, elapsed: float,
                        duration: float, t: float = 0.0) -> Motion:
        """
        Return the stop of an arm that is not measured any more, of the joints that follow.

        It begins where the arm is after a time under a constant torque, by the model,
        and comes to rest after half its duration times its first speeds.

        Parameters
        ----------
        q, u : (n_q,), (n,) arrays
            The last measured state.
        tau : (n_q,) array
            The torque commanded since then.
        elapsed, duration : float
            Time since then, and of the stop, s.
        t : float
            Time of the state, s.

        Raises
        ------
        InputError, ConstraintError
            The arm reaches no finite state, or is singular at q.

        """
        q_end, _, rates = self._state_after(q, u, tau, elapsed, t)
        begin = q_end[list(self._motion.places)]
        return motion_to_rest(begin, rates, duration, self._follow)

    def predicted_state(self, q: Array, u: Array, tau: Array, duration: float,
                        t: float = 0.0) -> tuple[Array, Array]:
        """
        Return the state, (n_q,) and (n,), that a constant torque reaches, by the model.

        Steps of at most `PREDICTION_STEP`, of second order.

        Parameters
        ----------
        q, u : (n_q,), (n,) arrays
            The state at the begin, rad or m, and s.
        tau : (n_q,) array
            The torque of the joints, N m or N.
        duration : float
            s.
        t : float
            Time of the state, s.

        Raises
        ------
        InputError, ConstraintError
            The arm reaches no finite state, or is singular on its way.

        """
        steps = max(math.ceil(duration / PREDICTION_STEP), 1)
        step = duration / steps
        for k in range(steps):
            q, u, _ = self._state_after(q, u, tau, step, t + k * step)
        return q, u

    def _state_after(self, q: Array, u: Array, tau: Array, duration: float, t: float
                     ) -> tuple[Array, Array, Array]:
        """
        Return the state that a constant torque reaches in one step.

        The rates of the joints that follow come after it.
        """
        after = self._reached()(q, u, tau, duration, t)
        n_q = self.robot.n_q
        q_end, u_end, rates = np.split(after, [n_q, n_q + self.robot.n])
        return q_end, u_end, rates

    def stop(self) -> Command:
        """Return zeros, regardless of limits, and restart with the next state."""
        self._restart()
        return self._limiter.stop()

    def _restart(self) -> None:
        self._pose = None
        self._motion.restart()
        self._blend.stop()
        if self._law_of_mode is not None:
            self._law_of_mode.restart()

    # Computed torque.

    def _computed_torque(self, q: Array, u: Array, motion: Motion | None, moment: float,
                         t: float) -> Array:
        """Return the torque towards the motion, or towards the pose that is held."""
        if motion is not None:
            if self._pose is not None:  # the pose at the end of the motion is held next
                self._pose = None
            return self._feedback(q, u, *self._motion.desired(motion, moment), t)
        if self._pose is not None:
            return self._feedback(q, u, self._pose, self._zero, self._zero, t)
        # The first state without a motion is the pose to hold.
        pose = q if self._direct else q[self._motion.places]
        tau = self._feedback(q, u, pose, self._zero, self._zero, t)
        if np.isfinite(tau).all():  # a refused state is no pose
            self._pose = pose.copy()
        return tau

    def _feedback(self, q: Array, u: Array, q_d: Array, u_d: Array, udot_d: Array,
                  t: float) -> Array:
        """Return the torque at the measured state and the corrected acceleration."""
        # With all terms, one kernel computes the whole law.
        if self._compensate.complete and self.bending is None:
            tau = self._law(q, u, q_d, u_d, udot_d, self._gains, t)
            return tau if self._preload is None else self._preloaded(tau, q, t)
        # Otherwise feedback acts on the joints that follow, and terms are left out of
        # the sum.
        positions, rates = q, u
        if not self._direct:
            places = self._motion.places
            positions = q[places]
            rates = self.robot.joint_rates(q, u, **self._time(t))[places]
        feedforward = udot_d if self._compensate.inertia else self._zero
        with np.errstate(over='ignore', invalid='ignore'):  # the kernel raises an error
            corrected = corrected_acceleration(positions, rates, q_d, u_d, feedforward,
                                               self._kp, self._kd)
        force: Array = self._back @ self._terms(q, u, corrected, t)
        if self._compensate.friction:
            force = force + self._friction(q, u, corrected, u_d, udot_d, t)
        return force if self._direct else self._joint_torques(force, q, t)

    @lazy_property
    def _law(self) -> Callable[..., Array]:
        """Return the entry point of the computed-torque kernel, with all terms."""
        kernel = law_kernel(self.robot, self._motion.places, commanded=True)
        no_wrench = [None] if len(self.robot.kernels.no_wrench) else []

        # The time comes last.
        def without_wrench(*arguments: Any) -> Any:
            return kernel(*arguments[:-1], *no_wrench, arguments[-1])
        return kernel.entry('', without_wrench)

    def _reached(self) -> Callable[..., Array]:
        """Return the entry point of `state_after`, with the joints that follow."""
        robot = self.robot
        places = tuple(self._motion.places)
        terms = self._compensate
        if terms in self._reached_of:
            return self._reached_of[terms]

        # The state that the torques reach, traced for these joints and terms.
        def reached(q: Array, u: Array, tau: Array, elapsed: float, parameters: Array,
                    t: float) -> Array:
            q_end, u_end, rates = state_after(robot, terms, q, u, tau, elapsed, parameters,
                                              t)
            return np.concatenate([q_end, u_end, rates[list(places)]])
        # A kernel for each set of terms and joints, which are constants in it.
        name = f'state_after_{terms.label}_{"_".join(map(str, places))}'
        count = robot.n_q + robot.n + len(places)
        kernel = robot.compiled(reached, name=name, q=(robot.n_q,), u=(robot.n,),
                                tau=(robot.n_q,), elapsed=(), shape=(count,))
        self._reached_of[terms] = kernel.entry('', kernel)
        return self._reached_of[terms]

    # Inverse dynamics and gravity.

    def _feedforward(self, q: Array, motion: Motion, moment: float, t: float
                     ) -> tuple[Array, Array]:
        """Return the desired configuration and the torques of its motion."""
        # Joint rates of a tree: the desired state is the motion's.
        if self._direct:
            q_d, u_d, udot_d = motion.sample(moment)
            tau = self._compensate.whole_inverse_dynamics(self._source, q_d, u_d, udot_d)
            return q_d, tau
        # Loops and chosen speeds: the state of all joints follows from that of some.
        (q_d, u_d, udot_d), accelerations = self._motion.state(q, motion, moment, t)
        if self._compensate.complete:
            force = self._source.inverse_dynamics(q_d, u_d, udot_d, **self._time(t))
        else:
            weights = self._compensate.weights
            force = np.asarray(weights @ self._terms(q_d, u_d, accelerations, t))
        if self._compensate.changes_friction(self._source):
            force = force + self._compensate.friction_change(
                self._source, q_d, u_d, udot_d, **self._time(t))
        return q_d, self._joint_torques(force, q_d, t)

    def _gravity(self, q: Array, t: float) -> Array:
        """Return the generalized force that balances gravity, or zeros without it."""
        if not self._compensate.gravity:
            return np.zeros(len(self._speeds))
        return self._source.gravity_force(q, **self._time(t))

    def _terms(self, q: Array, u: Array, accelerations: Array, t: float) -> Array:
        """
        Return inverse dynamics by source, (5, n), for accelerations of followed joints.

        The inertia term is that of these accelerations, not of udot, so that the terms
        do not depend on the choice of speeds.
        """
        if self._direct:
            return self._source.torque_terms(q, u, accelerations)
        # The drift is what udot must be for the joints that follow not to accelerate;
        # its inertial torque counts with the Coriolis terms.
        time = self._time(t)
        drift = self._motion.speed_rates(q, u, 0.0 * accelerations, t)
        udot = self._motion.speed_rates(q, u, accelerations, t)
        rows: Array = self._source.torque_terms(q, u, udot - drift, **time)
        rows[CORIOLIS] += self.robot.mass_matrix(q, **time) @ drift
        return rows

    def _friction(self, q: Array, u: Array, accelerations: Array, u_d: Array,
                  udot_d: Array, t: float) -> Array:
        """
        Return the friction in a desired motion of the joints that follow, (n,).

        Friction that depends on loads is that under the torques of the motion with these
        accelerations.
        """
        if not self._needs_friction_kernel:
            return self.robot.friction_force(u_d)
        load = np.zeros(len(self._speeds))
        # Loads of the drives are the torques without friction.
        if self.robot.equations.carries_loads:
            terms = self._terms(q, u, accelerations, t)
            load = np.delete(terms, FRICTION, axis=0).sum(axis=0)
        return self._friction_kernel(q, u, u_d, udot_d, load, t)

    @property
    def _needs_friction_kernel(self) -> bool:
        """Return whether friction follows not from the desired rates of joints alone."""
        carries_loads = self.robot.equations.carries_loads
        return not self._direct or carries_loads or changes_friction(self.robot)

    @lazy_property
    def _friction_kernel(self) -> Callable[..., Array]:
        """Return the friction of a desired motion under a force of the motors, compiled."""
        equations = self.robot.equations
        places = list(self._motion.places)

        def friction(q: Vector, u: Vector, u_d: Vector, udot_d: Vector, load: Vector, *,
                     t: Scalar) -> Vector:
            # Friction of the joints, projected on the independent speeds.
            motion = equations.joint_motion(q, u, equations.zeros, t)
            return motion.projected(followed_friction(equations, places, q, motion, u_d,
                                                      udot_d, load, t))
        n = self.robot.n
        name = '_'.join(['followed_friction', *map(str, places)])
        kernel = self.robot.compiled(friction, name=name, shape=(n,), q=(self.robot.n_q,),
                                     u=(n,), u_d=(n,), udot_d=(n,), load=(n,))
        return kernel.entry('', kernel)

    # The torques of the joints with a generalized force.

    def _time(self, t: float) -> dict[str, Any]:
        """Return the keyword of the time of the robot's methods, which few robots have."""
        return {'t': t} if self.robot.equations.timed else {}

    def _joint_torques(self, force: Array, q: Array, t: float) -> Array:
        """Return the torques of the joints, (n_q,), with a generalized force."""
        return self._preloaded(self._shared(force, q, t), q, t)

    def _shared(self, force: Array, q: Array, t: float) -> Array:
        """Return the torques of the joints without the preload."""
        if self._direct:
            return force
        return self.robot.joint_torques(force, q, **self._time(t))

    def _preloaded(self, torques: Array, q: Array, t: float) -> Array:
        """Return joint torques plus the part of the preload p without generalized force."""
        p = self._preload
        if p is None:
            return torques
        force = self.robot.generalized_force(p, q, **self._time(t))
        return torques + (p - self._shared(force, q, t))


def _checked_preload(robot: Robot, preload: ArrayLike) -> Array:
    """Return the preload; InputError unless it loads redundant actuators alone."""
    # A preload is torque that moves nothing: it needs more actuators than speeds.
    torques = constant(preload, (robot.n_q,), 'preload', InputError)
    actuated = robot.equations.actuated or []
    others = [k for k in np.flatnonzero(torques) if k not in actuated]
    if len(actuated) <= robot.n or others:
        raise InputError(f'preload: {torques.tolist()}, with {len(actuated)} actuated '
                         f'joints and {robot.n} independent speeds; expected torques at '
                         'actuated joints, of a robot with more of them than '
                         'independent speeds (Robot(..., actuated=...))')
    return torques
