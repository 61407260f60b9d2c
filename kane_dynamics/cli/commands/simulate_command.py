"""The command `simulate`: forward dynamics over time."""

from argparse import Namespace
import math
import time
from typing import Any, NamedTuple

from kane_dynamics._util.checks import increasing
from kane_dynamics._util.progress import progress_bar
from kane_dynamics._util.typing import Array
from kane_dynamics.cli import pictures
from kane_dynamics.cli.printing import (model_warnings, print_files, print_json,
                                        print_table, without_rounding)
from kane_dynamics.cli.robot_options import (load_robot, one_or_all, positions,
                                             speed_vector, split)
from kane_dynamics.cli.tables import read_motion, read_states
from kane_dynamics.control.computed_torque import ComputedTorque
from kane_dynamics.errors import InputError
from kane_dynamics.robot.robot import Robot
from kane_dynamics.simulation.contact import Contact, load_contacts
from kane_dynamics.simulation.simulate import simulate
from kane_dynamics.simulation.trajectory import ContactMode, Trajectory
import numpy as np

PRINTED_EVENTS = 10  # --json has all


class Plan(NamedTuple):
    """Initial state, duration in s, and source of the torques of a simulation."""

    q0: Array
    u0: Array
    duration: float
    torque: Any


def simulation(options: Namespace) -> None:
    """Simulate; save and plot on request; print a summary."""
    plot = pictures.plotter(options)  # errors early
    _, robot = load_robot(options)
    with model_warnings(verbose=options.verbose):
        plan = _plan(options, robot)
    contacts: tuple[Contact, ...] = ()
    if options.contacts:
        contacts = load_contacts(options.contacts)
    # The time on the wall, which includes compilation at a first start.
    start = time.perf_counter()
    with progress_bar('simulating', plan.duration) as progress, (
            model_warnings(verbose=options.verbose)):
        result = simulate(robot, plan.q0, plan.u0, plan.duration, step=options.step,
                          torque=plan.torque, progress=progress,
                          integrator=options.integrator, stops=options.stops,
                          sticking=options.sticking, contacts=contacts)
    wall_time = time.perf_counter() - start
    if options.out:
        save = result.save_npz if options.out.endswith('.npz') else result.save_csv
        save(options.out)
    if plot is not None:
        pictures.draw(plot, options, robot, result, getattr(plan.torque, 'motion', None))
    if options.json:
        print_json(_data(robot, result, wall_time))
        return
    # A summary: duration, energy, last state and events.
    first_energy, last_energy = result.energy[[0, -1]].sum(axis=1)
    print(f'{result.t[-1]:g} s in steps of {options.step:g} s took {wall_time:.3g} s; '
          f'energy went from {first_energy:.6g} J to {last_energy:.6g} J')
    _print_last_state(robot, result)
    _print_contacts(result)
    _print_events(result)
    print_files(path for path in (options.out, options.plot) if path)


def _data(robot: Robot, result: Trajectory, wall_time: float) -> dict[str, Any]:
    """Return the end of a simulation as plain data."""
    first_energy, last_energy = result.energy[[0, -1]].sum(axis=1).tolist()
    return {'joint_names': robot.joint_names, 'duration': float(result.t[-1]),
            'wall_time': wall_time, 'q': result.q[-1], 'u': result.u[-1],
            'tau': result.tau[-1], 'energy_before': first_energy,
            'energy_after': last_energy,
            'limit_events': [str(event) for event in result.limit_events],
            'stop_events': [str(event) for event in result.stop_events],
            'contact_events': [str(event) for event in result.contact_events],
            'contact_names': result.contact_names,
            'contact_forces': result.contact_forces[-1],
            'contact_modes': [ContactMode(mode).name.lower()
                              for mode in result.contact_modes[-1]],
            'speed_names': robot.speed_names, 'drift': result.drift}


def _print_last_state(robot: Robot, result: Trajectory) -> None:
    """Print positions, speeds and torques at the end."""
    q, u, tau = (without_rounding(rows[-1]) for rows in (result.q, result.u, result.tau))
    if result.drift > 0.0:
        print(f'largest residual of the constraints: {result.drift:.3g} m or rad, or '
              'per s')
    if robot.speed_names == robot.coordinate_names:
        print_table(['joint', 'q', 'u', 'tau'],
                    zip(robot.joint_names, q, u, tau, strict=True))
        return
    # Quaternions, loops and chosen speeds have more coordinates than speeds, or others.
    print_table(['coordinate', 'q'], zip(robot.coordinate_names, q, strict=True))
    print_table(['speed', 'u', 'tau'], zip(robot.speed_names, u, tau, strict=True))


def _print_contacts(result: Trajectory) -> None:
    """Print mode and force of every contact at the end."""
    rows = []
    for name, mode, force in zip(result.contact_names, result.contact_modes[-1],
                                 without_rounding(result.contact_forces[-1]), strict=True):
        rows.append((name, ContactMode(mode).name.lower(), *force))
    if rows:
        print_table(['contact', 'mode', 'fx', 'fy', 'fz'], rows)


def _print_events(result: Trajectory) -> None:
    """Print the first limits that the motion passed, and its first impacts."""
    events = [*result.limit_events, *result.stop_events, *result.contact_events]
    for event in events[:PRINTED_EVENTS]:
        print(event)
    left_out = len(events) - PRINTED_EVENTS
    if left_out > 0:
        print(f'... {left_out} more: see --json')


def _plan(options: Namespace, robot: Robot) -> Plan:
    """Return initial state, duration and torques that the options state."""
    duration = options.duration
    torque: Any = None
    q_desired = u_desired = None
    # A motion is followed by computed torque, for its whole number of steps.
    if options.motion:
        motion = read_motion(options.motion, robot.speed_names)
        q_desired, u_desired, _ = motion.sample(0.0)
        torque = ComputedTorque(robot, motion, one_or_all(options.kp),
                                one_or_all(options.kd))
        if duration is None and motion.duration > 0.0 and options.step > 0.0:
            steps = math.ceil(motion.duration / options.step - 1e-6)
            duration = steps * options.step
    if duration is None:
        duration = 1.0
    if options.torque:
        require_own_actuators(robot)
        torque = _stated_torque(options, robot, duration)
    # The simulation begins on the motion, unless the options state a state.
    if options.u0 is None and u_desired is not None:
        u0 = u_desired
    else:
        u0 = speed_vector(options, 'u0', robot)
    return Plan(positions(options, 'q0', robot, q_desired), u0, duration, torque)


def require_own_actuators(robot: Robot) -> None:
    """Raise InputError unless each independent joint has the actuator whose torque is given."""
    if set(robot.actuated_names) != set(robot.speed_names):
        raise InputError('--torque: given for actuators at '
                         f'{", ".join(robot.actuated_names)}; expected constraints '
                         'whose actuated joints are the '
                         f'independent ones, {", ".join(robot.speed_names)}')


def _stated_torque(options: Namespace, robot: Robot, duration: float) -> Array:
    """Return constant torques, (n,), or those of a file as one row per step."""
    tokens = split(options.torque)
    if len(tokens) != 1 or not tokens[0].endswith('.csv'):
        return speed_vector(options, 'torque', robot)
    path = tokens[0]
    states = read_states(path, robot.speed_names)
    if states.tau is None:
        raise InputError(f"{path}: no columns 'tau.<joint>'; expected the torques of "
                         f'the joints {", ".join(robot.speed_names)}')
    if states.t is None or not options.step > 0.0:
        return states.tau
    increasing(states.t, len(states.tau), f"{path}: column 't'")
    # A row holds from its time until that of the next one.
    times = np.arange(max(1, round(duration / options.step))) * options.step
    rows = np.searchsorted(states.t, times + 1e-6 * options.step, side='right') - 1
    return np.asarray(states.tau[np.maximum(rows, 0)])
