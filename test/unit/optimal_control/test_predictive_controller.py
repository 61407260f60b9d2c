"""Predictive control: targets reached without offset; every state has a torque."""

from dataclasses import replace
from functools import cache

from kane_dynamics import (Inertial, InputError, load_urdf, ModelBuilder, ModelWarning,
                           Motion, Robot, rod, simulate)
from kane_dynamics._util.resources import resource_path
from kane_dynamics.optimal_control import (CostWeights, PredictiveController,
                                           TrajectoryOptimizer)
from mechanisms import with_inertials
import numpy as np
import pytest

CYCLE = 0.004
INTERVAL = 0.02
NODES = 15
FRICTION = {'friction': 3.0, 'friction_speed': 0.05, 'damping': 1.0}
START = np.array([0.2, 0.4])
GOAL = np.array([0.8, -0.4])
LIMITS = np.array([60.0, 20.0])


@cache
def arm(friction=True):
    """Return a two-link arm with Coulomb friction, and its model without."""
    path = resource_path('urdf', 'two_link.urdf')
    joints = dict.fromkeys(load_urdf(path).joint_names, FRICTION)
    return Robot(load_urdf(path, supplement={'joints': joints}), friction=friction)


def controlled(robot, target, seconds, **weights):
    """Return the arm's trajectory with friction, and this model's controller."""
    controller = PredictiveController(TrajectoryOptimizer(
        robot, nodes=NODES, interval=INTERVAL, torque_limits=LIMITS, speed_limits=4.0,
        weights=CostWeights(**weights)))
    controller.set_target(target)
    path = simulate(arm(), START, [0.0, 0.0], seconds, step=CYCLE, sample=CYCLE,
                    integrator='implicit',
                    torque=lambda t, q, u: controller.torque(q, u, CYCLE))
    return path, controller


def test_a_target_is_reached_within_the_limits():
    path, controller = controlled(arm(), GOAL, 1.5)
    assert np.abs(path.q[-1] - GOAL).max() < 2e-3
    assert (np.abs(path.tau) <= LIMITS).all()
    assert (np.abs(path.tau) == LIMITS).any()
    assert np.abs(path.u).max() < 4.0 * 1.05
    assert controller.solution.tau.shape == (NODES, 2)


def test_friction_in_the_model_tracks_better_on_the_arm_with_friction():
    motion = Motion.from_points([0.0, 0.7, 1.4], [START, GOAL, START],
                                joint_names=arm().joint_names)
    errors = []
    for robot in (arm(), arm(friction=False)):
        path, _ = controlled(robot, motion, 1.4)
        q = motion.sample(path.t)[0]
        errors.append(np.sqrt(np.mean((path.q - q)**2)))
    assert errors[0] < 0.5 * errors[1], errors


def test_a_new_target_counts_in_the_next_cycle():
    path, controller = controlled(arm(), START, 0.1)
    torque_before = controller.torque(path.q[-1], path.u[-1], CYCLE)
    controller.set_target(GOAL)
    assert np.abs(
        controller.torque(path.q[-1], path.u[-1], CYCLE) - torque_before).max() > 1.0


@cache
def swing_up(kind):
    """Return the optimizer of a double pendulum, acrobot or pendubot, or of an arm."""
    if kind in ('fr3', 'ur10e'):
        return TrajectoryOptimizer(
            Robot(load_urdf(resource_path('urdf', f'{kind}.urdf'), tip=TIPS[kind])),
            nodes=30, interval=0.02)
    b = ModelBuilder(kind)
    b.body('upper', axis=(0, 1, 0), inertial=rod(1.0, (0, 0, 0), (0, 0, -1)))
    b.body('lower', 'upper', at=(0, 0, -1), axis=(0, 1, 0),
           inertial=rod(1.0, (0, 0, 0), (0, 0, -1)))
    limits = {'acrobot': [0.0, 20.0], 'pendubot': [20.0, 0.0]}[kind]
    weights = CostWeights(position=1.0, speed=0.1, end_position=1000.0, end_speed=100.0)
    return TrajectoryOptimizer(Robot(b.model()),
                               nodes=150, interval=0.02, weights=weights,
                               torque_limits=limits, speed_limits=np.inf)


TIPS = {'fr3': 'fr3_link7', 'ur10e': 'tool0'}


def torques_from_random_states(kind, starts, cycles, fastest=2.0):
    """Return the share of cycles with a plan; assert that torques keep limits."""
    problem = swing_up(kind)
    feasible = []
    n = problem.robot.n
    m = len(problem.actuator_names)
    for seed in range(starts):
        rng = np.random.default_rng(seed)
        controller = PredictiveController(problem, disturbance_gain=20.0 * (seed % 2))
        controller.set_target(rng.uniform(-np.pi, np.pi, n))
        if seed % 5 == 0:
            controller.start(10.0 * problem.torque_limits * rng.uniform(-1.0, 1.0, (
                problem.nodes, m)))
        for cycle in range(cycles):
            if cycle % 5 == 0:  # another state, which the last plan did not lead to
                q = rng.uniform(-np.pi, np.pi, n)
                u = rng.uniform(-1.0, 1.0, n) * 10.0**rng.uniform(-1.0, fastest)
            tau = controller.torque(q, u, 0.004)
            assert (np.abs(tau) <= problem.torque_limits).all(), (kind, seed, cycle)
            feasible.append(controller.solution.feasible)
            q = q + 0.004 * u
            u = u + rng.normal(0.0, 0.05, n)
    return np.mean(feasible)


@pytest.mark.parametrize(('kind', 'starts'),
                         [('acrobot', 20), ('pendubot', 20), ('fr3', 3),
                          ('ur10e', 3)])
def test_every_finite_state_has_a_torque(kind, starts):
    assert 0.1 < torques_from_random_states(
        kind, starts, 10) < 1.0, 'both cases must occur'


@pytest.mark.slow
@pytest.mark.timeout(1800)
@pytest.mark.parametrize('kind', ['acrobot', 'pendubot', 'fr3', 'ur10e'])
def test_every_one_of_a_thousand_finite_states_has_a_torque(kind):
    assert 0.1 < torques_from_random_states(
        kind, 1000, 10) < 1.0, 'both cases must occur'


def test_without_a_plan_the_last_one_moves_in_time_and_is_marked_infeasible():
    problem = swing_up('acrobot')
    controller = PredictiveController(problem)
    controller.set_target([np.pi, 0.0])
    controller.torque([0.0, 0.1], [0.0, 0.0], 0.02)
    plan = controller.solution
    assert plan.feasible
    for k in (1, 2):
        tau = controller.torque([0.0, 0.1], [1e150, -1e150], 0.02)
        moved = controller.solution
        assert not moved.feasible and not moved.converged
        np.testing.assert_allclose(tau, plan.tau[k], rtol=1e-13)
        np.testing.assert_allclose(moved.tau[:-k], plan.tau[k:], rtol=1e-13)
        assert (moved.q[:-k] == plan.q[k:]).all()
    controller.torque(plan.q[3], plan.u[3], 0.02)
    assert controller.solution.feasible


def test_an_estimate_from_an_impossible_state_is_dropped_with_it():
    controller = PredictiveController(swing_up('acrobot'), disturbance_gain=20.0)
    controller.set_target([np.pi, 0.0])
    controller.torque([0.0, 0.1], [0.0, 0.0], 0.02)
    controller.torque([0.0, 0.1], [1e100, -1e100], 0.02)
    assert not controller.solution.feasible
    assert not controller.disturbance.any()
    controller.torque([0.0, 0.1], [0.0, 0.0], 0.02)
    assert controller.solution.feasible
    assert not controller.disturbance.any()


def test_a_target_in_degrees_is_warned_of_and_a_robot_is_no_optimizer():
    problem = TrajectoryOptimizer(arm(), nodes=5)
    with pytest.warns(ModelWarning, match='target: .*degrees'):
        problem.set_target([90.0, 45.0])
    with pytest.raises(InputError,
                       match='optimizer: a Robot; expected a TrajectoryOptimizer'):
        PredictiveController(arm())


def test_a_first_state_without_a_plan_has_the_torques_of_gravity():
    problem = swing_up('acrobot')
    controller = PredictiveController(problem)
    controller.set_target([np.pi, 0.0])
    q = [0.3, 0.4]
    held = np.clip(problem.holding_torques(q), -problem.torque_limits,
                   problem.torque_limits)
    assert (controller.torque(q, [1e150, 0.0], 0.02) == held).all()
    assert not controller.solution.feasible and controller.solution.cost == np.inf


def test_the_first_cycle_begins_with_the_torques_that_are_stated():
    problem = swing_up('acrobot')
    controller = PredictiveController(problem)
    controller.set_target([np.pi, 0.0])
    problem.start(problem.holding_torques([0.0, 0.0]))
    plan = problem.solve([0.0, 0.0], [0.0, 0.0], iterations=1000)
    controller.start(plan.tau)
    controller.torque([0.0, 0.0], [0.0, 0.0], 0.0)
    assert controller.solution.cost <= plan.cost
    assert controller.solution.iterations < plan.iterations / 2
    with pytest.raises(InputError, match='tau: 3 rows'):
        controller.start(np.zeros((3, 2)))


def test_numbers_that_are_not_finite_change_nothing():
    controller = PredictiveController(swing_up('acrobot'), disturbance_gain=20.0)
    controller.set_target([np.pi, 0.0])
    controller.torque([0.0, 0.1], [0.0, 0.0], 0.02)
    solution_before = controller.solution
    for q, u, elapsed in (([np.nan, 0.0], [0.0, 0.0], 0.02),
                          ([0.0, 0.0], [np.inf, 0.0], 0.02),
                          ([0.0, 0.0], [0.0, 0.0], np.nan)):
        with pytest.raises(InputError):
            controller.torque(q, u, elapsed)
        assert controller.solution is solution_before
    with pytest.raises(InputError, match='disturbance_gain: -1'):
        PredictiveController(swing_up('acrobot'), disturbance_gain=-1.0)


@pytest.mark.parametrize('target', ['configuration', 'motion'])
def test_gravity_and_payload_may_change_while_the_target_stands(target):
    model = load_urdf(resource_path('urdf', 'two_link.urdf'))
    robot = Robot(model, payload_frame=model.frames[-1].name)
    goal = GOAL
    if target == 'motion':
        goal = Motion.from_points([0.0, 10.0], [GOAL, GOAL],
                                  joint_names=robot.joint_names)
    controller = PredictiveController(TrajectoryOptimizer(
        robot, nodes=NODES, interval=INTERVAL, torque_limits=3.0 * LIMITS))
    controller.set_target(goal)
    q = GOAL.copy()
    for change in ('payload', 'gravity'):
        controller.torque(q, [0.0, 0.0], CYCLE)
        if change == 'payload':
            robot.parameters.payload = Inertial(3.0, np.zeros(3), np.zeros((3, 3)))
        else:
            robot.parameters.gravity = [4.0, 0.0, -6.0]
        path = simulate(robot, q, [0.0, 0.0], 1.0, step=CYCLE, sample=CYCLE,
                        torque=lambda t, q, u: controller.torque(q, u, CYCLE))
        q = path.q[-1]
        assert np.abs(q - GOAL).max() < 1e-5
        np.testing.assert_allclose(path.tau[-1], robot.gravity_force(GOAL), atol=1e-2)


ERRORS = {'mass': 'masses and inertias 10 % larger', 'payload': '2 kg in the hand'}


def end_error(name, error, gain):
    """Return the distance from the target, rad, of an arm unlike its model."""
    model = load_urdf(resource_path('urdf', f'{name}.urdf'), tip=TIPS[name])
    arm = Robot(model, payload_frame=TIPS[name])
    if error == 'mass':
        arm = Robot(with_inertials(model, lambda inertial: replace(
            inertial, mass=1.1 * inertial.mass, inertia=1.1 * inertial.inertia)))
    else:
        arm.parameters.payload = Inertial(2.0, np.array([0.0, 0.0, 0.1]),
                                          np.zeros((3, 3)))
    start = {'fr3': [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785],
             'ur10e': [0.0, -1.57, 1.57, -1.57, -1.57, 0.0]}[name]
    target = np.array(start) + [0.8, 0.4, -0.4, 0.4, 0.4, 0.4, -0.6][:arm.n]
    controller = PredictiveController(swing_up(name), disturbance_gain=gain)
    controller.set_target(target)
    path = simulate(arm, start, np.zeros(arm.n), 3.0, step=CYCLE, sample=CYCLE,
                    integrator='implicit',
                    torque=lambda t, q, u: controller.torque(q, u, CYCLE))
    return np.abs(path.q[-1] - target).max()


@pytest.mark.parametrize(('name', 'error'), [('fr3', 'payload'), ('ur10e', 'mass')])
def test_an_estimated_disturbance_leaves_no_offset(name, error):
    assert end_error(name, error, 200.0) < 2e-3


@pytest.mark.slow
@pytest.mark.parametrize('name', ['fr3', 'ur10e'])
@pytest.mark.parametrize('error', ERRORS)
def test_an_offset_remains_only_without_an_estimate_of_the_disturbance(name, error):
    assert end_error(name, error, 0.0) > 5e-3
    assert end_error(name, error, 200.0) < 2e-3
