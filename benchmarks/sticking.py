"""
Time of exact friction: a step of an FR3 that slides in seven joints, and MuJoCo's noslip.

Two comparisons. A step with exact friction in sliding is compared with a step with the
smooth law, of one integrator, in interleaved runs. Simulations of a motion with
transitions are compared with MuJoCo's noslip solver at the same error: the largest error
of the joint positions at the end, against a simulation with a far shorter step. The time
constant with which MuJoCo's joints come to rest is its default, 20 ms, or two steps, the
least possible one, where its error is that of the step.

Run: `.venv/bin/python benchmarks/sticking.py`; it prints both ratios.
"""

from collections.abc import Callable
from pathlib import Path
import sys
import time

from kane_dynamics import load_urdf, Robot, simulate
from kane_dynamics._util.resources import resource_path
from kane_dynamics.simulation.step_kernels import step_kernel, StepChoice
from kane_dynamics.simulation.sticking.friction_state import FrictionModes, FrictionState
from kane_dynamics.simulation.sticking.sticking_kernel import mode_rows, sticking_kernel
import mujoco
import numpy as np
from simulation_loop import mujoco_model

FRICTION = np.array([4.0, 4.0, 3.0, 3.0, 1.0, 1.0, 1.0])  # N m
Q = np.array([0.1, -0.4, 0.2, -1.8, 0.1, 1.5, 0.4])
U = np.array([0.8, -0.6, 0.7, 0.9, -0.8, 0.7, 0.9])
STEPS, ROUNDS = 20_000, 15
DURATION = 1.0  # s; later this motion amplifies any error to radians
HOLDS = (0.02, 0.1)  # s: each torque of a motion is held
REFERENCE = 1e-4  # s: step of the reference
# Of a hold: the longest of our steps with at most MuJoCo's error counts.
OUR_STEPS = (1.0, 0.5, 0.25, 0.1, 0.05, 0.02, 0.01)


def fr3() -> Robot:
    """Return the FR3 with Coulomb friction in all seven joints."""
    urdf = resource_path('urdf', 'fr3.urdf')
    bare = load_urdf(urdf, tip='fr3_link7')
    joints = {name: {'friction': float(level), 'friction_speed': 0.05, 'damping': 0.5,
                     'armature': 0.1}
              for name, level in zip(bare.joint_names, FRICTION)}
    return Robot(load_urdf(urdf, tip='fr3_link7', supplement={'joints': joints}))


def step_times(robot: Robot, integrator: str) -> dict[str, float]:
    """Return the least times of a smooth step and of exact ones, s."""
    choice = StepChoice(False, integrator)
    smooth = step_kernel(robot, *choice)
    contact = FrictionState(robot, False)
    state = np.concatenate([Q, U])
    # Steps of no length repeat one state, so that every joint slides in every step.
    constants = np.concatenate([[1e-12], robot.parameters.block])
    tau = robot.gravity_force(Q)[None]
    directions = np.sign(U)
    modes = mode_rows(contact, FrictionModes(directions, 0.0 * directions))
    some_held = directions.copy()
    some_held[[1, 4]] = 0.0
    held_modes = mode_rows(contact, FrictionModes(some_held, 0.0 * directions))
    rows = np.empty((STEPS + 1, len(state) + 2))
    rows[0, :len(state)] = state
    before, short = rows[:-1, :len(state)], np.empty((STEPS + 1, len(state)))
    short[0] = state
    sliding = sticking_kernel(choice, contact, holds=False)
    sticking = sticking_kernel(choice, contact, holds=True)
    calls = {
        'smooth': lambda: smooth.scan([short[:-1], tau], short[1:], constants=constants),
        'sliding': lambda: sliding.scan([before, tau, modes], rows[1:], constants=constants),
        'two joints held': lambda: sticking.scan([before, tau, held_modes], rows[1:],
                                                 constants=constants)}
    times = dict.fromkeys(calls, np.inf)
    for _ in range(ROUNDS):
        for name, call in calls.items():
            begin = time.perf_counter()
            call()
            times[name] = min(times[name], (time.perf_counter() - begin) / STEPS)
    return times


def torques(robot: Robot, duration: float, hold: float) -> np.ndarray:
    """Return the torques of a motion, (K, n): those that hold its weight, and waves."""
    t = np.arange(round(duration / hold))[:, None] * hold
    amplitudes = np.array([1.5, 0.9, -1.3, 0.5, 2.0, -0.7, 1.2])
    waves = np.cos(np.array([2.0, 1.0, 3.0, 2.2, 4.0, 1.7, 5.0]) * t)
    return robot.gravity_force(Q) + FRICTION * amplitudes * waves


def moved(robot: Robot, tau: np.ndarray, step: float, hold: float) -> np.ndarray:
    """Return where the FR3 is at the end, with exact friction."""
    rows = np.repeat(tau, round(hold / step), axis=0)
    duration = len(tau) * hold
    run = simulate(robot, Q, np.zeros(robot.n), duration, step=step, torque=rows,
                   sample=duration, sticking=True)
    return run.q[-1]


def mujoco_of(robot: Robot) -> mujoco.MjModel:
    """Return MuJoCo's FR3 with the same joints and friction, and its noslip solver."""
    plant = mujoco_model('fr3', robot.model)
    plant.opt.integrator = mujoco.mjtIntegrator.mjINT_EULER
    plant.opt.noslip_iterations = 20
    off = mujoco.mjtDisableBit
    plant.opt.disableflags &= ~(off.mjDSBL_FRICTIONLOSS | off.mjDSBL_CONSTRAINT)
    plant.dof_frictionloss[:] = FRICTION
    plant.dof_damping[:] = 0.0
    plant.dof_damping.reshape(robot.n, -1)[:, 0] = 0.5
    plant.dof_armature[:] = 0.1
    return plant


def moved_by_mujoco(plant: mujoco.MjModel, data: mujoco.MjData, tau: np.ndarray,
                    step: float, hold: float) -> np.ndarray:
    """Return where MuJoCo's FR3 is at the end."""
    mujoco.mj_resetData(plant, data)
    plant.opt.timestep = step
    data.qpos[:], data.qvel[:] = Q, 0.0
    steps = round(hold / step)
    for row in tau:
        data.qfrc_applied[:] = row
        mujoco.mj_step(plant, data, nstep=steps)
    return data.qpos.copy()


def least_times(calls: dict[str, Callable[[], object]], rounds: int) -> dict[str, float]:
    """Return the least time of each call, s, in interleaved runs."""
    times = dict.fromkeys(calls, np.inf)
    for _ in range(rounds):
        for name, call in calls.items():
            begin = time.perf_counter()
            call()
            times[name] = min(times[name], time.perf_counter() - begin)
    return times


def against_mujoco(robot: Robot, duration: float, hold: float) -> None:
    """Print times and errors of one motion with transitions, of both programs."""
    tau = torques(robot, duration, hold)
    reference = moved(robot, tau, REFERENCE, hold)
    our_steps = hold * np.array(OUR_STEPS)
    errors = [np.abs(moved(robot, tau, length, hold) - reference).max()
              for length in our_steps]
    plant = mujoco_of(robot)
    data = mujoco.MjData(plant)
    for step, constant in ((1e-3, 0.02), (1e-3, 2e-3), (1e-4, 0.02), (1e-4, 2e-4)):
        plant.dof_solref[:, 0] = constant
        reached = moved_by_mujoco(plant, data, tau, step, hold)
        its_error = np.abs(reached - reference).max()
        case = (f'{duration:g} s, torques every {hold:g} s: MuJoCo noslip, step {step:g} s, '
                f'constant {constant:g} s: error {its_error:.1e} rad')
        as_good = np.flatnonzero(np.array(errors) <= its_error)
        if not len(as_good):
            print(f'{case}; simulate: {errors}')
            continue
        ours = our_steps[as_good[0]]
        times = least_times({
            'MuJoCo': lambda step=step: moved_by_mujoco(plant, data, tau, step, hold),
            'simulate': lambda ours=ours: moved(robot, tau, ours, hold)}, 7)
        print(f'{case}, {1e3 * times["MuJoCo"]:.2f} ms; simulate, step '
              f'{ours:g} s: error {errors[as_good[0]]:.1e} rad, '
              f'{1e3 * times["simulate"]:.2f} ms; ratio '
              f'{times["MuJoCo"] / times["simulate"]:.1f}')


def main() -> None:
    """Print the comparisons."""
    robot = fr3()
    for hold in HOLDS:
        against_mujoco(robot, DURATION, hold)
    for integrator in ('rk4', 'implicit'):
        times = step_times(robot, integrator)
        text = ', '.join(f'{name} {1e6 * x:.2f} us ({x / times["smooth"]:.2f})'
                         for name, x in times.items())
        print(f'{integrator}: {text}')


if __name__ == '__main__':
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
    main()
