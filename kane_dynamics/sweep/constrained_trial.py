"""
Kernels of one trial of a robot with chosen speeds or constraints.

With q' = T u + X and the friction f of the joints, the net generalized force is tau - T^T f. The
step is that of `simulate`: the integrator, one Newton step on the loops, and the margin of the
state, which is positive where the independent speeds are well conditioned and the loops closed.
"""

from collections.abc import Sequence
from typing import Any

from kane_dynamics._util.fork_safety import lazy_property
from kane_dynamics.control.computed_torque import law_margin, law_program
from kane_dynamics.control.controller import Mode
from kane_dynamics.mechanics.algebra.dual import select
from kane_dynamics.mechanics.ball_joints import on_unit_quaternions
from kane_dynamics.mechanics.constraints.conditioning import (EXCESS, in_lengths, loosened,
                                                              WELL_CHOSEN)
from kane_dynamics.mechanics.integrators.rosenbrock import ImplicitStep
from kane_dynamics.native.tracing.program import Program, Shape, trace_program
from kane_dynamics.native.tracing.subroutine import call
from kane_dynamics.robot.robot import Robot
from kane_dynamics.robot.speed_sets import limits_of
from kane_dynamics.simulation.energy_balance import driven_kernel
from kane_dynamics.simulation.speed_switching import STEP_RESIDUAL
from kane_dynamics.simulation.step_kernels import implicit_stage, margin_count, time_input
from kane_dynamics.sweep.trial import Parts, parts, Trial, TrialMotion
import numpy as np


class ConstrainedTrial(Trial):
    """
    Kernels of the trials of a robot with chosen speeds or constraints; arguments as `Trial`.

    Parameters
    ----------
    followed : sequence of int
        Indices of the joints that follow by computed torque, among the tracked ones.

    """

    def __init__(self, given: Robot, payload_frame: str | None, integrator: str,
                 tracked: Sequence[int], followed: Sequence[int] = ()) -> None:
        """Create the robot; kernels compile at the first use."""
        super().__init__(given, payload_frame, integrator, tracked)
        self.followed = list(followed)
        mechanism = self.robot.mechanism
        self.limits = limits_of(WELL_CHOSEN * float(np.sqrt(mechanism.model.n)),
                                in_lengths(mechanism, loosened(mechanism, STEP_RESIDUAL)),
                                loosened(mechanism, EXCESS))

    def _parts(self) -> Parts:
        return parts(self.robot.n_q, self.n, len(self.tracked), int(self.equations.timed),
                     margin_count(self.robot))

    def _step(self, controller: str, state: Any, desired: Any, plant: Any, shared: Any) -> Any:
        """Return the state after one step."""
        at, equations, robot = self.parts, self.equations, self.robot
        motion = _ConstrainedMotion(self, controller, desired, plant, shared, state[at.time])
        after = self.integrator.step(motion, state[:at.tau.start], shared[0])
        q, t = after[at.q], time_of(after[at.time])
        for k in range(at.margin.start, at.margin.stop):
            after[k] = equations.margin(q, t, self.limits)
        if equations.keeps_positions(q, t):
            q = equations.closure_step(q, t)
        after[at.q] = q = on_unit_quaternions(robot.model, q)
        if controller == Mode.COMPUTED_TORQUE and at.margin.start < at.margin.stop:
            follows = law_margin(robot, self.followed, q, t)
            before = after[at.margin.start]
            if not isinstance(follows, float):
                after[at.margin.start] = select(follows < before, follows, before)
        tau = motion.law(state[at.q], state[at.u], desired[0], state[at.time])
        return [*after, *tau]

    def law(self, controller: str, gains: Any, assumed: Any) -> Any:
        """Return the control law: torque from q, u, the desired motion and the time, if any."""
        if controller == Mode.COMPUTED_TORQUE:
            program = law_program(self.robot, self.followed)
            own = [self.tracked.index(k) for k in self.followed]
            return lambda q, u, wanted, time: np.array(call(
                program, q, u, *(x[own] for x in np.split(wanted, 3)), gains, *time,
                padded(self.robot, assumed)))
        if controller == Mode.GRAVITY_COMPENSATION:
            return lambda q, u, wanted, time: self.equations.gravity_force(q, assumed,
                                                                           time_of(time))
        return lambda q, u, wanted, time: np.zeros(self.n).astype(object)

    def _energies(self, state: Any, plant: Any, shared: Any) -> Any:
        """Return the kinetic and the potential energy, J."""
        q, u, equations = state[self.parts.q], state[self.parts.u], self.equations
        carried, _ = self.parameters(plant, shared)
        t = time_of(state[self.parts.time])
        return [equations.kinetic_energy(q, u, carried, t),
                equations.potential_energy(q, carried, t)]

    @lazy_property
    def motion_program(self) -> Program:
        """Return the program of q', udot and the power that changes the energy, (n_q + n + 1,)."""
        free: Any = self.frictionless.equations
        tree, driven = self.equations.tree, driven_kernel(self.robot) is not None

        def rates(q: Any, u: Any, tau: Any, factors: Any, *rest: Any) -> Any:
            *time, parameters = rest
            t = time[0][()] if time else 0.0
            motion = free.joint_motion(q, u, free.zeros, t)
            net = tau - motion.T.T @ (factors * tree.friction_force(motion.qdot))
            power = net @ u if not driven else free.actual_joint_forces(
                q, u, net, parameters, t) @ motion.qdot
            return [*free.state_rates(q, u, net, None, parameters, t), power]
        physical: Shape = (self.robot.parameters.physical,)
        return trace_program('trial_rates', rates, [
            ('q', (self.robot.n_q,)), ('u', (self.n,)), ('tau', (self.n,)),
            ('factors', (self.robot.model.n,)), *time_input(self.robot), ('parameters', physical)])


class _ConstrainedMotion(TrialMotion):
    """A trial during one traced step of a constrained robot."""

    _trial: ConstrainedTrial

    def __init__(self, trial: ConstrainedTrial, controller: str, desired: Any, plant: Any,
                 shared: Any, start: Any) -> None:
        """Split the arguments of the step, which begins at the time `start`, (0 or 1,)."""
        super().__init__(trial, controller, desired, plant, shared)
        self._start, self._h = start, shared[0]

    @lazy_property
    def _stage(self) -> Program:
        return implicit_stage(self._trial.robot, ImplicitStep(self.equations), varied=True)

    def _time(self, moment: int) -> list[Any]:
        """Return the time at a moment, or nothing if the equations do not depend on it."""
        return [t + (0.5 * moment) * self._h for t in self._start]

    def _found(self, q: Any, u: Any, moment: int, time: Any) -> Any:
        """Return q', udot and the power."""
        tau = self.law(q, u, self._desired[moment], time)
        return call(self._trial.motion_program, q, u, tau, self._factors, *time, self._carried)

    def rates(self, state: Any, moment: int) -> Any:
        """Return the time derivative of q, u, time, work, squared errors and margin."""
        at = self._trial.parts
        q, time = state[at.q], state[at.time]
        *moving, power = self._found(q, state[at.u], moment, time)
        return np.array([*moving, *self._sums(q, moment, power)])

    def _sums(self, q: Any, moment: int, power: Any) -> list[Any]:
        """Return the rates of the entries beside q and u."""
        margins = self._trial.parts.margin
        return [*(1.0 for _ in self._start), power, *self._squared_errors(q, moment),
                *[0.0] * (margins.stop - margins.start)]

    def torque(self, q: Any, u: Any, moment: int) -> Any:
        """Return the torque of the controller and the plant's deviation from model friction."""
        time = self._time(moment)
        motion = self.equations.joint_motion(q, u, self.equations.zeros, time_of(time))
        friction = self.equations.tree.friction_force(motion.qdot)
        return (self.law(q, u, self._desired[moment], time)
                + motion.T.T @ ((1.0 - self._factors) * friction))

    def implicit_stage(self, q: Any, u: Any, tau: Any, before: tuple[Any, Any], g: Any,
                       moment: int) -> tuple[Any, Any]:
        """Return joint rates and udot of a stage of the linearly implicit equations."""
        found = np.array(call(self._stage, q, u, tau, *before, np.array(g), self._factors,
                              *self._time(moment), padded(self._trial.robot, self._carried)))
        n_j = self._trial.robot.model.n
        return found[:n_j], found[n_j:]

    def quadratures(self, q: Any, u: Any, moment: int) -> Any:
        """Return the rates of time, work, squared errors and margin."""
        *_, power = self._found(q, u, moment, self._time(moment))
        return np.array(self._sums(q, moment, power))


def time_of(time: Any) -> Any:
    """Return the time of an array with one entry, or 0."""
    return time[0] if len(time) else 0.0


def padded(robot: Robot, parameters: Any) -> Any:
    """Return parameters as the robot's own, with limits of margins that no law reads."""
    return np.array([*parameters, *[0.0] * robot.equations.limits])
