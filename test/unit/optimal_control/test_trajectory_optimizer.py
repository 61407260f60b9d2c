"""Optimal torques over a horizon: gradients, optimality, limits, friction, errors."""

from functools import cache

from kane_dynamics import box, InputError, load_urdf, ModelBuilder, Motion, Robot, rod
from kane_dynamics._util.resources import resource_path
from kane_dynamics.optimal_control import CostWeights, TrajectoryOptimizer
from kane_dynamics.optimal_control.backward_step import limited_minimum
from kane_dynamics.optimal_control.horizon import cost_slopes, HorizonLimits
import numpy as np
import pytest
from scipy.optimize import lsq_linear, minimize
from step_of_trees import implicit_friction_slopes, implicit_friction_step

NODES = 12
INTERVAL = 0.02
GOAL = np.array([0.7, -0.5])
FRICTION = {'friction': 1.0, 'friction_speed': 0.05, 'damping': 0.5}


@cache
def arm(friction=True):
    """Return a two-link arm with Coulomb friction."""
    model = load_urdf(resource_path('urdf', 'two_link.urdf'))
    joints = dict.fromkeys(model.joint_names, FRICTION)
    return Robot(load_urdf(resource_path('urdf', 'two_link.urdf'),
                           supplement={'joints': joints}), friction=friction)


def optimizer(robot, **options):
    """Return an optimizer that is to reach `GOAL`."""
    problem = TrajectoryOptimizer(robot, **{
        'nodes': NODES, 'interval': INTERVAL, 'torque_limits': [30.0, 8.0],
        'speed_limits': [3.0, 3.0], 'weights': CostWeights(excess_speed=50.0),
        **options})
    problem.set_target(GOAL)
    return problem


def gradient(problem, solution):
    """Return the cost's derivative by all torques, (N, n), last to first."""
    robot = problem.robot
    arrays = problem._arrays
    h = problem.interval
    n = robot.n
    limits = HorizonLimits(-problem.torque_limits, problem.torque_limits,
                           problem.speed_limits,
                           np.full(robot.n, problem.weights.excess_speed))
    slopes = np.zeros((problem.nodes, n))
    v = np.zeros(2 * n)
    for i in reversed(range(problem.nodes)):
        x = np.concatenate([solution.q[i + 1], solution.u[i + 1]])
        away = np.concatenate([x, solution.tau[i]]) - arrays.targets[i]
        g, _ = cost_slopes(away, x[n:], arrays.weights[i], limits)
        A, B, W = implicit_friction_slopes(
            robot.equations.tree, solution.q[i], solution.u[i], solution.tau[i], h,
            robot.parameters.block).astype(float)
        v = v + g[:2 * n].astype(float)
        w = v[n:] + h * v[:n]  # of the speed at the end
        slopes[i] = h * w @ W + g[2 * n:].astype(float)
        v = np.concatenate([v[:n] + h * w @ A, w + h * w @ B])
    return slopes


@pytest.mark.parametrize('friction', [True, False])
def test_the_gradient_of_the_total_cost_is_that_of_finite_differences(friction):
    problem = optimizer(arm(friction))
    rng = np.random.default_rng(1)
    tau = rng.uniform(-7.0, 7.0, (NODES, 2))

    def cost(x):
        problem.start(x.reshape(NODES, 2))
        return problem.solve([0.1, 0.4], [0.5, -1.0], iterations=0).cost
    cost(tau.ravel())
    exact = gradient(problem, problem.solve([0.1, 0.4], [0.5, -1.0],
                                            iterations=0)).ravel()
    steps = 1e-5 * np.eye(2 * NODES)
    numeric = [(cost(tau.ravel() + e) - cost(tau.ravel() - e)) / 2e-5 for e in steps]
    np.testing.assert_allclose(exact, numeric, rtol=1e-5,
                               atol=1e-6 * np.abs(numeric).max())


def test_the_result_is_that_of_an_independent_shooting_method():
    problem = optimizer(arm())
    problem.start([0.0, 0.0])
    solution = problem.solve([0.1, 0.4], [0.5, -1.0], iterations=300)
    assert solution.converged

    def total(x):
        problem.start(x.reshape(NODES, 2))
        return problem.solve([0.1, 0.4], [0.5, -1.0], iterations=0).cost
    bounds = []
    for _ in range(NODES):
        for limit in problem.torque_limits:
            bounds.append((-limit, limit))
    peer = minimize(total, np.zeros(2 * NODES), bounds=bounds, method='L-BFGS-B',
                    options={'maxfun': 40000, 'ftol': 1e-14, 'gtol': 1e-9})
    assert solution.cost <= peer.fun * (1.0 + 1e-6)
    assert solution.cost == pytest.approx(peer.fun, rel=1e-4)


def test_torques_keep_their_limits_exactly_and_are_optimal_there():
    problem = optimizer(arm(friction=False))
    problem.start([0.0, 0.0])
    first = problem.solve([0.1, 0.4], [0.5, -1.0], iterations=0)
    scale = np.abs(gradient(problem, first)).max()
    solution = problem.solve([0.1, 0.4], [0.5, -1.0], iterations=300)
    limits = problem.torque_limits
    assert solution.converged and (np.abs(solution.tau) <= limits).all()
    held = np.abs(solution.tau) == limits
    assert held.sum() >= 3, 'the limits must be active'
    slope = gradient(problem, solution)
    assert np.abs(slope[~held]).max() < 1e-5 * scale
    assert (slope[held] * np.sign(solution.tau[held])
            < 0.0).all(), 'the limits must hold them'


def test_speeds_exceed_their_limits_by_little():
    far = np.array([2.5, -2.0])
    excess = []
    for weight in (0.0, 1e4):
        problem = optimizer(arm(), nodes=30, torque_limits=[200.0, 60.0],
                            weights=CostWeights(excess_speed=weight))
        problem.set_target(far)
        problem.start(arm().gravity_force([0.0, 0.0]))
        solution = problem.solve([0.0, 0.0], [0.0, 0.0], iterations=200)
        excess.append(np.abs(solution.u).max() / 3.0)
    assert excess[0] > 1.2
    assert excess[1] < 1.01


def test_a_step_follows_its_equation_with_friction_at_its_end():
    robot = arm()
    h = 0.02
    q = np.array([0.3, -0.4])
    u = np.array([0.6, -0.2])
    tau = np.array([9.0, -2.0])
    state_after, speed = implicit_friction_step(robot.equations.tree, q, u, tau, h,
                                                robot.parameters.block)
    smooth = Robot(robot.model, friction=False)
    needed = (smooth.inverse_dynamics(q, u, (np.array(speed, float) - u) / h)
              + robot.friction_force(np.array(speed, float)))
    np.testing.assert_allclose(needed, tau, atol=1e-2)
    np.testing.assert_allclose(np.array(state_after, float),
                               q + h * np.array(speed, float))


def test_friction_stops_a_joint_without_reversing_it():
    robot = arm()
    held = robot.gravity_force([0.3, -0.4])
    for speed in (1e-3, 0.02, 0.1):
        _, speed_after = implicit_friction_step(
            robot.equations.tree, np.array([0.3, -0.4]),
            np.array([0.0, speed]), held, 0.05, robot.parameters.block)
        assert -1e-3 < speed_after[1] <= speed


@pytest.mark.parametrize(('condition', 'share'), [(10.0, 1.0), (1e3, 0.8)])
def test_the_quadratic_within_bounds_never_costs_more_than_no_change(condition, share):
    rng = np.random.default_rng(0)
    exact = []
    for _ in range(40):
        basis, _ = np.linalg.qr(rng.normal(size=(7, 7)))
        Q = basis @ np.diag(np.geomspace(1.0, condition, 7)) @ basis.T
        g = 2.0 * Q @ rng.normal(size=7)
        lower = -rng.uniform(0.0, 2.0, 7)
        upper = rng.uniform(0.0, 2.0, 7)
        k, _ = limited_minimum(Q, g, np.zeros((7, 14)), lower, upper)
        k = np.array(k, dtype=float)
        assert (lower <= k).all() and (k <= upper).all()
        C = np.linalg.cholesky(Q)
        best = lsq_linear(C.T, -np.linalg.solve(C,
                                                g), bounds=(lower, upper), tol=1e-14).x
        value = g @ k + 0.5 * k @ Q @ k
        least = g @ best + 0.5 * best @ Q @ best
        assert value <= 0.0
        exact.append(value <= least + 1e-6 * abs(least))
    assert np.mean(exact) >= share, np.mean(exact)


def test_gravity_of_the_robot_counts_when_solving():
    robot = arm(friction=False).copy()
    problem = optimizer(robot, torque_limits=500.0)
    first = problem.solve([0.0, 0.0], [0.0, 0.0], iterations=50).tau
    robot.parameters.gravity = [0.0, 0.0, 0.0]
    problem.set_target(GOAL)
    problem.start([0.0, 0.0])
    without = problem.solve([0.0, 0.0], [0.0, 0.0], iterations=50).tau
    assert np.abs(first - without).max() > 1.0


def test_a_speed_limit_of_zero_holds_a_joint_at_rest_and_the_others_move():
    b = ModelBuilder('table', gravity=(0.0, 0.0, 0.0))
    for name, on, axis in (('x', 'world', (1, 0, 0)), ('y', 'x', (0, 1, 0))):
        b.body(name, on, kind='prismatic', axis=axis, inertial=box(1.0, (0.1, 0.1, 0.1)))
    problem = TrajectoryOptimizer(Robot(b.model()), nodes=10, interval=0.05,
                                  speed_limits=[0.0, 1.0])
    problem.set_target([0.0, 0.2])
    for _ in range(2):
        solution = problem.solve([0.0, 0.0], [0.0, 0.0])
        assert solution.converged and solution.q[-1, 1] > 0.1
        assert (solution.q[:, 0] == 0.0).all()


def test_derivatives_that_overflow_leave_torques_and_no_feedback():
    b = ModelBuilder('upright')
    b.body('rod', axis=(0, 1, 0), inertial=rod(1.0, (0, 0, 0), (0, 0, 0.01)))
    problem = TrajectoryOptimizer(Robot(b.model()),
                                  nodes=200, interval=0.1, torque_limits=0.0)
    problem.set_target([0.1])
    for _ in range(2):
        solution = problem.solve([0.0], [0.0])
        assert not solution.converged
        assert (solution.q == 0.0).all() and (solution.gains == 0.0).all()


@pytest.mark.parametrize(('angles', 'cost'), [([0.0, 0.0], 100.0), ([0.0, 0.1], 150.0),
                                              ([0.1, 0.0], 400.0)])
def test_an_acrobot_swings_up_though_its_torque_weighs_little(angles, cost):
    b = ModelBuilder('acrobot')
    b.body('upper', axis=(0, 1, 0), inertial=rod(1.0, (0, 0, 0), (0, 0, -1)))
    b.body('lower', 'upper', at=(0, 0, -1), axis=(0, 1, 0),
           inertial=rod(1.0, (0, 0, 0), (0, 0, -1)))
    robot = Robot(b.model())
    problem = TrajectoryOptimizer(
        robot, nodes=150, interval=0.02, torque_limits=[0.0, 5.0], speed_limits=np.inf,
        weights=CostWeights(position=0.0, speed=0.0, torque=4.4e-7, end_position=8.4e4,
                            end_speed=2.2e3))
    problem.set_target([np.pi, 0.0])
    problem.start([0.0, 0.0])
    plan = problem.solve(angles, [0.0, 0.0], iterations=1000)
    assert plan.cost < cost, 'without torque it is 4e5'
    udot = np.diff(plan.u, axis=0) / problem.interval
    needed = robot.inverse_dynamics(plan.q[:-1], plan.u[:-1], udot)
    np.testing.assert_allclose(needed, plan.tau, atol=1e-8)


@pytest.mark.parametrize('elapsed', [0.0, INTERVAL, 2.25 * INTERVAL, 100.0])
def test_shifted_torques_are_those_of_a_later_time(elapsed):
    problem = optimizer(arm())
    tau = np.random.default_rng(1).uniform(-5.0, 5.0, (NODES, 2))
    problem.start(tau)
    problem.shift(elapsed)
    later = np.arange(NODES) + elapsed / INTERVAL
    expected = np.stack([np.interp(later, np.arange(NODES), column) for column in tau.T],
                        axis=1)
    np.testing.assert_allclose(problem.solve([0.2, 0.4], [0.0, 0.0], iterations=0).tau,
                               expected, rtol=0, atol=1e-12)


def test_a_shifted_plan_continues_with_the_torques_and_feedback_of_its_states():
    problem = optimizer(arm())
    plan = problem.solve([0.2, 0.4], [0.0, 0.0])
    assert np.abs(np.diff(plan.gains[:4], axis=0)).max() > 0.1
    problem.shift(INTERVAL)
    state = np.concatenate([plan.q[1], plan.u[1]])
    again = problem.solve(state[:2], state[2:], iterations=0)
    np.testing.assert_allclose(again.tau[:-1], plan.tau[1:], rtol=0, atol=1e-12)
    np.testing.assert_allclose(again.q[:-1], plan.q[1:], rtol=0, atol=1e-12)
    # From another state on, the plan's feedback acts at the later states.
    other = state + [0.01, -0.02, 0.1, 0.2]
    away = problem.solve(other[:2], other[2:], iterations=0)
    for k in range(1, NODES - 1):
        off = np.concatenate([away.q[k] - plan.q[k + 1], away.u[k] - plan.u[k + 1]])
        torque = plan.tau[k + 1] + plan.gains[k + 1] @ off
        expected = np.clip(torque, [-30.0, -8.0], [30.0, 8.0])
        np.testing.assert_allclose(away.tau[k], expected, rtol=0, atol=1e-9)
    assert np.abs(away.tau[1:-1] - plan.tau[2:]).max() > 0.1


def test_bad_arguments_are_named():
    robot = arm()
    for options, words in (
            ({'nodes': 0}, 'nodes: 0'), ({'interval': -1.0}, 'interval: -1'),
            ({'torque_limits': [1.0]}, 'torque_limits'),
            ({'weights': CostWeights(torque=0.0)}, 'weights.torque'),
            ({'weights': CostWeights(speed=-1.0)}, 'weights.speed'),
            ({'weights': 3.0}, 'weights: a float; expected a CostWeights')):
        with pytest.raises(InputError, match=words):
            optimizer(robot, **options)
    problem = optimizer(robot)
    with pytest.raises(InputError, match='q of joint'):
        problem.solve([np.nan, 0.0], [0.0, 0.0])
    for elapsed in (-1.0, None, 'soon', np.nan):
        with pytest.raises(InputError,
                           match=r'elapsed: .*; expected a finite time >= 0'):
            problem.shift(elapsed)
    for tolerance in (-1.0, None, np.nan):
        with pytest.raises(InputError, match=r'tolerance: .*; expected a number >= 0'):
            problem.solve([0.0, 0.0], [0.0, 0.0], tolerance=tolerance)
    for tau, words in ((1.0, r'tau: shape \(\)'), ([], r'tau: shape \(0,\)'),
                       (None, 'tau: shape'),
                       (np.zeros((2, 5, 2)), r'tau: shape \(2, 5, 2\)')):
        with pytest.raises(InputError, match=words):
            problem.start(tau)
    with pytest.raises(InputError, match='tau: 3 rows'):
        problem.start(np.zeros((3, 2)))
    with pytest.raises(InputError, match=r"motion: joints \['a', 'b'\]"):
        problem.set_target(Motion.from_points([0.0, 1.0], np.zeros((2, 2)),
                                              joint_names=['a', 'b']))
    with pytest.raises(InputError, match='not finite'):
        problem.solve([0.0, 0.0], [1e200, 0.0])
