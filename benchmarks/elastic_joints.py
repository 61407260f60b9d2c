"""
Time of elastic joints: an FR3 with seven, rigid joints, MuJoCo with two masses.

Forward dynamics with elastic joints is compared with that of the rigid arm, in
interleaved batches of calls from Python and natively; inverse dynamics to the fourth
order with inverse dynamics of the rigid arm, singly. Simulations at 1 ms, where the
stiffest mode has 200 Hz, are compared with MuJoCo with the same masses and springs at
its largest stable step, of the integrator with which that takes least time: native
steps, and `simulate` with its checks of energy and limits.

Run: `.venv/bin/python benchmarks/elastic_joints.py`; it prints the ratios, and fails
where one misses its gate.
"""

from collections.abc import Callable
from pathlib import Path
import sys
import time

from kane_dynamics import (Drive, ElasticFeedforward, load_urdf, longest_step,
                           natural_vibration, Robot, simulate, with_drives)
from kane_dynamics._util.resources import resource_path
from kane_dynamics.simulation.step_kernels import step_kernel
import mujoco
import numpy as np

sys.path.append(str(Path(__file__).resolve().parents[1] / 'test' / 'helpers'))
from two_mass_arm import TwoMassArm  # noqa: E402, I100

URDF = resource_path('urdf', 'fr3.urdf')
JOINTS = [f'fr3_joint{k}' for k in range(1, 8)]
STIFFNESS = np.array([14e3, 14e3, 14e3, 14e3, 3e3, 3e3, 2950.0])  # N m/rad
INERTIA = np.array([0.6, 0.6, 0.5, 0.5, 0.2, 0.2, 0.2])  # kg m^2
DAMPING = 0.2  # N m s/rad
HOME = np.array([0.0, -0.4, 0.0, -2.0, 0.0, 1.7, 0.8])
STEP = 1e-3
DURATION = 2.0
ROUNDS = 12
SEARCH = 1.0  # s, of which steps are tried
# s, in MuJoCo
FIRST_STEP = 1e-3
STEP_CHANGE = 5e-5
INTEGRATORS = ('EULER', 'IMPLICITFAST', 'IMPLICIT', 'RK4')
# To the rigid arm; of MuJoCo to the implicit step.
MOST_FD = 1.5
LEAST_RATIO = 6.0
MOST_FEEDFORWARD = 0.9  # us of a call from Python
CALLS = 2000
GROWTH = 1.5  # of the largest deflection: more is unstable


def arms() -> tuple[Robot, Robot]:
    """Return the rigid FR3 with the rotors as armature, and that with elastic joints."""
    armature = {name: {'armature': float(B)} for name, B in zip(JOINTS, INERTIA)}
    rigid = load_urdf(URDF, joints=JOINTS, supplement={'joints': armature})
    drives = {name: Drive(float(k), DAMPING) for name, k in zip(JOINTS, STIFFNESS)}
    return Robot(rigid), Robot(with_drives(rigid, drives))


def least_times(calls: dict[str, Callable[[], object]]) -> dict[str, float]:
    """Return the least processor time of each call, s, in interleaved rounds."""
    times = dict.fromkeys(calls, np.inf)
    for _ in range(ROUNDS):
        for name, call in calls.items():
            begin = time.process_time()
            call()
            times[name] = min(times[name], time.process_time() - begin)
    return times


def forward_dynamics_ratio(rigid: Robot, elastic: Robot) -> tuple[float, float]:
    """Return the ratios of times of forward dynamics: single calls, native batches."""
    rng = np.random.default_rng(0)
    single = {}
    batches = {}
    for name, robot in (('rigid', rigid), ('elastic', elastic)):
        q = np.tile(HOME, robot.n // 7)
        u, tau = rng.normal(size=(2, robot.n))
        rows = [np.tile(x, (20_000, 1)) for x in (q, u, tau)]

        def calls(robot: Robot = robot,
                  state: tuple[np.ndarray, ...] = (q, u, tau)) -> None:
            for _ in range(CALLS):
                robot.forward_dynamics(*state)

        def batch(robot: Robot = robot, rows: list[np.ndarray] = rows) -> None:
            robot.forward_dynamics(*rows)
        single[name] = calls
        batches[name] = batch
    of_calls = least_times(single)
    of_batches = least_times(batches)
    return (of_calls['elastic'] / of_calls['rigid'],
            of_batches['elastic'] / of_batches['rigid'])


def feedforward_times(rigid: Robot) -> tuple[float, float]:
    """Return the times of the feedforward without damping and of rigid dynamics, us."""
    springs = {name: Drive(float(k)) for name, k in zip(JOINTS, STIFFNESS)}
    feedforward = ElasticFeedforward(Robot(with_drives(rigid.model, springs)))
    u, udot, jerk, snap = np.random.default_rng(1).normal(size=(4, 7))

    def to_fourth_order() -> None:
        for _ in range(CALLS):
            feedforward(HOME, u, udot, jerk, snap)

    def to_second_order() -> None:
        for _ in range(CALLS):
            rigid.inverse_dynamics(HOME, u, udot)
    times = least_times({'fourth': to_fourth_order, 'second': to_second_order})
    return 1e6 * times['fourth'] / CALLS, 1e6 * times['second'] / CALLS


def native_steps(robot: Robot, tau: np.ndarray, integrator: str) -> Callable[[], object]:
    """Return a call that computes the native steps of `DURATION` from rest at home."""
    kernel = step_kernel(robot, False, integrator)
    states = np.zeros((round(DURATION / STEP) + 1, 2 * robot.n))
    states[0, :robot.n] = np.tile(HOME, robot.n // 7)
    constants = np.concatenate([[STEP], robot.parameters.block])
    return lambda: kernel.scan([states[:-1], tau[None]], states[1:], constants=constants)


def largest_deflection(arm: TwoMassArm, q0: np.ndarray, tau: np.ndarray) -> float:
    """Return the largest deflection in MuJoCo, rad; infinite if it diverges."""
    arm.put(q0, np.zeros(14))
    worst = 0.0
    for _ in range(50):
        arm.step(tau, round(SEARCH / 50 / arm.model.opt.timestep))
        q = arm.state[0]
        unstable = sum(warning.number for warning in arm.data.warning)
        if unstable or not np.isfinite(q).all():
            return np.inf
        worst = max(worst, float(np.abs(q[7:] - q[:7]).max()))
    return worst


def largest_stable(elastic: Robot, q0: np.ndarray, tau: np.ndarray,
                   integrator: str) -> TwoMassArm:
    """Return the arm in MuJoCo with its largest stable step, found from short ones."""
    mujoco.set_mju_user_warning(lambda text: None)  # unstable steps are looked for
    text = URDF.read_text(encoding='utf-8')
    fine = TwoMassArm(text, elastic.model, 1e-4, 'RK4')
    expected = largest_deflection(fine, q0, tau)
    step = FIRST_STEP
    while True:
        arm = TwoMassArm(text, elastic.model, step + STEP_CHANGE, integrator)
        if not largest_deflection(arm, q0, tau) < GROWTH * expected:
            return TwoMassArm(text, elastic.model, step, integrator)
        step += STEP_CHANGE


def main() -> int:
    """Print the ratios; return 0 if forward dynamics and implicit step are fast."""
    rigid, elastic = arms()
    q0 = np.tile(HOME, 2)
    modes = natural_vibration(elastic, q0).frequencies / (2.0 * np.pi)
    locked = natural_vibration(elastic, q0, held=[f'{name}_motor' for name in JOINTS])
    print(f'stiffest mode {modes[-1]:.0f} Hz; first mode with motors locked '
          f'{locked.frequencies[0] / (2.0 * np.pi):.1f} Hz; longest Runge-Kutta step '
          f'{1e3 * longest_step(elastic, q0).step:.2f} ms')
    singly, in_batches = forward_dynamics_ratio(rigid, elastic)
    print(f'forward dynamics, elastic to rigid: {singly:.2f} from Python, '
          f'{in_batches:.2f} in batches')
    fourth, second = feedforward_times(rigid)
    print(f'inverse dynamics from Python: {fourth:.2f} us to the fourth order, '
          f'{second:.2f} us rigid, ratio {fourth / second:.1f}')

    # The motors hold the arm against gravity; the links sag and vibrate.
    gravity = rigid.gravity_force(HOME)
    tau = np.concatenate([np.zeros(7), gravity])
    calls: dict[str, Callable[[], object]] = {}
    for integrator in ('rk4', 'implicit'):
        calls[f'{integrator}, rigid'] = native_steps(rigid, gravity, integrator)
        calls[f'{integrator}, elastic'] = native_steps(elastic, tau, integrator)
    calls['simulate'] = lambda: simulate(elastic, q0, np.zeros(14), DURATION, step=STEP,
                                         torque=tau, sample=DURATION)
    for integrator in INTEGRATORS:
        arm = largest_stable(elastic, q0, tau, integrator)

        def peer_steps(arm: TwoMassArm = arm) -> None:
            arm.put(q0, np.zeros(14))
            arm.step(tau, round(DURATION / arm.model.opt.timestep))
        step = 1e3 * arm.model.opt.timestep
        calls[f'MuJoCo {integrator} at {step:.2f} ms'] = peer_steps
    times = least_times(calls)
    for name, seconds in times.items():
        print(f'{name}: {1e3 * seconds / DURATION:.2f} ms for 1 s')
    peer = min(seconds for name, seconds in times.items() if name.startswith('MuJoCo'))
    ratios = {name: peer / times[name]
              for name in ('rk4, elastic', 'implicit, elastic', 'simulate')}
    for name, ratio in ratios.items():
        print(f'MuJoCo to {name}: {ratio:.1f}')
    gates = {'forward dynamics': in_batches <= MOST_FD and singly <= MOST_FD,
             'inverse dynamics to the fourth order': fourth <= MOST_FEEDFORWARD,
             'simulation': ratios['implicit, elastic'] >= LEAST_RATIO}
    missed_gates = [name for name, holds in gates.items() if not holds]
    for name in missed_gates:
        print(f'FAILED: {name}')
    return int(bool(missed_gates))


if __name__ == '__main__':
    sys.exit(main())
