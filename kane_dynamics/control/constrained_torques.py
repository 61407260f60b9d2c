"""
The torques of `Controller` for robots with chosen speeds or constraints.

The law gives a generalized force tau, dual to the independent speeds; `Robot.joint_torques` shares
it among the actuators. With a preload p of more actuators than independent speeds, the torques are
those nearest to p: share(tau) + p - share(T^T p).
"""

from collections.abc import Callable, Sequence
from typing import Any

from kane_dynamics._util.checks import constant
from kane_dynamics._util.fork_safety import lazy_property
from kane_dynamics._util.typing import Array
from kane_dynamics.control.computed_torque_law import corrected_acceleration
from kane_dynamics.control.constrained_law import (constrained_law_kernel, followed_joints,
                                                   motion_columns, require_closed)
from kane_dynamics.control.quasi_static import QuasiStatic
from kane_dynamics.control.terms import Terms
from kane_dynamics.errors import InputError
from kane_dynamics.loop_tracking.loop_tracker import LoopTracker
from kane_dynamics.mechanics.constraints.conditioning import SINGULAR
from kane_dynamics.motion.motion import Motion, State
from kane_dynamics.native.runtime.kernel import Kernel
from kane_dynamics.robot.robot import Robot, TORQUE_TERMS
from numpy.typing import ArrayLike

CORIOLIS, FRICTION = (TORQUE_TERMS.index(name) for name in ('coriolis', 'friction'))


class ConstrainedTorques:
    """
    Inverse dynamics, computed torque and gravity of a robot with chosen speeds or constraints.

    Parameters
    ----------
    robot : Robot
    followed : sequence of str, optional
        As for `ComputedTorque`.
    preload : (n_q,) array_like, optional
        Joint torques, N m or N, to which those of the command are nearest.
    bending : QuasiStatic, optional
        The flexible robot of which `robot` is the rigid model; its torques are computed.

    """

    def __init__(self, robot: Robot, followed: Sequence[str] | None,
                 preload: ArrayLike | None, bending: QuasiStatic | None = None) -> None:
        """Find the joints that follow; kernels compile on first use."""
        self._robot, self._equations = robot, robot.equations
        self._bending, self._source = bending, bending or robot
        self.places = list(followed_joints(robot, followed))
        self.followed = tuple(robot.coordinate_names[k] for k in self.places)
        if bending is not None:
            bending.require_drives('followed', self.followed)
            bending.require_drives('actuated', robot.actuated_names)
        self._preload = None if preload is None else self._checked(preload)
        self._tracking = False  # whether the last feedforward was of the same motion of joints
        self._functions: dict[str, Callable[..., Array]] = {}

    def _checked(self, preload: ArrayLike) -> Array:
        """Return the preload; InputError unless it loads redundant actuators alone."""
        robot, equations = self._robot, self._equations
        torques = constant(preload, (robot.n_q,), 'preload', InputError)
        actuated = equations.actuated or []
        others = [name for k, name in enumerate(robot.coordinate_names)
                  if torques[k] and k not in actuated]
        if len(actuated) <= robot.n or others:
            raise InputError(f'preload: {torques.tolist()}, with {len(actuated)} actuated joints '
                             f'and {robot.n} independent speeds; expected torques at actuated '
                             'joints, of a robot with more of them than independent speeds '
                             '(Robot(..., actuated=...))')
        return torques

    def check(self, motion: Motion) -> None:
        """Raise InputError unless a motion is of the joints that follow, or of all and closed."""
        motion_columns(self._robot, self.places, motion.joint_names)
        require_closed(self._robot, motion.positions, motion.times)

    def restart(self) -> None:
        """Close the loops from the next measured state on."""
        self._tracking = False

    def compile(self) -> None:  # noqa: A003
        """Compile the kernels of the law with all terms."""
        constrained_law_kernel(self._robot, self.places, commanded=True)
        self._robot.compile('joint_torques')
        self._tracker  # noqa: B018
        if self._bending is not None:
            self._bending.robot.compile('inverse_dynamics', 'torque_terms', 'gravity_force')

    def desired(self, motion: Motion, moment: float) -> State:
        """Return q, u, udot of the joints that follow at a time of the motion, s."""
        state = motion.sample(moment)
        if motion.n == len(self.places):
            return state
        q, u, udot = (x[self.places] for x in state)
        return q, u, udot

    def computed_torque(self, q: Array, u: Array, desired: State, gains: Array, terms: Terms,
                        back: Array, t: float) -> Array:
        """Return the joint torques of computed torque; `back` weights all but friction."""
        if terms.complete and self._bending is None:
            return self._preloaded(self._law(t)(q, u, *desired, gains), q, t)
        (q_d, u_d, udot_d), robot, at = desired, self._robot, self._at(t)
        n = len(self.places)
        qdot = robot.joint_rates(q, u, **at)[self.places]
        qddot = corrected_acceleration(q[self.places], qdot, q_d, u_d,
                                       udot_d if terms.inertia else 0.0 * udot_d,
                                       gains[:n], gains[n:])
        tau = back @ self._terms(q, u, qddot, t)
        if terms.friction:
            wanted = self._called('followed_speeds', self._speeds, (q, u_d), t)
            tau = tau + robot.torque_terms(q, wanted, 0.0 * wanted, **at)[FRICTION]
        return self.joint_torques(tau, q, t)

    def _law(self, t: float) -> Callable[..., Array]:
        """Return the joint torques as a function of states and gains, at a time."""
        if 'law' not in self._functions or self._equations.timed:
            kernel = constrained_law_kernel(self._robot, self.places, commanded=True)
            more: list[Any] = [None] if len(self._robot.kernels.no_wrench) else []

            def checked(*given: Array) -> Array:
                result: Array = kernel(*given, *more, *self._at(t).values())
                return result
            self._functions['law'] = checked if self._equations.timed else kernel.entry(
                '', checked)
        return self._functions['law']

    def feedforward(self, q: Array, motion: Motion, moment: float, terms: Terms,
                    t: float) -> tuple[Array, Array]:
        """Return the desired configuration and the generalized force of its motion."""
        (q_d, u_d, udot_d), (*_, qddot) = self.desired_state(q, motion, moment, t)
        if terms.complete:
            return q_d, self._source.inverse_dynamics(q_d, u_d, udot_d, **self._at(t))
        tau: Array = terms.weights @ self._terms(q_d, u_d, qddot, t)
        return q_d, tau

    def desired_state(self, q: Array, motion: Motion, moment: float,
                      t: float) -> tuple[State, State]:
        """Return q (n_q,), u, udot of a motion, and of the joints that follow, at measured q."""
        followed = self.desired(motion, moment)
        q_d, u_d = self._closed(q, motion.sample(moment)[0], followed[0], followed[1], t)
        return (q_d, u_d, self.rates(q_d, u_d, followed[2], t)), followed

    def rates(self, q: Array, u: Array, qddot: Array, t: float) -> Array:
        """Return udot, (n,), for accelerations of the joints that follow."""
        return self._called('followed_rates', self._rates, (q, u, qddot), t)

    def _terms(self, q: Array, u: Array, qddot: Array, t: float) -> Array:
        """
        Return inverse dynamics by source, (5, n), for accelerations of the joints that follow.

        The inertia term is that of these accelerations, not of udot, so that the terms do not
        depend on the choice of speeds.
        """
        robot, at = self._robot, self._at(t)
        drift, whole = (self.rates(q, u, x, t) for x in (0.0 * qddot, qddot))
        rows: Array = self._source.torque_terms(q, u, whole - drift, **at)
        rows[CORIOLIS] += robot.mass_matrix(q, **at) @ drift
        return rows

    def gravity(self, q: Array, t: float) -> Array:
        """Return the generalized force that balances gravity."""
        return self._source.gravity_force(q, **self._at(t))

    def joint_torques(self, tau: Array, q: Array, t: float) -> Array:
        """Return the torques of the joints, (n_q,), with a generalized force."""
        return self._preloaded(self.share(tau, q, t), q, t)

    def share(self, tau: Array, q: Array, t: float) -> Array:
        """Return `joint_torques` without the preload."""
        return self._robot.joint_torques(tau, q, **self._at(t))

    def _preloaded(self, torques: Array, q: Array, t: float) -> Array:
        """Return joint torques, (n_q,), with the part of the preload that moves nothing."""
        p = self._preload
        if p is None:
            return torques
        force = self._robot.generalized_force(p, q, **self._at(t))
        return torques + (p - self.share(force, q, t))

    def _at(self, t: float) -> dict[str, Any]:
        return {'t': t} if self._equations.timed else {}

    @lazy_property
    def _tracker(self) -> LoopTracker:
        """Return the loop closure of desired motions."""
        return LoopTracker(self._robot, self.followed, max_figure=SINGULAR)

    def _closed(self, measured: Array, desired: Array, q: Array, rates: Array,
                t: float) -> tuple[Array, Array]:
        """
        Return the closed configuration and the speeds of desired followed joints, (n,) each.

        It is on the branch of the measured configuration at the first call after `restart`, or of
        the desired one if that is of all joints.
        """
        tracker, whole = self._tracker, len(desired) == self._robot.n_q
        if tracker.path_rows and not whole:
            raise InputError(f'motion: of {len(q)} joints, with {", ".join(tracker.path_rows)}; '
                             'expected a motion of all joints, because a constraint on '
                             'velocities leaves the configuration to the path, or computed '
                             'torque')
        if whole or not self._tracking:
            tracker.restart(desired if whole else measured, t)
        tracker.update(q, rates, t=t)
        self._tracking = not whole
        return tracker.q.copy(), tracker.u.copy()

    def _speeds(self, q: Any, qdot: Any, t: Any) -> Any:
        """Return u for given rates of the joints that follow."""
        motion = self._equations.at_rest(q, t)
        return self._solved(motion, qdot - motion.qdot[self.places])

    def _rates(self, q: Any, u: Any, qddot: Any, t: Any) -> Any:
        """Return udot for given accelerations of the joints that follow."""
        motion = self._equations.joint_motion(q, u, self._equations.zeros, t)
        return self._solved(motion, qddot - motion.qddot[self.places])

    def _solved(self, motion: Any, rates: Any) -> Any:
        return self._equations.mechanism.solved(motion.T[self.places], rates)

    def _called(self, name: str, function: Callable[..., Any], given: tuple[Array, ...],
                t: float) -> Array:
        """Return the result of a traced function of arrays and the time."""
        timed = self._equations.timed
        if name not in self._functions:
            kernel = self._traced(name, function, given)
            self._functions[name] = kernel.entry('', kernel)
        return self._functions[name](*given, *([t] if timed else []))

    def _traced(self, name: str, function: Callable[..., Any],
                given: tuple[Array, ...]) -> Kernel:
        """Trace a function of arrays and the time, and return its compiled kernel."""
        robot = self._robot
        shapes = {f'x{k}': x.shape for k, x in enumerate(given)}

        def traced(*x: Any, t: Any) -> Any:
            return function(*x, t)
        return robot.compiled(traced, name=f'{name}_{"_".join(map(str, self.places))}', **shapes,
                              shape=(robot.n,))
