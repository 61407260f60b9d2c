"""Controller: the torques to command for a measured state and a desired motion, without ROS."""

from __future__ import annotations

from collections.abc import Callable, Sequence
import math

from kane_dynamics._util.attribute_hints import fixed
from kane_dynamics._util.checks import finite_row
from kane_dynamics._util.fork_safety import lazy_property
from kane_dynamics._util.typing import Array
from kane_dynamics.control.computed_torque import KD, KP
from kane_dynamics.control.computed_torque_law import corrected_acceleration, law_kernel
from kane_dynamics.control.constrained_law import require_rigid
from kane_dynamics.control.constrained_torques import ConstrainedTorques
from kane_dynamics.control.controller_settings import ControllerSettings
from kane_dynamics.control.quasi_static import QuasiStatic
from kane_dynamics.control.terms import EVERY_TERM, Mode, Terms
from kane_dynamics.control.torque_limiter import Command, TorqueLimiter
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.ball_joints import require_angles
from kane_dynamics.motion.motion import Motion
from kane_dynamics.robot.methods.configuration_methods import warn_of_degrees
from kane_dynamics.robot.robot import Robot
import numpy as np
from numpy.typing import ArrayLike

__all__ = ['Controller', 'Mode', 'Terms']


@fixed
class Controller(ControllerSettings):
    """
    Computes torque commands for successive measured states.

    Modes, with (q, u) measured and (q_d, u_d, udot_d) desired:

    inverse_dynamics
        The torque of the model at (q_d, u_d, udot_d); without a motion, gravity at q.
    computed_torque
        The torque of the model at q, u and udot_d + kd (u_d - u) + kp (q_d - q), but friction at
        the desired speed: compensation at the measured one would accelerate an arm at rest.
        Without a motion it holds the first measured pose.
    gravity_compensation
        Gravity at q. The speed is not used.

    `compensate` switches torque terms off in every mode. The springs of the model have no switch:
    they are part of the model's torque, and not of gravity. Switching inertia off leaves out
    M udot_d; the feedback of computed torque stays.

    Each torque is clamped to the effort limit, then its change from the last command to the rate
    limit times the time between the stamps. After construction or `stop` the previous command is
    zero at the stamp of the first state, so with a rate limit the torque starts at zero.

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
        N m or N; applies in addition to the robot's own limits. Default: only those.
    rate_limit : float or (n,) array_like
        N m/s or N/s; infinite for no limit.
    bending : QuasiStatic, optional
        The flexible arm of which `robot` is the rigid model; its torques are commanded then.
    followed, preload : optional
        With chosen speeds or constraints: the joints that follow the motion, as for
        `ComputedTorque`, in the order of the gains; and joint torques (n_q,), to which those of
        redundant actuators are nearest. The commands are torques of all joints, (n_q,), zero
        without an actuator (`Robot.joint_torques`). Inverse dynamics closes the loops on the
        branch of the first measured state; under constraints on velocities it needs a motion of
        all joints.

    Raises
    ------
    InputError
        Names the argument, the joint, the value and what is expected.

    """

    def __init__(self, robot: Robot, *, mode: Mode | str = Mode.INVERSE_DYNAMICS,
                 compensate: Terms = EVERY_TERM, kp: ArrayLike = KP, kd: ArrayLike = KD,
                 effort_limit: ArrayLike = math.inf, rate_limit: ArrayLike = math.inf,
                 bending: QuasiStatic | None = None, followed: Sequence[str] | None = None,
                 preload: ArrayLike | None = None) -> None:
        require_rigid(robot)
        self.robot, self.bending = robot, bending
        self._names = self._speeds = self._follow = tuple(robot.joint_names)
        self._constrained: ConstrainedTorques | None = None
        if not robot.equations.in_joint_rates:
            require_angles(robot.model, 'Controller')
            self._constrained = ConstrainedTorques(robot, followed, preload, bending)
            self._speeds, self._follow = robot.speed_names, self._constrained.followed
        elif followed is not None or preload is not None:
            raise InputError('followed, preload: given; expected a robot with chosen speeds or '
                             'constraints')
        if bending is not None:
            bending.require_rigid_model(robot)
        self._source = bending or robot
        self._zero = np.zeros(len(self._follow))
        self._zero.flags.writeable = False
        self._pose: Array | None = None  # held while there is no motion
        self._motion: Motion | None = None  # the last one whose joints were found to fit
        self._limiter = TorqueLimiter(self._names)
        self._mode, self._kp, self._kd = Mode(Mode.INVERSE_DYNAMICS), self._zero, self._zero
        self.update(mode=mode, compensate=compensate, kp=kp, kd=kd, effort_limit=effort_limit,
                    rate_limit=rate_limit)

    @lazy_property
    def _law(self) -> Callable[..., Array]:
        """Return the entry point of the computed-torque kernel, with all terms."""
        kernel = law_kernel(self.robot)
        more = [None] if len(self.robot.kernels.no_wrench) else []
        return kernel.entry('', lambda *given: kernel(*given, *more))

    def compile(self) -> None:  # noqa: A003
        """Compile the kernels that commands need in addition to those of the robot."""
        if self._constrained is not None:
            self._constrained.compile()
        elif self.bending is None:
            self._law  # noqa: B018
        else:
            self.bending.robot.compile('inverse_dynamics', 'torque_terms', 'gravity_force')

    def command(self, t: float, q: ArrayLike, u: ArrayLike | None = None,
                motion: Motion | None = None, motion_time: float | None = None,
                external: ArrayLike | None = None) -> Command:
        """
        Return the torques to apply at the measured state.

        Parameters
        ----------
        t : float
            Stamp of the state, s on any clock; the rate limit uses the time between stamps, zero
            for a backward jump.
        q : (n,) array_like
            Measured positions, rad or m.
        u : (n,) array_like, optional
            Measured speeds, rad/s or m/s; optional in gravity compensation only.
        motion : Motion, optional
            The desired motion, of the robot's joints in the robot's order.
        motion_time : float, optional
            Time since the motion began, s. Default: t.
        external : (n,) array_like, optional
            Known external generalized force (`Robot.external_force`), N m or N; the command
            compensates it, except in gravity compensation, where an operator guides the arm.

        Returns
        -------
        Command

        Raises
        ------
        InputError
            A number of the state is missing or not finite, or the motion has other joints. The
            controller does not change then.

        """
        t = float(t)
        if not math.isfinite(t):
            raise InputError(f't: {t}; expected a finite time in s')
        q = finite_row(q, 'the measured position', self._names)
        if u is not None:
            u = finite_row(u, 'the measured speed', self._speeds)
        elif self._mode is not Mode.GRAVITY_COMPENSATION:
            raise InputError(f'u: missing; expected the measured speeds, which {self._mode} '
                             'needs')
        if motion is not None and motion is not self._motion:
            if self._constrained is not None:
                self._constrained.check(motion)
            elif motion.joint_names != self._names:
                raise InputError(f'motion: of the joints {list(motion.joint_names)}; '
                                 f'expected {list(self._names)}')
            if motion.n == len(self._names):
                warn_of_degrees(self.robot, motion.positions, 'motion')
            self._motion = motion
        external = None if external is None else finite_row(
            external, 'the measured external torque', self._speeds)
        u = np.zeros(len(self._speeds)) if u is None else u
        return self.command_checked(t, q, u, motion,
                                    t if motion_time is None else motion_time, external)

    def command_checked(self, t: float, q: Array, u: Array, motion: Motion | None,
                        moment: float, external: Array | None = None) -> Command:
        """
        Return the torques to apply, as `command`, without checks of the arguments.

        For a loop that has checked them: `q` and `u` are (n,) float64, finite and contiguous, and
        the motion is of the robot's joints in the robot's order.
        """
        return self._limiter.apply(t, self.torque(q, u, motion, moment, external, t))

    def torque(self, q: Array, u: Array, motion: Motion | None, moment: float,
               external: Array | None = None, t: float = 0.0) -> Array:
        """Return the torques, (n,), before the limits; arguments as for `command_checked`."""
        if self._constrained is not None:
            return self._shared(t, q, u, motion, moment, external)
        if self._mode is Mode.COMPUTED_TORQUE:
            tau = self._computed_torque(q, u, motion, moment)
        elif self._mode is Mode.INVERSE_DYNAMICS and motion is not None:
            tau = self._compensate.inverse_dynamics(self._source, *motion.sample(moment))
        else:
            tau = self.gravity_torque(q)
        if external is not None and self._mode is not Mode.GRAVITY_COMPENSATION:
            tau = tau - external
        return tau

    def gravity_torque(self, q: Array, t: float = 0.0) -> Array:
        """Return the torque that holds q, (n,), against gravity; zeros if it is switched off."""
        if not self._compensate.gravity:
            return np.zeros(len(self._names))
        if self._constrained is not None:
            return self._constrained.joint_torques(self._constrained.gravity(q, t), q, t)
        return self._source.gravity_force(q)

    def limit(self, t: float, tau: Array) -> Command:
        """Return `tau`, (n,), within the limits, as the command at stamp `t`, s."""
        return self._limiter.apply(t, tau)

    def resume(self, t: float | None, tau: Array) -> None:
        """Continue from `tau`, (n,), commanded elsewhere at `t`, s; None: the next stamp."""
        self._restart()
        self._limiter.resume(t, tau)

    def stop(self) -> Command:
        """Return zeros, regardless of limits, and restart with the next state."""
        self._restart()
        return self._limiter.stop()

    def _restart(self) -> None:
        self._pose = None
        if self._constrained is not None:
            self._constrained.restart()

    def _computed_torque(self, q: Array, u: Array, motion: Motion | None, moment: float,
                         t: float = 0.0) -> Array:
        """Return the torque towards the motion, or towards the pose that is held without one."""
        law = self._constrained
        if motion is not None:
            self._pose = None  # the pose at the end of the motion is held next
            desired = motion.sample(moment) if law is None else law.desired(motion, moment)
            return self._feedback(q, u, *desired, t)
        if self._pose is not None:
            return self._feedback(q, u, self._pose, self._zero, self._zero, t)
        here = q if law is None else q[law.places]
        tau = self._feedback(q, u, here, self._zero, self._zero, t)
        if np.isfinite(tau).all():  # a refused state is no pose
            self._pose = here.copy()
        return tau

    def _feedback(self, q: Array, u: Array, q_d: Array, u_d: Array, udot_d: Array,
                  t: float) -> Array:
        """Return the torque of the model at the measured state and the corrected acceleration."""
        if self._constrained is not None:
            return self._constrained.computed_torque(q, u, (q_d, u_d, udot_d), self._gains,
                                                     self._compensate, self._back, t)
        if self._compensate.complete and self.bending is None:
            whole: Array = self._law(q, u, q_d, u_d, udot_d, self._gains)
            return whole
        with np.errstate(over='ignore', invalid='ignore'):  # the kernel raises an error
            udot = corrected_acceleration(
                q, u, q_d, u_d, udot_d if self._compensate.inertia else self._zero, self._kp,
                self._kd)
        tau: Array = self._back @ self._source.torque_terms(q, u, udot)
        return tau + self.robot.friction_force(u_d) if self._compensate.friction else tau

    def _shared(self, t: float, q: Array, u: Array, motion: Motion | None, moment: float,
                external: Array | None) -> Array:
        """Return the joint torques, (n_q,), of a robot with chosen speeds or constraints."""
        law, terms = self._constrained, self._compensate
        assert law is not None
        if self._mode is Mode.COMPUTED_TORQUE:
            at, tau = q, self._computed_torque(q, u, motion, moment, t)
        elif self._mode is Mode.INVERSE_DYNAMICS and motion is not None:
            at, force = law.feedforward(q, motion, moment, terms, t)
            tau = law.joint_torques(force, at, t)
        else:
            force = law.gravity(q, t) if terms.gravity else np.zeros(len(self._speeds))
            at, tau = q, law.joint_torques(force, q, t)
        if external is not None and self._mode is not Mode.GRAVITY_COMPENSATION:
            tau = tau - law.share(external, at, t)
        return tau
