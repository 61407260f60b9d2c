"""Optimal torques of robots of every kind: optimality, loops, limits, replays."""

from functools import cache

from kane_dynamics import (absolute_rates, box, disc, InputError, load_urdf,
                           ModelBuilder, momenta, Motion, Robot, rod, Rolling, simulate)
from kane_dynamics._util.resources import resource_path
from kane_dynamics.errors import ConstraintError
from kane_dynamics.mechanics.ball_joints import coordinate_rates, difference, moved
from kane_dynamics.optimal_control import (CostWeights, PredictiveController,
                                           TrajectoryOptimizer)
from kinds_of_mechanism import Case, case, KINDS
from linkages import at_angle, four_bar, four_bar_model, PIN, sleigh
import numpy as np
from palletizer import palletizer, positions
import pytest

H = 0.03  # long, so that what closes the loops counts
SEVERAL = [*((kind,) for kind in KINDS[1:]), ('chosen speeds', 'closed loop'),
           pytest.param(('closed loop', 'free and ball joints'), marks=pytest.mark.slow),
           ('closed loop', 'flexible'),
           ('rolling disc',)]
each_kind = pytest.mark.parametrize('kinds', SEVERAL, ids=' and '.join)
and_momenta = pytest.mark.parametrize('kinds', [*SEVERAL, ('momenta of a loop',)],
                                      ids=' and '.join)


@cache
def mechanism(*kinds):
    """
    Return a case, also of two others.

    Constraints hold the height of the rolling disc and not its path, and speeds that are
    momenta change where the closing of loops moves joints.
    """
    if kinds == ('momenta of a loop',):
        robot = Robot(four_bar_model(), constraints=[PIN], speeds=momenta)
        return Case('momenta', robot, at_angle(0.6), np.array([0.1]), np.zeros(1), {})
    if kinds != ('rolling disc',):
        return case(*kinds)
    b = ModelBuilder('disc')
    b.body('disc', kind='floating', turns='zxy', inertial=disc(1.0, 0.3, axis=(0, 1, 0)))
    robot = Robot(b.model(), constraints=[Rolling('disc', 0.3, axis=(0, 1, 0))])
    lean = 0.2
    q = np.array([0.1, -0.2, 0.3 * np.cos(lean), 0.4, lean, 0.3])
    rates = np.array([0.5, -0.8, 1.2])
    return Case('rolling disc', robot, q, rates, 0.0 * rates, {})


@cache
def one_interval_problem(kinds):
    """Return an optimizer with one interval, and torques of moderate size."""
    this = mechanism(*kinds)
    problem = TrajectoryOptimizer(this.robot, nodes=1, interval=H, weights=CostWeights(
        excess_speed=2.0), speed_limits=0.5, torque_limits=np.inf)
    problem.set_target(this.q, this.time)
    return problem, np.linspace(-2.0, 3.0, len(problem.actuator_names))


def state_after_interval(kinds, q, u, tau):
    """Return the state after one interval."""
    problem, _ = one_interval_problem(kinds)
    problem.start(tau)
    optimum = problem.solve(q, u, iterations=0)
    return optimum.q[1], optimum.u[1], optimum.cost


def step_of(kinds):
    """Return the step in numbers."""
    return one_interval_problem(kinds)[0]._arrays._horizon._step


def directions(kinds, q, t):
    """Return joint speeds per unit of each direction of q, and the inverse."""
    step = step_of(kinds)
    return (np.array(step.tangent(q, t), dtype=float),
            np.array(step.along(q, t), dtype=float))


@and_momenta
def test_directions_of_the_configuration_keep_what_constraints_hold(kinds):
    this = mechanism(*kinds)
    tangent, along = directions(kinds, this.q, this.time)
    np.testing.assert_allclose(along @ tangent, np.eye(len(along)), atol=1e-12)
    step = step_of(kinds)
    eps = 1e-6
    if step.held:
        for column in tangent.T:
            open_by = []
            for s in (1.0, -1.0):
                open_by.append(np.array(
                    step.residual(moved(this.robot.model, this.q, s * eps * column),
                                  this.time), dtype=float))
            assert np.abs(open_by[0] - open_by[1]).max() / (2.0 * eps) < 1e-8


@each_kind
def test_a_step_follows_its_equation(kinds):
    this = mechanism(*kinds)
    problem, tau = one_interval_problem(kinds)
    robot = this.robot
    model = this.robot.model
    q, u, _ = state_after_interval(kinds, this.q, this.u, tau)
    smooth = Robot(model, **{**robot.options, 'friction': False})
    places = [robot.joint_names.index(name) for name in problem.actuator_names]
    still = np.array(step_of(kinds).equations.joint_speeds(this.q, 0.0 * u, this.time),
                     float)
    v = this.T @ u + still
    resisting = np.array(step_of(kinds).equations.tree.friction_force(v), dtype=float)
    for beam in (body.beam for body in model.bodies if body.beam is not None):
        resisting[list(beam.coordinates)] += (H * beam.stiffness
                                              @ v[list(beam.coordinates)])
    needed = (smooth.inverse_dynamics(this.q, this.u, (u - this.u) / H, **this.t)
              + this.T.T @ resisting)
    np.testing.assert_allclose(needed, this.T[places].T @ tau, atol=1e-6)
    went = this.q + H * coordinate_rates(model, this.q, v)
    second = 2.0 * (H * np.abs(v).max())**2
    assert np.abs(difference(model, moved(model, this.q, H * v), q)).max() < second
    if not step_of(kinds).held and not model.balls:
        np.testing.assert_allclose(q, went, atol=1e-12)


@and_momenta
def test_derivatives_of_a_step_are_those_of_central_differences(kinds):
    this = mechanism(*kinds)
    problem, tau = one_interval_problem(kinds)
    model = this.robot.model
    arrays = problem._arrays
    eps = 1e-5
    q1, _, _ = state_after_interval(kinds, this.q, this.u, tau)
    arrays.linearize()
    x = arrays.sizes.directions
    m = arrays.sizes.torques
    F, by_x, by_tau, _, _ = np.split(arrays.slopes[0], arrays._horizon._slope_ends)
    tangent, _ = directions(kinds, this.q, this.time)
    _, along = directions(kinds, q1, this.time + H)
    ways = [*((column, 0.0 * this.u, 0.0 * tau) for column in tangent.T),
            *((np.zeros(model.n), unit, 0.0 * tau) for unit in np.eye(this.robot.n)),
            *((np.zeros(model.n), 0.0 * this.u, unit) for unit in np.eye(m))]
    numeric = []
    slopes = []
    for move, change, push in ways:
        (qp, up, cp), (qm, um, cm) = (state_after_interval(
            kinds, moved(model, this.q, s * move), this.u + s * change, tau + s * push)
            for s in (eps, -eps))
        numeric.append(
            np.concatenate([along @ difference(model, qm, qp), up - um]) / (2 * eps))
        slopes.append((cp - cm) / (2 * eps))
    numeric = np.array(numeric).T
    F = F.reshape(x, x + m)
    np.testing.assert_allclose(F, numeric, rtol=0.0,
                               atol=2e-6 * max(1.0, np.abs(F).max()))
    whole = by_x @ F + np.concatenate([np.zeros(x), by_tau])
    np.testing.assert_allclose(whole, slopes, rtol=0.0, atol=1e-5 * np.abs(whole).max())


def gradient(problem, q, u, tau, where, inwards=False):
    """
    Return the derivatives of the total cost by the torques at these places.

    By central differences; `inwards`, by one-sided ones towards 0, since torques are
    clipped.
    """
    slopes = np.zeros(tau.shape)
    eps = 1e-5 * max(1.0, np.abs(tau).max())
    for place in zip(*np.nonzero(where)):
        costs = []
        sides = (0.0, -eps * np.sign(tau[place])) if inwards else (eps, -eps)
        for side in sides:
            shifted = tau.copy()
            shifted[place] += side
            problem.start(shifted)
            costs.append(problem.solve(q, u, iterations=0).cost)
        slopes[place] = (costs[0] - costs[1]) / (sides[0] - sides[1])
    return slopes


def require_optimum(problem, q, u, solution):
    """Fail unless the gradient is 0 off the limits or points beyond; return how many."""
    limits = problem.torque_limits
    first = np.tile(problem.holding_torques(q), (problem.nodes, 1))
    scale = np.abs(gradient(problem, q, u, 0.5 * np.clip(first, -limits, limits),
                            np.ones(first.shape))).max()
    assert solution.converged and (np.abs(solution.tau) <= limits).all()
    held = np.abs(solution.tau) == limits
    free = gradient(problem, q, u, solution.tau, ~held)
    assert np.abs(free).max() < 1e-4 * scale, (np.abs(free).max(), scale)
    pushed = gradient(problem, q, u, solution.tau, held, True) * np.sign(solution.tau)
    assert (pushed[held] < 1e-4 * scale).all()
    return (pushed[held] < -1e-3 * scale).sum()


@each_kind
def test_the_optimum_is_stationary_off_the_limits_and_held_by_them(kinds):
    this = mechanism(*kinds)
    robot = this.robot
    goal = robot.integrate(this.q, 0.5 * np.abs(this.u), **this.t)
    held = 0
    largest = np.inf
    for share in (1.0, 0.6):
        problem = TrajectoryOptimizer(robot, nodes=8, interval=0.02,
                                      torque_limits=share * largest)
        problem.set_target(goal, this.time)
        problem.start(np.clip(problem.holding_torques(this.q), -problem.torque_limits,
                              problem.torque_limits))
        first = problem.solve(this.q, this.u, iterations=0).cost
        solution = problem.solve(this.q, this.u, iterations=200, tolerance=1e-12)
        assert solution.cost < first
        largest = np.abs(solution.tau).max(axis=0)
        held += require_optimum(problem, this.q, this.u, solution)
        residual = robot.constraint_residual(solution.q,
                                             t=this.time + 0.02 * np.arange(9)) if (
                                                 robot.constraint_names) else np.zeros(1)
        assert np.abs(residual).max() < 1e-9
    assert held >= 1, 'a limit must hold a torque'


def test_a_tree_in_absolute_rates_has_the_optimum_of_joint_rates():
    joints = {'friction': 1.0, 'friction_speed': 0.05, 'damping': 0.5}
    path = resource_path('urdf', 'two_link_planar.urdf')
    names = load_urdf(path).joint_names
    model = load_urdf(path, supplement={'joints': dict.fromkeys(names, joints)})
    solutions = []
    for options in ({}, {'speeds': absolute_rates}):
        robot = Robot(model, **options)
        problem = TrajectoryOptimizer(robot, nodes=15, interval=0.02,
                                      torque_limits=[12.0, 4.0], speed_limits=2.0)
        problem.set_target([0.7, -0.5])
        problem.start([0.0, 0.0])
        u = np.linalg.solve(
            np.stack([robot.joint_rates([0.1, 0.4], unit) for unit in np.eye(2)],
                     axis=1), [0.5, -1.0])
        solutions.append(problem.solve([0.1, 0.4], u, iterations=300, tolerance=1e-13))
    tree, chosen = solutions
    assert chosen.cost == pytest.approx(tree.cost, rel=1e-8)
    assert (np.abs(tree.tau) == [12.0, 4.0]).any()
    np.testing.assert_allclose(chosen.q, tree.q, atol=1e-5)


def replayed(robot, problem, q, goal):
    """Return the plan from rest to the goal, and a simulation of its torques."""
    problem.set_target(goal)
    problem.start(problem.holding_torques(q))
    plan = problem.solve(q, np.zeros(robot.n), iterations=200)
    assert plan.converged and (np.abs(plan.tau) <= problem.torque_limits).all()
    assert np.abs(robot.constraint_residual(plan.q)).max() < 1e-9
    places = [robot.joint_names.index(name) for name in problem.actuator_names]

    def torque(t, q, u):
        tau = np.zeros(robot.model.n)
        tau[places] = plan.tau[min(int(t / problem.interval + 1e-9), problem.nodes - 1)]
        return robot.generalized_force(tau, q)
    path = simulate(robot, q, np.zeros(robot.n), problem.nodes * problem.interval,
                    step=problem.interval, torque=torque, integrator='implicit')
    return plan, path


def test_a_four_bar_swings_to_its_target_within_limits_as_a_simulation_does():
    robot = four_bar('crank')
    start = at_angle(0.6)
    goal = at_angle(1.6)
    problem = TrajectoryOptimizer(robot, nodes=400, interval=0.002, torque_limits=12.0,
                                  weights=CostWeights(torque=1e-4, end_position=1000.0))
    plan, path = replayed(robot, problem, start, goal)
    assert np.abs(plan.q[-1] - goal).max() < 1e-2
    assert np.abs(path.q[-1] - goal).max() < 2e-2
    assert (np.abs(plan.tau) == 12.0).any()


def test_the_palletizer_reaches_a_target_within_its_limits_as_a_simulation_does():
    robot = palletizer()
    start = positions(robot, *(0.0, 0.3, -0.2, 0.0))
    goal = positions(robot, *(0.5, 0.6, -0.4, 0.8))
    problem = TrajectoryOptimizer(robot, nodes=200, interval=0.004, weights=CostWeights(
        position=1000.0, torque=1e-6, end_position=1e4, end_speed=10.0))
    plan, path = replayed(robot, problem, start, goal)
    assert np.abs(plan.q[-1] - goal).max() < 2e-2
    assert np.abs(path.q[-1] - goal).max() < 3e-2
    assert (np.abs(path.u) <= 1.1 * problem.speed_limits[
        [robot.joint_names.index(name) for name in robot.speed_names]]).all()


def test_an_arm_on_a_free_body_turns_it_without_forces_on_that_body():
    b = ModelBuilder('satellite', gravity=(0, 0, 0))
    b.body('craft', kind='free', inertial=box(8.0, (0.6, 0.4, 0.3)))
    for name, on, axis in (('arm', 'craft', (0, 1, 0)), ('fore', 'arm', (0, 0, 1))):
        b.body(name, on, axis=axis, at=(0.4, 0, 0),
               inertial=rod(2.0, (0, 0, 0), (0.4, 0, 0)))
    robot = Robot(b.model())
    turning = [*[0.0] * 3, *[100.0] * 3, 0.0, 0.0]
    limits = [0.0 if name.startswith('craft') else 5.0 for name in robot.joint_names]
    start = robot.neutral()
    turned = robot.integrate(start, [0, 0, 0, 0.0, 0.2, 0.1, 0, 0])
    drifts = []
    for nodes in (60, 120):
        problem = TrajectoryOptimizer(
            robot, nodes=nodes, interval=1.2 / nodes, torque_limits=limits,
            weights=CostWeights(
                position=turning, end_position=turning, speed=0.01, torque=1e-4))
        problem.set_target(turned)
        plan = problem.solve(start, np.zeros(robot.n), iterations=200)
        assert (plan.tau[:, :6] == 0.0).all()
        left = np.linalg.norm(robot.difference(plan.q[-1], turned)[3:6])
        first = np.linalg.norm(robot.difference(start, turned)[3:6])
        assert left < 0.3 * first
        np.testing.assert_allclose(np.linalg.norm(plan.q[:, 3:7], axis=1), 1.0,
                                   atol=1e-14)
        com = robot.center_of_mass(plan.q)
        drifts.append(np.abs(com - com[0]).max())
    assert drifts[0] < 5e-3
    assert drifts[1] < 0.6 * drifts[0], 'the step is of first order'


def test_no_force_acts_on_a_floating_base_unless_its_actuators_are_stated():
    b = ModelBuilder('satellite', gravity=(0, 0, 0))
    b.body('craft', kind='free', inertial=box(8.0, (0.6, 0.4, 0.3)))
    b.body('arm', 'craft', axis=(0, 1, 0), at=(0.4, 0, 0),
           inertial=rod(2.0, (0, 0, 0), (0.4, 0, 0)))
    robot = Robot(b.model())
    assert TrajectoryOptimizer(robot, nodes=1).torque_limits.tolist() == [0.0] * 6 + [
        np.inf]
    pushed = TrajectoryOptimizer(robot, nodes=1, torque_limits=3.0)
    assert pushed.torque_limits.tolist() == [3.0] * 7
    problem = TrajectoryOptimizer(robot, nodes=10, interval=0.05)
    start = robot.neutral()
    problem.set_target(robot.integrate(start, [0.3, 0, 0, 0, 0, 0, 0.2]))
    plan = problem.solve(start, np.zeros(robot.n))
    com = robot.center_of_mass(plan.q)
    assert (plan.tau[:, :6] == 0.0).all() and np.abs(plan.tau[:, 6]).max() > 0.1
    # No external force acts. The step, of first order, moves the center of mass a
    # little.
    assert np.abs(com - com[0]).max() < 0.1 * np.abs(plan.q[-1, :3]).max()


def test_a_body_without_actuators_is_refused():
    b = ModelBuilder('craft', gravity=(0, 0, 0))
    b.body('craft', kind='free', inertial=box(8.0, (0.6, 0.4, 0.3)))
    with pytest.raises(InputError,
                       match=r'no actuator but craft/x.*expected actuated joints'):
        TrajectoryOptimizer(Robot(b.model()))
    assert TrajectoryOptimizer(Robot(b.model()), nodes=1, torque_limits=5.0).nodes == 1


def test_a_sleigh_goes_to_its_target_and_never_across_its_runner():
    robot = sleigh()
    problem = TrajectoryOptimizer(robot, nodes=100, interval=0.02, torque_limits=20.0)
    goal = np.array([0.5, 0.5, 0.8])
    problem.set_target(goal)
    start = np.zeros(3)
    problem.start(problem.holding_torques(start))
    plan = problem.solve(start, np.zeros(robot.n), iterations=300)
    assert np.linalg.norm(plan.q[-1] - goal) < 0.3 * np.linalg.norm(goal)
    rates = np.diff(plan.q, axis=0) / 0.02
    angle = plan.q[:-1, 2]
    across = -np.sin(angle) * rates[:, 0] + np.cos(angle) * rates[:, 1]
    np.testing.assert_allclose(across, 0.0, atol=1e-9)


def test_a_predictive_controller_moves_a_four_bar_to_its_target():
    robot = four_bar('crank')
    start = at_angle(0.6)
    goal = at_angle(1.4)
    controller = PredictiveController(TrajectoryOptimizer(
        robot, nodes=20, interval=0.02, torque_limits=60.0))
    controller.set_target(goal)
    path = simulate(robot, start, [0.0], 1.2, step=0.01, sample=0.01,
                    torque=lambda t, q, u: controller.torque(q, u, 0.01))
    assert np.abs(path.q[-1] - goal).max() < 5e-3
    assert (np.abs(path.tau) <= 60.0).all()


def test_a_motion_of_the_crank_is_tracked_with_all_joints_and_its_torques():
    start = at_angle(0.6)
    motion = Motion.from_points([0.0, 0.4, 0.8], [[0.6], [1.0], [0.7]],
                                joint_names=('crank',))
    robot = Robot(four_bar_model(), constraints=[PIN], independent=['crank'],
                  configuration=start)
    problem = TrajectoryOptimizer(robot, nodes=400, interval=0.002, weights=CostWeights(
        position=1e4, torque=1e-3))
    problem.set_target(motion)
    q, u, udot = motion.sample(np.array([0.0, 0.3]))
    problem.start([0.0])
    plan = problem.solve(start, u[0], iterations=100)
    assert np.abs(plan.q[150, 0] - q[1, 0]) < 2e-3
    closed = robot.closed_configuration([q[1, 0], *plan.q[150, 1:]], fixed=['crank'])
    needed = robot.inverse_dynamics(closed, u[1], udot[1])
    assert plan.tau[149] == pytest.approx(needed, rel=0.05)
    later = TrajectoryOptimizer(robot, nodes=2, interval=0.002)
    later.set_target(motion, 0.298)
    np.testing.assert_allclose(later._arrays.targets[0, :3], closed, atol=1e-9)


def test_a_predictive_controller_keeps_the_time_of_functions_of_time():
    this = case('time-dependent')
    robot = this.robot
    t = this.time
    problem = TrajectoryOptimizer(robot, nodes=10, interval=0.02)
    controller = PredictiveController(problem)
    desired = this.q.copy()
    controller.set_target(desired, t)
    desired[:] = np.nan  # the controller keeps its own
    q = this.q
    u = 0.0 * this.u
    for _ in range(150):
        tau = np.zeros(robot.model.n)
        tau[[robot.joint_names.index(name) for name in problem.actuator_names]] = (
            controller.torque(q, u, 0.01))
        path = simulate(robot, q, u, 0.01, step=0.005, t0=t,
                        torque=robot.generalized_force(tau, q, t=t))
        q = path.q[-1]
        u = path.u[-1]
        t = t + 0.01
    free = robot.joint_names.index('upper')
    assert abs(q[free] - this.q[free]) < 0.02
    assert abs(q[1 - free] - 0.3 * np.sin(2.0 * t)) < 1e-9


def test_bad_arguments_of_mechanisms_are_named():
    robot = four_bar('crank')
    q = at_angle(0.6)
    with pytest.raises(InputError, match=r'torque_limits.*expected one number, or 1'):
        TrajectoryOptimizer(robot, torque_limits=[1.0, 2.0, 3.0])
    with pytest.raises(InputError, match='robot: a str; expected a Robot'):
        TrajectoryOptimizer('arm')
    problem = TrajectoryOptimizer(robot, nodes=2)
    with pytest.raises(InputError, match='target: none; expected a call of set_target'):
        problem.solve(q, [0.0])
    with pytest.raises(InputError, match='target: shape'):
        problem.set_target([0.6])
    with pytest.raises(ConstraintError, match='pin'):
        problem.set_target(q + [0.0, 0.1, 0.0])
    with pytest.raises(InputError, match=r't \(s\)'):
        problem.set_target(q, np.nan)
    problem.set_target(q)
    with pytest.raises(ConstraintError, match='pin'):
        problem.solve(q + [0.0, 0.1, 0.0], [0.0])
    with pytest.raises(InputError, match='u: shape'):
        problem.solve(q, [0.0, 0.0, 0.0])
    with pytest.raises(InputError, match='passes a singularity'):
        problem.solve(q, [3000.0])
    craft = case('free and ball joints').robot
    with pytest.raises(InputError, match='quaternion'):
        TrajectoryOptimizer(craft, nodes=1).set_target(0.5 * craft.neutral())
