"""
Time of exact friction: a step of an FR3 that slides everywhere, MuJoCo's noslip.

Two comparisons. A step with exact friction in sliding is compared with a step with the
smooth law, of one integrator, in interleaved runs. Simulations of a motion with
transitions are compared with MuJoCo's noslip solver at the same error: the largest error
of the joint positions at the end. The reference is MuJoCo's own limit: its noslip solver
at two tiny steps, extrapolated to none (its error is of first order); the distance of
our finest simulation from it is printed. The time constant with which MuJoCo's joints
come to rest is its default, 20 ms, or two steps, the least possible one, where its error
is that of the step.

Times are those of native steps, transitions included, in both programs, and of the whole
`simulate`, with its checks of stability, energy and limits, which MuJoCo does not make.
They are those of calls in a row: the first `simulate` after other work, whose code and
data are in no cache, takes up to twice as long.

Run: `.venv/bin/python benchmarks/sticking.py`; it prints the ratios, and fails where one
misses its gate.
"""

from collections.abc import Callable
from pathlib import Path
import sys
import time

from kane_dynamics import load_urdf, Robot, simulate
from kane_dynamics._util.resources import resource_path
from kane_dynamics.simulation.row_kernel import ModeChoice, row_kernel, RowMode
from kane_dynamics.simulation.row_modes import row_set
from kane_dynamics.simulation.step_kernels import step_kernel, StepChoice
from kane_dynamics.simulation.stepper import RowSteps
from kane_dynamics.simulation.torque_input import TorqueInput
import mujoco
import numpy as np
from simulation_loop import mujoco_model

FRICTION = np.array([4.0, 4.0, 3.0, 3.0, 1.0, 1.0, 1.0])  # N m
Q = np.array([0.1, -0.4, 0.2, -1.8, 0.1, 1.5, 0.4])
U = np.array([0.8, -0.6, 0.7, 0.9, -0.8, 0.7, 0.9])
STEPS = 20_000
ROUNDS = 15
DURATION = 1.0  # s; later this motion amplifies any error to radians
HOLDS = (0.02, 0.1)  # s: each torque of a motion is held
IN_A_ROW = 5  # calls: the first ones find cold caches
FINEST = 1e-4  # s: step of our finest simulation
REFERENCE = (4e-6, 2e-6)  # s: MuJoCo's steps of the reference
# To the smooth step; of MuJoCo to ours.
MOST_SLIDING = 2.0
LEAST_RATIO = 2.0
# MuJoCo's step, s, of that gate. A transition is decided in Python, in a millisecond: at
# ten of them a second, MuJoCo is faster with steps of 1 ms, and errors of 3e-3 rad.
GATED = 1e-4
# Of a hold: the longest of our steps with at most MuJoCo's error counts.
OUR_STEPS = (1.0, 0.5, 0.25, 0.1, 0.05, 0.02, 0.01)


def fr3() -> Robot:
    """Return the FR3 with Coulomb friction in all seven joints."""
    urdf = resource_path('urdf', 'fr3.urdf')
    bare = load_urdf(urdf, tip='fr3_link7')
    joints = {}
    for name, level in zip(bare.joint_names, FRICTION):
        joints[name] = {'friction': float(level), 'friction_speed': 0.05, 'damping': 0.5,
                        'armature': 0.1}
    return Robot(load_urdf(urdf, tip='fr3_link7', supplement={'joints': joints}))


def step_times(robot: Robot, integrator: str) -> dict[str, float]:
    """Return the least processor times of a smooth step and of exact ones, s."""
    choice = StepChoice(False, integrator)
    smooth = step_kernel(robot, *choice)
    rows = row_set(robot, False, True, (), (), ())
    state = np.concatenate([Q, U])
    # Steps of no length repeat one state, so that every joint slides in every step.
    constants = np.concatenate([[1e-12], robot.parameters.block])
    tau = robot.gravity_force(Q)[None]
    slides = [RowMode.FORWARD if u > 0.0 else RowMode.BACKWARD for u in U]
    two_held = slides.copy()
    two_held[1] = two_held[4] = RowMode.STICKING
    kernel = row_kernel(rows, choice)
    results = np.empty((STEPS + 1, *kernel.shape))
    results[0, :len(state)] = state
    states = results[:-1, :len(state)]
    short = np.empty((STEPS + 1, len(state)))
    short[0] = state

    def steps_in(modes: list[RowMode]) -> Callable[[], object]:
        unlimited = np.array([rows.lower, rows.upper])
        choice_of_modes = ModeChoice(tuple(modes), (), np.zeros((0, 2)), np.zeros(0),
                                     unlimited, np.zeros(len(modes)))
        numbers = choice_of_modes.numbers(rows)
        return lambda: kernel.scan([states, tau, numbers], results[1:],
                                   constants=constants)
    calls = {
        'smooth': lambda: smooth.scan([short[:-1], tau], short[1:], constants=constants),
        'sliding': steps_in(slides),
        'two joints held': steps_in(two_held)}
    times = dict.fromkeys(calls, np.inf)
    for _ in range(ROUNDS):
        for name, call in calls.items():
            begin = time.process_time()
            call()
            times[name] = min(times[name], (time.process_time() - begin) / STEPS)
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


def native_steps(robot: Robot, tau: np.ndarray, step: float,
                 hold: float) -> Callable[[], np.ndarray]:
    """Return a call that computes the native steps of `moved` and returns them."""
    rows = np.repeat(tau, round(hold / step), axis=0)
    choice = StepChoice(False)
    constants = np.concatenate([[step], robot.parameters.block])
    source = TorqueInput(robot, step_kernel(robot, *choice), choice, step, constants,
                         rows[None])
    states = np.zeros((1, len(rows) + 1, 2 * robot.n))
    states[0, 0, :robot.n] = Q

    def call() -> np.ndarray:
        RowSteps(robot, step, 0.0, False, True).advance(source, states, 0)
        return states[0, -1, :robot.n].copy()
    return call


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
    data.qpos[:] = Q
    data.qvel[:] = 0.0
    steps = round(hold / step)
    for row in tau:
        data.qfrc_applied[:] = row
        mujoco.mj_step(plant, data, nstep=steps)
    return data.qpos.copy()


def least_times(calls: dict[str, Callable[[], object]], rounds: int) -> dict[str, float]:
    """Return the least processor time of each call, s, in interleaved runs."""
    times = dict.fromkeys(calls, np.inf)
    for _ in range(rounds):
        for name, call in calls.items():
            for _ in range(IN_A_ROW):
                begin = time.process_time()
                call()
                times[name] = min(times[name], time.process_time() - begin)
    return times


def limit_of_mujoco(plant: mujoco.MjModel, tau: np.ndarray, hold: float) -> np.ndarray:
    """Return where MuJoCo's FR3 is at the end, extrapolated to steps of no length."""
    data = mujoco.MjData(plant)
    ends = []
    for step in REFERENCE:
        plant.dof_solref[:, 0] = 2.0 * step
        ends.append(moved_by_mujoco(plant, data, tau, step, hold))
    coarse, fine = REFERENCE
    return ends[1] + (ends[1] - ends[0]) * fine / (coarse - fine)


def against_mujoco(robot: Robot, duration: float, hold: float) -> list[float]:
    """
    Print times and errors of one motion with transitions, of both programs.

    Return the ratios of MuJoCo's times to those of native steps and of `simulate` at the
    same error.
    """
    tau = torques(robot, duration, hold)
    plant = mujoco_of(robot)
    data = mujoco.MjData(plant)
    reference = limit_of_mujoco(plant, tau, hold)

    def error_of(end: np.ndarray) -> float:
        return float(np.abs(end - reference).max())
    from_limit = error_of(moved(robot, tau, FINEST, hold))
    print(f'{duration:g} s, torques every {hold:g} s: simulate with a step of '
          f'{FINEST:g} s is {from_limit:.1e} rad from the limit of MuJoCo')
    our_steps = hold * np.array(OUR_STEPS)
    errors = np.array(
        [error_of(moved(robot, tau, length, hold)) for length in our_steps])
    ratios = []
    for step, constant in ((1e-3, 0.02), (1e-3, 2e-3), (1e-4, 0.02), (1e-4, 2e-4)):
        plant.dof_solref[:, 0] = constant
        its_error = error_of(moved_by_mujoco(plant, data, tau, step, hold))
        ours = our_steps[np.flatnonzero(errors <= its_error)[0]]
        times = least_times({
            'MuJoCo': lambda step=step: moved_by_mujoco(plant, data, tau, step, hold),
            'native steps': native_steps(robot, tau, ours, hold),
            'native steps of this length': native_steps(robot, tau, step, hold),
            'simulate': lambda ours=ours: moved(robot, tau, ours, hold)}, 7)
        print(
            f'  MuJoCo noslip, step {step:g} s, constant {constant:g} s: error '
            f'{its_error:.1e} rad, {1e3 * times["MuJoCo"]:.2f} ms; step {ours:g} '
            f's: error {errors[our_steps == ours][0]:.1e} rad')
        for name in list(times)[1:]:
            print(f'    {name}: {1e3 * times[name]:.2f} ms, ratio '
                  f'{times["MuJoCo"] / times[name]:.1f}')
        if step == GATED:
            ratios += [times['MuJoCo'] / times[name]
                       for name in ('native steps', 'simulate')]
    return ratios


def main() -> int:
    """Print the comparisons; return 0 if all gates are met."""
    robot = fr3()
    ratios = []
    for hold in HOLDS:
        ratios += against_mujoco(robot, DURATION, hold)
    missed_gates = [ratio for ratio in ratios if ratio < LEAST_RATIO]
    for integrator in ('rk4', 'implicit'):
        times = step_times(robot, integrator)
        text = ', '.join(f'{name} {1e6 * x:.2f} us ({x / times["smooth"]:.2f})'
                         for name, x in times.items())
        print(f'{integrator}: {text}')
        missed_gates += [x for x in [times['sliding'] / times['smooth']]
                         if x > MOST_SLIDING]
    for ratio in missed_gates:
        print(f'FAILED: {ratio:.1f}')
    return int(bool(missed_gates))


if __name__ == '__main__':
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
    sys.exit(main())
