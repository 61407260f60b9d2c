"""Results of a simulation in the user's independent speeds, converted from other choices."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from kane_dynamics._util.typing import Array
from kane_dynamics.mechanics.algebra.dual import moving, rates, values
from kane_dynamics.mechanics.ball_joints import coordinate_rates
from kane_dynamics.mechanics.constraints.constrained_equations import ConstrainedEquations
from kane_dynamics.native.runtime.argument import Argument
from kane_dynamics.native.tracing.program import trace_program
from kane_dynamics.robot.robot import Robot
from kane_dynamics.simulation.stops.contact_forces import with_stop_forces
import numpy as np


class UserSpeeds:
    """
    Conversion from other choices of independent speeds to the user's own.

    Parameters
    ----------
    asked : Robot
        The user's robot. Its speeds u = Y_I q' + Z_I are defined also where they are singular and
        do not determine q'.

    """

    def __init__(self, asked: Robot, stops: bool = False) -> None:
        """Store the robot, and whether stops hold its joints; kernels compile on first use."""
        self._asked, self._stops = asked, stops

    def speeds(self, robot: Robot, q: Array, u: Array, udot: Array, t: Any) -> Array:
        """Return the user's speeds and their rates, (2, n) or (K, 2, n)."""
        names, equations = self._asked.speed_names, _equations(robot)
        arguments = [Argument('q', (robot.n_q,)), Argument('u', (robot.n,)),
                     Argument('udot', (robot.n,))]
        return self._called(robot, 'other_speeds', arguments, (2, len(names)), lambda *x:
                            other_speeds(equations, names, *x), (q, u, udot), t)

    def torques(self, robot: Robot, q: Array, tau: Array, t: Any) -> Array:
        """Convert forces dual to the user's speeds to generalized forces, (n,) or (K, n)."""
        names, equations = self._asked.speed_names, _equations(robot)
        arguments = [Argument('q', (robot.n_q,)), Argument('tau', (len(names),))]
        return self._called(robot, 'tau_from', arguments, (robot.n,), lambda *x:
                            tau_from(equations, names, *x), (q, tau), t)

    def _called(self, robot: Robot, name: str, arguments: list[Argument], shape: Any,
                function: Any, given: tuple[Array, ...], t: Any, physical: bool = False
                ) -> Array:
        """Call the kernel of a function of given arrays, of gravity and payload, and the time."""
        timed = robot.equations.timed
        arguments = [*arguments, *([Argument('t', ())] if timed else [])]
        block, count = robot.parameters.block, len(given)
        places = '_'.join(map(str, self._asked.mechanism.free))

        def traced(*x: Any) -> Any:
            parameters = [x[-1][:robot.parameters.physical]] if physical else []
            return function(*x[:count], *parameters, x[count][()] if timed else 0.0)
        kernel = robot.kernels.extra(f'{name}_{places}', lambda: trace_program(
            name, traced, [*((a.name, a.shape) for a in arguments), ('parameters', block.shape)]),
            arguments, block, shape)
        result: Array = kernel(*given, *([t] if timed else []))
        return result

    def states(self, history: Sequence[Sequence[tuple[int, Robot]]], buffer: Array, start: float,
               step: float, done: int) -> Array:
        """Return a buffer of states after `done` steps, converted to the user's speeds."""
        result, n_q, n = buffer, self._asked.n_q, self._asked.n
        for i, changes in enumerate(history):
            if len(changes) == 1:
                continue
            ends = [*(after for after, _ in changes[1:]), done + buffer.shape[1] - 1]
            for (after, robot), end in zip(changes, ends):
                rows = np.arange(max(after + 1 - done, 0), end + 1 - done)
                if len(rows) and robot.speed_names != self._asked.speed_names:
                    result = buffer.copy() if result is buffer else result
                    q, u = (np.ascontiguousarray(buffer[i, rows, part])
                            for part in (slice(n_q), slice(n_q, n_q + n)))
                    times = start + (done + rows) * np.float64(step)
                    result[i, rows, n_q:n_q + n] = self.speeds(robot, q, u, np.zeros_like(u),
                                                               times)[:, 0]
        return result

    def results(self, history: Sequence[Sequence[tuple[int, Robot]]], kept: Array, times: Array,
                states: Array, tau: Array) -> dict[str, Array]:
        """
        Return derived quantities of kept states, in the user's speeds.

        Parameters
        ----------
        history : sequences of (int, Robot)
            For each simulation, the step after which each choice begins.
        kept, times : (K,) arrays
            Numbers of steps and times of the states, s.
        states, tau : (N, K, size), (N, K, n) arrays
            Simulated states, and torques dual to the user's speeds.

        Returns
        -------
        dict of (N, K, ...) arrays
            u, udot, energy, forces of stops, forces and residuals of constraints.

        """
        groups: dict[int, tuple[Robot, list[tuple[int, slice]]]] = {}
        for i, changes in enumerate(history):
            begins = np.searchsorted(kept, [step for step, _ in changes], side='right')
            for (_, robot), first, last in zip(changes, begins, [*begins[1:], len(kept)]):
                if last > first:
                    groups.setdefault(id(robot), (robot, []))[1].append((i, slice(first, last)))
        result: dict[str, Array] = {}
        for robot, places in groups.values():
            rows, forces = (np.concatenate([x[i, part] for i, part in places])
                            for x in (states, tau))
            moments = np.concatenate([times[part] for _, part in places])
            for name, found in self._derived(robot, rows, forces, moments).items():
                if name not in result:
                    result[name] = np.empty((*states.shape[:2], *found.shape[1:]))
                begin = 0
                for i, part in places:
                    count = part.stop - part.start
                    result[name][i, part] = found[begin:begin + count]
                    begin += count
        return result

    def _derived(self, robot: Robot, rows: Array, tau: Array, times: Array) -> dict[str, Array]:
        at: dict[str, Any] = {'t': times} if robot.equations.timed else {}
        q, u = (np.ascontiguousarray(rows[:, part]) for part in (
            slice(robot.n_q), slice(robot.n_q, robot.n_q + robot.n)))
        same = robot.speed_names == self._asked.speed_names
        own = tau if same else self.torques(robot, q, tau, times)
        udot, stop_forces = actual_accelerations(robot, q, u, own, self._stops, **at)
        applied = stop_forces + self._actuator_torques(robot, q, own, tau, times)
        pair = np.stack([u, udot], axis=1) if same else self.speeds(robot, q, u, udot, times)
        return {'u': pair[:, 0], 'udot': pair[:, 1],
                'energy': np.stack([robot.kinetic_energy(q, u, **at), robot.potential_energy(q)],
                                   axis=1),
                'stop_forces': stop_forces,
                'constraint_forces': self._constraint_forces(robot, q, u, udot, applied, times),
                **constraint_residuals(robot, q, u, **at)}

    def _actuator_torques(self, robot: Robot, q: Array, own: Array, tau: Array,
                          times: Array) -> Array:
        """
        Return the torques that the actuators exert on the joints, (K, n_j).

        By default each acts on its own speed: of the user's robot, also in other speeds.
        """
        names, equations = self._asked.speed_names, _equations(robot)
        dual_to = robot if equations.actuated is not None else self._asked
        force = own if dual_to is robot else tau
        arguments = [Argument('q', (robot.n_q,)), Argument('tau', (dual_to.n,))]
        return self._called(robot, 'actuator_torques', arguments, (robot.model.n,), lambda *x:
                            actuator_torques(equations, names, *x), (q, force), times)

    def _constraint_forces(self, robot: Robot, q: Array, u: Array, udot: Array, applied: Array,
                           times: Array) -> Array:
        """Return the forces of all rows, (K, m), in a motion under given joint forces."""
        equations = _equations(robot)
        arguments = [Argument('q', (robot.n_q,)), Argument('u', (robot.n,)),
                     Argument('udot', (robot.n,)), Argument('applied', (robot.model.n,))]
        return self._called(robot, 'constraint_forces_of_motion', arguments,
                            (len(robot.constraint_names),), equations.constraint_forces_of_motion,
                            (q, u, udot, applied), times, physical=True)


def actual_accelerations(robot: Robot, q: Array, u: Array, tau: Array, stops: bool,
                         **at: Any) -> tuple[Array, Array]:
    """Return udot, (K, n), and the forces of the stops on the joints, (K, n_j), at K states."""
    udot: Array = robot.forward_dynamics(q, u, tau, **at)
    if not stops:
        return udot, np.zeros((len(q), robot.model.n))
    return with_stop_forces(robot, q, u, udot, robot.limits.lower, robot.limits.upper, **at)


def constraint_rows(robot: Robot, q: Array, u: Array, tau: Array, **at: Array
                    ) -> dict[str, Array]:
    """Return forces and residuals of the constraints along a motion, (K, m) arrays."""
    return {'constraint_forces': robot.constraint_forces(q, u, tau, **at),
            **constraint_residuals(robot, q, u, **at)}


def constraint_residuals(robot: Robot, q: Array, u: Array, **at: Array) -> dict[str, Array]:
    """Return the residuals of the constraints along a motion, (K, m) arrays."""
    return {'constraint_residual': robot.constraint_residual(q, **at),
            'constraint_velocity_residual': robot.constraint_velocity_residual(q, u, **at)}


def actuator_torques(equations: ConstrainedEquations, names: Sequence[str], q: Any, tau: Any,
                     t: Any = 0.0) -> Any:
    """
    Return the joint torques of the actuators, (n_j,).

    With `actuated`, tau is dual to the speeds of the equations; else to the named speeds, and each
    entry acts on its own speed.
    """
    if equations.actuated is not None:
        return equations.shared_torques(q, tau, t)
    here = equations.mechanism.state(q, t, equations.tree.geometry)
    return here.speed_rows(names)[0].T @ tau


def tau_from(equations: ConstrainedEquations, names: Sequence[str], q: Any, tau: Any,
             t: Any = 0.0) -> Any:
    """Convert forces dual to the named speeds to generalized forces, (n,)."""
    if tuple(names) == equations.speed_names:
        return tau
    here = equations.mechanism.state(q, t, equations.tree.geometry)
    return equations.at_rest(q, t).T.T @ (here.speed_rows(names)[0].T @ tau)


def other_speeds(equations: ConstrainedEquations, names: Sequence[str], q: Any, u: Any,
                 udot: Any, t: Any = 0.0) -> Any:
    """Return the named speeds and their rates in a motion, (2, k)."""
    motion = equations.joint_motion(q, u, udot, t)
    q_moving = moving(q, coordinate_rates(equations.model, q, motion.qdot))
    Y, Z = equations.mechanism.state(q_moving, moving(t, 1.0),
                                     equations.tree.geometry).speed_rows(names)
    return np.array([values(Y) @ motion.qdot + values(Z),
                     values(Y) @ motion.qddot + rates(Y) @ motion.qdot + rates(Z)])


def law_power(history: Sequence[Sequence[tuple[int, Robot]]], source: Any, buffer: Array,
              done: int, rows: Array) -> Array:
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
    plain = [i for i, changes in enumerate(history) if len(changes) == 1]
    found = np.empty((len(buffer), len(rows)))
    if plain:
        found[plain] = source.acting(buffer[plain], done)(rows)
    for i, changes in enumerate(history):
        if len(changes) > 1:
            phase = np.searchsorted([after for after, _ in changes], done + rows) - 1
            for k in np.unique(phase):
                own = replace(source, robot=changes[k][1])
                found[i, phase == k] = own.acting(buffer[i:i + 1], done)(rows[phase == k])[0]
    return found


def _equations(robot: Robot) -> ConstrainedEquations:
    assert isinstance(robot.equations, ConstrainedEquations)
    return robot.equations
