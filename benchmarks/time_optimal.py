"""Time-optimal timing compared with toppra on Pinocchio's torques, in one interleaved run."""

from collections.abc import Callable
import statistics
import sys
import time

from gates import exit_status
from kane_dynamics import load_urdf, Robot
from kane_dynamics._util.resources import resource_path
from kane_dynamics.feasibility import time_optimal
from kane_dynamics.feasibility.path_geometry import path_of
import numpy as np

URDF = resource_path('urdf', 'fr3.urdf')
POINTS, ROUNDS = 1000, 15
GATE = 10.0  # ratio of toppra's processor time to ours
AGREEMENT = 5e-3  # of the durations; toppra's own error at 1000 points is up to 4e-3


def toppra_timing(robot: Robot, waypoints: np.ndarray) -> Callable[[], float] | None:
    """Return a function that times the path with toppra; None if it is not installed."""
    try:
        import pinocchio
        import toppra
        import toppra.algorithm
        import toppra.constraint as constraints
    except ImportError:
        return None
    toppra.setup_logging('ERROR')
    model = pinocchio.buildModelFromUrdf(str(URDF))
    model = pinocchio.buildReducedModel(
        model, [k for k, name in enumerate(model.names) if 'finger' in name], np.zeros(model.nq))
    data, motion = model.createData(), path_of(waypoints, robot.joint_names)
    effort, velocity = robot.limits.effort, robot.limits.velocity

    def duration() -> float:
        path = toppra.SplineInterpolator(motion.times, waypoints, bc_type='not-a-knot')
        torque = constraints.JointTorqueConstraint(
            lambda *state: pinocchio.rnea(model, data, *state),
            np.stack([-effort, effort], axis=1), np.zeros(robot.n),
            discretization_scheme=constraints.DiscretizationType.Interpolation)
        speed = constraints.JointVelocityConstraint(np.stack([-velocity, velocity], axis=1))
        grid = np.linspace(0.0, motion.duration, POINTS + 1)
        solver = toppra.algorithm.TOPPRA([speed, torque], path, gridpoints=grid,
                                         solver_wrapper='seidel')
        rates = solver.compute_parameterization(0.0, 0.0)[1]
        return float((2.0 * np.diff(grid) / (rates[1:] + rates[:-1])).sum())
    return duration


def main() -> int:
    """Print the comparison; return 1 if the gate does not hold."""
    robot = Robot(load_urdf(URDF, tip='fr3_link7'), friction=False)
    middle = 0.5 * (robot.limits.lower + robot.limits.upper)
    waypoints = middle + 0.25 * (robot.limits.upper - robot.limits.lower) * np.random.default_rng(
        3).uniform(-1.0, 1.0, (5, robot.n))
    programs = {'kane_dynamics': lambda: time_optimal(robot, waypoints, points=POINTS).duration}
    peer = toppra_timing(robot, waypoints)
    if peer is not None:
        programs['toppra'] = peer
    durations = {name: program() for name, program in programs.items()}
    times: dict[str, list[float]] = {name: [] for name in programs}
    for _ in range(ROUNDS):
        for name, program in programs.items():
            began = time.process_time()
            program()
            times[name].append(time.process_time() - began)
    print(f'Time-optimal timing of a path of the FR3, seven axes, {POINTS} points, no friction')
    for name, each in times.items():
        print(f'  {name:16}{1e3 * statistics.median(each):8.1f} ms   ({durations[name]:.4f} s)')
    if peer is None:
        print('LEFT OUT: toppra: not installed; its gate is not checked')
        return 0
    ratio = statistics.median(x / y for x, y in zip(times['toppra'], times['kane_dynamics']))
    print(f'  ratio {ratio:.1f}; gate {GATE:g}')
    if abs(durations['toppra'] / durations['kane_dynamics'] - 1.0) > AGREEMENT:
        print(f'FAILED: durations differ by more than {AGREEMENT:g}')
        return exit_status(False)
    if ratio < GATE:
        print(f'FAILED: {ratio:.1f} times as fast as toppra; expected {GATE:g}')
        return exit_status(False)
    return 0


if __name__ == '__main__':
    sys.exit(main())
