"""Results of a simulation in the user's independent speeds, converted from other choices."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

from kane_dynamics._util.typing import Array, Scalar, Vector
from kane_dynamics.mechanics.algebra.dual import moving, rates, values
from kane_dynamics.mechanics.ball_joints import coordinate_rates
from kane_dynamics.mechanics.equations import Equations
from kane_dynamics.native.runtime.kernel import Kernel
from kane_dynamics.native.tracing.program import Shape
from kane_dynamics.robot.kernel_set import KernelSet
from kane_dynamics.robot.robot import Robot
from kane_dynamics.simulation.step_kernels import tau_from
from kane_dynamics.simulation.torque_input import TorqueInput
from kane_dynamics.simulation.trajectory import constraint_residuals, sampled_quantities
import numpy as np

# For each simulation, the numbers of steps after which its choices of speeds begin, and
# the robots in these choices.
History = Sequence[Sequence[tuple[int, Robot]]]

# Kernels of `UserSpeeds` by their quantity and the user's speeds, for each robot.
_KERNELS: WeakKeyDictionary[KernelSet, dict[tuple[str, tuple[str, ...]], Kernel]] = (
    WeakKeyDictionary())


class _Part(NamedTuple):
    """The samples of a simulation that are in one choice of speeds."""

    simulation: int
    samples: slice


class UserSpeeds:
    """
    Conversion from other choices of independent speeds to the user's own.

    Parameters
    ----------
    user_robot : Robot
        The user's robot. Its speeds u = Y_I q' + Z_I are defined also where they are
        singular and do not determine q'.
    rows : stepper.RowSteps, optional
        Its rows with modes, if there are any.

    """

    def __init__(self, user_robot: Robot, rows: Any = None) -> None:
        """Store the robot; kernels compile on first use."""
        self._user_robot, self._rows = user_robot, rows

    def speeds(self, robot: Robot, q: Array, u: Array, udot: Array, t: Any) -> Array:
        """Return the user's speeds and their rates, (2, n) or (K, 2, n)."""
        names, equations = self._user_robot.speed_names, robot.equations

        def speeds(q: Vector, u: Vector, udot: Vector, t: Scalar) -> Any:
            return other_speeds(equations, names, q, u, udot, t)
        shapes = {'q': (robot.n_q,), 'u': (robot.n,), 'udot': (robot.n,)}
        return self._called(robot, 'other_speeds', shapes, (2, len(names)), speeds,
                            (q, u, udot), t)

    def torques(self, robot: Robot, q: Array, tau: Array, t: Any) -> Array:
        """Convert forces dual to the user's speeds to generalized forces, (n,) or (K, n)."""
        names, equations = self._user_robot.speed_names, robot.equations

        def torques(q: Vector, tau: Vector, t: Scalar) -> Any:
            return tau_from(equations, names, q, tau, t)
        shapes = {'q': (robot.n_q,), 'tau': (len(names),)}
        return self._called(robot, 'tau_from', shapes, (robot.n,), torques, (q, tau), t)

    def dual_forces(self, robot: Robot, q: Array, forces: Array, t: Array) -> Array:
        """Convert generalized forces to those dual to the user's speeds, (K, n)."""
        # The inverse of `torques`, whose columns are its values for unit forces.
        columns = []
        for unit in np.eye(forces.shape[1]):
            columns.append(self.torques(robot, q, np.tile(unit, (len(q), 1)), t))
        dual = np.linalg.solve(np.stack(columns, axis=-1), forces[..., None])
        return np.asarray(dual[..., 0], dtype=np.float64)

    def law_torques(self, history: History, source: TorqueInput, sampled: Array,
                    states: Array) -> Array:
        """
        Return the torques of a law at sampled states, (N, K, n), dual to the user's speeds.

        Each phase computes the law in its own speeds. Arguments as of `results`.
        """
        n_q, n = self._user_robot.n_q, self._user_robot.n
        tau = np.empty((*states.shape[:2], n))
        for robot, parts in _parts_by_robot(history, sampled):
            # A law is evaluated in the speeds of each phase, then its torques are
            # converted.
            of_phase = replace(source, robot=robot)
            for part in parts:
                rows = states[part]
                steps = sampled[part.samples]
                q = np.ascontiguousarray(rows[:, :n_q])
                u = np.ascontiguousarray(rows[:, n_q:n_q + n])
                forces = of_phase.torques(steps, q[None], u[None])[0]
                if robot.speed_names != self._user_robot.speed_names:
                    times = source.start + steps * np.float64(source.step)
                    forces = self.dual_forces(robot, q, forces, times)
                tau[part] = forces
        return tau

    def _called(self, robot: Robot, name: str, shapes: Mapping[str, Shape], shape: Shape,
                function: Any, inputs: tuple[Array, ...], t: Any) -> Array:
        """Call the kernel of a function of arrays and of what the robot supplies."""
        # Every simulation asks for these kernels; to ask `robot.compiled` takes a while.
        kernels = _KERNELS.setdefault(robot.kernels, {})
        key = name, self._user_robot.speed_names
        if key not in kernels:
            places = '_'.join(map(str, self._user_robot.mechanism.free))
            # A name for each choice of speeds, as the inputs of the kernel depend on
            # it.
            kernels[key] = robot.kernels.compiled(function, f'{name}_{places}', shapes,
                                                  shape, ahead=False)
        kernel = kernels[key]
        result: Array = kernel(*inputs, *robot.equations.time_inputs(t))
        return result

    def states(self, history: History, buffer: Array, start: float, step: float,
               done: int) -> Array:
        """Return a buffer of states after `done` steps, converted to the user's speeds."""
        result = buffer
        n_q = self._user_robot.n_q
        n = self._user_robot.n
        for i, changes in enumerate(history):
            if len(changes) == 1:
                # No change: the states are in the user's speeds already.
                continue
            # Choice k holds after step `begins[k]`, up to the begin of the next one.
            begins = [after + 1 for after, _ in changes]
            ends = [*begins[1:], done + buffer.shape[1]]
            for begin, end, (_, robot) in zip(begins, ends, changes):
                rows = np.arange(max(begin - done, 0), end - done)
                if len(rows) and robot.speed_names != self._user_robot.speed_names:
                    # Copied at the first change, because the steps go on from the
                    # buffer.
                    if result is buffer:
                        result = buffer.copy()
                    q = np.ascontiguousarray(buffer[i, rows, :n_q])
                    u = np.ascontiguousarray(buffer[i, rows, n_q:n_q + n])
                    times = start + (done + rows) * np.float64(step)
                    converted = self.speeds(robot, q, u, np.zeros_like(u), times)
                    result[i, rows, n_q:n_q + n] = converted[:, 0]
        return result

    def results(self, history: History, sampled: Array, times: Array, states: Array,
                tau: Array) -> dict[str, Array]:
        """
        Return derived quantities of sampled states, in the user's speeds.

        Parameters
        ----------
        history : sequences of (int, Robot)
            For each simulation, the step after which each choice begins.
        sampled, times : (K,) arrays
            Numbers of steps and times of the states, s.
        states, tau : (N, K, size), (N, K, n) arrays
            Simulated states, and torques dual to the user's speeds.

        Returns
        -------
        dict of (N, K, ...) arrays
            u, udot, energy, forces of stops, forces and residuals of constraints.

        """
        results: dict[str, Array] = {}
        if not len(states):  # no simulation has a choice, but results have their shapes
            quantities = self._derived(self._user_robot, states.reshape(0, states.shape[-1]),
                                       tau.reshape(0, tau.shape[-1]), times[:0])
            for name, quantity in quantities.items():
                results[name] = np.empty((*states.shape[:2], *quantity.shape[1:]),
                                         dtype=quantity.dtype)
            return results
        for robot, parts in _parts_by_robot(history, sampled):
            rows = np.concatenate([states[part] for part in parts])
            forces = np.concatenate([tau[part] for part in parts])
            row_times = np.concatenate([times[part.samples] for part in parts])
            for name, quantity in self._derived(robot, rows, forces, row_times).items():
                if name not in results:
                    shape = *states.shape[:2], *quantity.shape[1:]
                    results[name] = np.empty(shape, dtype=quantity.dtype)
                # The rows of all simulations were computed as one batch; each part gets
                # its own.
                begin = 0
                for part in parts:
                    count = part.samples.stop - part.samples.start
                    results[name][part] = quantity[begin:begin + count]
                    begin += count
        return results

    def _derived(self, robot: Robot, rows: Array, tau: Array,
                 times: Array) -> dict[str, Array]:
        """Return the quantities of `results` for states, (K, size), in one choice of speeds."""
        # States and torques in the speeds of `robot`, which may not be the user's.
        in_user_speeds = robot.speed_names == self._user_robot.speed_names
        q = np.ascontiguousarray(rows[:, :robot.n_q])
        generalized = tau if in_user_speeds else self.torques(robot, q, tau, times)
        results = sampled_quantities(robot, rows, generalized, times, self._rows)
        u, udot = results['u'], results['udot']
        friction = results.pop('friction', None)
        # What acts on the joints beside friction: actuators and stops.
        motors = self._actuator_torques(robot, q, generalized, tau, times)
        applied = results['stop_forces'] + motors
        results['constraint_forces'] = self._constraint_forces(
            robot, q, u, udot, applied, motors, times, friction)
        results |= constraint_residuals(robot, q, u, times)
        # Back to the user's speeds.
        if not in_user_speeds:
            converted = self.speeds(robot, q, u, udot, times)
            results['u'], results['udot'] = converted[:, 0], converted[:, 1]
        return results

    def _actuator_torques(self, robot: Robot, q: Array, generalized: Array, tau: Array,
                          times: Array) -> Array:
        """
        Return the torques that the actuators exert on the joints, (K, n_j).

        By default each acts on its own speed: of the user's robot, also in other speeds.
        """
        names = self._user_robot.speed_names
        equations = robot.equations

        def torques(q: Vector, tau: Vector, t: Scalar) -> Any:
            return actuator_torques(equations, names, q, tau, t)
        # Without stated actuators tau acts as the forces dual to the speeds.
        force = tau if equations.actuated is None else generalized
        shapes = {'q': (robot.n_q,), 'tau': force.shape[1:]}
        return self._called(robot, 'actuator_torques', shapes, (robot.equations.tree.n,), torques,
                            (q, force), times)

    def _constraint_forces(self, robot: Robot, q: Array, u: Array, udot: Array,
                           applied: Array, motors: Array, times: Array,
                           friction: Array | None) -> Array:
        """
        Return the forces of all rows, (K, m), in a motion under given joint forces.

        `friction`, (K, n_j), is given where it does not follow the smooth law.
        """
        equations = robot.equations
        of_joints = (equations.tree.n,)
        rows = (len(robot.constraint_names),)
        shapes = {'q': (robot.n_q,), 'u': (robot.n,), 'udot': (robot.n,),
                  'applied': of_joints}
        # With friction computed apart, it is among the applied forces; else the motors
        # decide the loads of drives.
        if friction is not None:
            return self._called(robot, 'constraint_forces_without_friction', shapes, rows,
                                equations.constraint_forces_without_friction,
                                (q, u, udot, applied - friction), times)
        shapes['motors'] = of_joints
        return self._called(robot, 'constraint_forces_of_motion', shapes, rows,
                            equations.constraint_forces_of_motion,
                            (q, u, udot, applied, motors), times)


def _parts_by_robot(history: History, sampled: Array) -> list[tuple[Robot, list[_Part]]]:
    """Return the samples of each choice of speeds, in all simulations."""
    groups: dict[Robot, list[_Part]] = {}
    for i, changes in enumerate(history):
        # Samples after the begin of each choice belong to it.
        begins = np.searchsorted(sampled, [step for step, _ in changes],
                                 side='right').tolist()
        ends = [*begins[1:], len(sampled)]
        for begin, end, (_, robot) in zip(begins, ends, changes):
            if end > begin:
                groups.setdefault(robot, []).append(_Part(i, slice(begin, end)))
    return list(groups.items())


def actuator_torques(equations: Equations, names: Sequence[str], q: Any, tau: Any,
                     t: Any = 0.0) -> Any:
    """
    Return the joint torques of the actuators, (n_j,).

    With `actuated`, tau is dual to the speeds of the equations; else to the named
    speeds, and each entry acts on its own speed.
    """
    if equations.actuated is not None:
        return equations.shared_torques(q, tau, t)
    state = equations.mechanism.state(q, t, equations.tree.geometry)
    return state.speed_rows(names)[0].T @ tau


def other_speeds(equations: Equations, names: Sequence[str], q: Any, u: Any,
                 udot: Any, t: Any = 0.0) -> Any:
    """Return the named speeds and their rates in a motion, (2, k)."""
    motion = equations.joint_motion(q, u, udot, t)
    q_moving = moving(q, coordinate_rates(equations.model, q, motion.qdot))
    state = equations.mechanism.state(q_moving, moving(t, 1.0), equations.tree.geometry)
    Y, Z = state.speed_rows(names)
    return np.array([values(Y) @ motion.qdot + values(Z),
                     values(Y) @ motion.qddot + rates(Y) @ motion.qdot + rates(Z)])


def law_power(history: History, source: Any, buffer: Array, done: int,
              rows: Array) -> Array:
    """
    Return the power of computed torque in the speeds of each state, (N, rows), W.

    Parameters
    ----------
    history : sequences of (int, Robot)
        For each simulation, the step after which each choice of speeds begins.
    source : TorqueInput
        Of computed torque.
    buffer : (N, K + 1, size) array
        States after `done` steps, and after each of the next K.
    done : int
        Number of earlier steps.
    rows : (k,) array of int
        Row numbers of the buffer.

    """
    power = np.empty((len(buffer), len(rows)))
    # Simulations that never changed their speeds are computed together.
    unchanged = [i for i, changes in enumerate(history) if len(changes) == 1]
    if unchanged:
        power[unchanged] = source.acting(buffer[unchanged], done)(rows)
    # Others phase by phase, with the robot of the phase.
    for i, changes in enumerate(history):
        if len(changes) > 1:
            phase = np.searchsorted([after for after, _ in changes], done + rows) - 1
            for k in np.unique(phase):
                in_phase = phase == k
                of_phase = replace(source, robot=changes[k][1])
                power_at = of_phase.acting(buffer[i:i + 1], done)
                power[i, in_phase] = power_at(rows[in_phase])[0]
    return power
