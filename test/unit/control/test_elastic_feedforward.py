"""Inverse dynamics of elastic joints to 4th order, against differentiated ones."""

from dataclasses import replace
import math

from differentiated import taylor_motion, time_derivatives
from kane_dynamics import (Drive, Inertial, InputError, ModelBuilder, Motion, point_mass,
                           Robot, rod, simulate, SmoothMotion, StiffnessCurve,
                           with_drives)
from kane_dynamics.control.elastic_feedforward import ElasticFeedforward
from kane_dynamics.mechanics.definition import kane
from kane_dynamics.model.elastic_model import link_side
from mechanisms import random_model
import numpy as np
from numpy.testing import assert_allclose
import pytest
from scipy.integrate import solve_ivp

SMOOTH = {'damping': 0.7, 'friction': 1.2, 'friction_speed': 2.0, 'friction_offset': 0.1}
CURVE = StiffnessCurve([0.01, 0.03], [6.0, 40.0], rounding=0.01)


def elastic_robot(seed, **options):
    """Return a random tree with springs, curves and rigid joints, and a motion."""
    model = random_model(seed, 5)
    bodies = []
    for body in model.bodies:  # friction that changes slowly, for the reference
        bodies.append(replace(body, joint=replace(body.joint, friction_speed=2.0)))
    model = replace(model, bodies=tuple(bodies))
    drives = {}
    for k, name in enumerate(model.joint_names[:-1]):
        stiffness = 900.0 if k % 2 else CURVE
        drives[name] = Drive(stiffness, rotor_inertia=0.2 + 0.1 * k, friction=SMOOTH)
    rates = np.random.default_rng(seed).normal(size=(5, model.n))
    return Robot(with_drives(model, drives), **options), rates


def assert_rows(rows, robot, motion, torque_at, tolerance=1e-9):
    """Compare rows with differentiated torques, and with the elastic equations."""
    links = [elastic.link for elastic in robot.drives]
    expected = time_derivatives(torque_at, 2)
    for order in range(3):
        size = np.abs(expected[order]).max()
        assert_allclose(rows[order], expected[order], rtol=0, atol=tolerance * size)
    # Links and motors together satisfy the equations of second order.
    q, u, udot = motion(0.0)
    n = len(q)
    full = np.zeros((3, robot.n))
    full[:, :n] = q, u, udot
    for elastic in robot.drives:
        full[:, elastic.motor] = rows[3:6, elastic.link]
    tau = robot.inverse_dynamics(*full)
    size = np.abs(rows[6]).max() + np.abs(rows[0]).max()
    assert_allclose(tau[[e.motor for e in robot.drives]], rows[6, links],
                    rtol=0, atol=tolerance * size)
    return tau[:n], links, size


@pytest.mark.parametrize('seed', range(3))
def test_outputs_are_those_of_the_differentiated_definition(seed):
    robot, rates = elastic_robot(seed)
    links = link_side(robot.model)
    motion = taylor_motion(*rates)
    rows = ElasticFeedforward(robot)(*rates)

    def torque_at(t):
        return kane.inverse_dynamics(links, *motion(t))
    tau, elastic, size = assert_rows(rows, robot, motion, torque_at)
    assert_allclose(tau[elastic], 0.0, atol=1e-9 * size)

    # The motor's motion, from the differentiated deflection k(delta) = tau_J.
    def motor_at(t):
        q, u, udot = motion(t)
        torque = kane.inverse_dynamics(links, q, u, udot)
        for e in robot.drives:
            q[e.link] = q[e.link] + deflection(e.drive, torque[e.link])
        return q
    expected = time_derivatives(motor_at, 2)
    for order in range(3):
        assert_allclose(rows[3 + order], expected[order], rtol=0,
                        atol=1e-9 * np.abs(expected[order]).max())


def deflection(drive, torque):
    """Return a spring's deflection by bisection of its curve as documented."""
    if not isinstance(drive.stiffness, StiffnessCurve):
        return torque / drive.stiffness
    x = CURVE.deflection
    y = CURVE.torque
    k1 = y[0] / x[0]
    k2 = (y[1] - y[0]) / (x[1] - x[0])

    def ramp(z):  # the second integral of 35 / (32 w) (1 - (z / w)^2)^3
        s = min(max(z / CURVE.rounding, -1.0), 1.0)
        within = (s / 2 + 35 / 32 * (s**2 / 2 - s**4 / 4 + s**6 / 10 - s**8 / 56)
                  + 35 / 256)
        return CURVE.rounding * within + max(z - CURVE.rounding, 0.0)
    low = -10.0
    high = 10.0
    for _ in range(200):
        middle = 0.5 * (low + high)
        value = k1 * middle + (k2 - k1) * (ramp(middle - x[0]) - ramp(-middle - x[0]))
        low, high = (middle, high) if value < torque else (low, middle)
    return 0.5 * (low + high)


def test_payload_wrenches_and_gravity_may_vary_in_time():
    robot, rates = elastic_robot(1)
    frame = robot.model.frames[-1].name
    robot = Robot(robot.model, wrench_frames=(frame,), payload_frame=frame)
    robot.parameters.payload = Inertial(2.0, (0.1, 0.0, 0.2), 0.01 * np.eye(3))
    rng = np.random.default_rng(5)
    gravity = rng.normal(size=(3, 3))
    wrench = rng.normal(size=(3, 1, 6))
    robot.parameters.gravity = gravity[0]
    links = Robot(link_side(robot.model), wrench_frames=(frame,), payload_frame=frame)
    links.parameters.payload = robot.parameters.payload
    motion = taylor_motion(*rates)

    def torque_at(t):
        weights = np.array([1.0, t, 0.5 * t * t])
        links.parameters.gravity = weights @ gravity
        at_t = np.tensordot(weights, wrench, 1)
        return links.inverse_dynamics(*motion(t), wrench=at_t)
    feedforward = ElasticFeedforward(robot)
    rows = feedforward(*rates, gravity[1:], wrench)
    assert_rows(rows, robot, motion, torque_at)
    # Constant gravity without wrenches is the default.
    assert_allclose(feedforward(*rates), feedforward(*rates, np.zeros((2, 3)),
                                                     np.zeros((3, 1, 6))), rtol=1e-13)
    with pytest.raises(InputError, match='no frames for them'):
        ElasticFeedforward(Robot(robot.model))(*rates, gravity[1:], wrench)


def test_batches_are_rows_of_single_states():
    robot, _ = elastic_robot(2)
    feedforward = ElasticFeedforward(robot)
    states = np.random.default_rng(0).normal(size=(5, 9, 5))
    rows = feedforward(*states)
    assert rows.shape == (9, 7, 5)
    for k in range(9):
        assert_allclose(rows[k], feedforward(*states[:, k]), rtol=1e-10, atol=1e-10)


def test_bases_with_a_quaternion_carry_elastic_arms():
    b = ModelBuilder()
    b.body('base', 'world',
           'free', inertial=Inertial(5.0, (0.1, 0, 0), np.diag([1, 2, 2.5])))
    b.body('arm', 'base', axis=(0, 1, 0), inertial=rod(2, (0, 0, 0), (0.1, 0.2, 0.8)),
           drive=Drive(500.0, rotor_inertia=0.1))
    robot = Robot(b.model())
    links = Robot(link_side(robot.model))
    rng = np.random.default_rng(1)
    rates = rng.normal(size=(4, links.n))
    q0 = np.array([0.1, 0.2, 0.3, 0.5, -0.1, 0.7, 0.5, 0.4])
    q0[3:7] /= np.linalg.norm(q0[3:7])
    rows = ElasticFeedforward(robot)(q0, *rates)

    def rates_at(t):
        return taylor_motion(*rates)(t)[:2]

    def torque_at(t):
        # q' = G(q) u, by many short Runge-Kutta steps.
        q = q0.copy()
        steps = 12
        h = t / steps
        for k in range(steps):
            def slope(s, x):
                return links.joint_rates(x, rates_at(s)[0])
            s = k * h
            a = slope(s, q)
            b = slope(s + h / 2, q + h / 2 * a)
            c = slope(s + h / 2, q + h / 2 * b)
            d = slope(s + h, q + h * c)
            q = q + h / 6 * (a + 2 * b + 2 * c + d)
        u, udot = rates_at(t)
        return links.inverse_dynamics(q, u, udot)
    expected = time_derivatives(torque_at, 2, window=0.05)
    for order in range(3):
        assert_allclose(rows[order], expected[order], rtol=0,
                        atol=1e-7 * np.abs(expected[order]).max())


def test_spongs_single_link_arm_in_closed_form():
    """
    I q'' + M g L sin q + k (q - theta) = 0, J theta'' + k (theta - q) = u.

    M. W. Spong, Modeling and control of elastic joint robots, 1987, with the numbers of
    the textbook example: M g L = 10, k = 100, I = J = 1.
    """
    b = ModelBuilder(gravity=(0, 0, -10.0))
    b.body('link', axis=(0, -1, 0), inertial=point_mass(1.0, (0, 0, -1.0)),
           drive=Drive(100.0, rotor_inertia=1.0))
    q = 0.4
    u = -0.3
    a = 0.8
    j = 1.1
    s = -2.0
    rows = ElasticFeedforward(Robot(b.model()))([q], [u], [a], [j], [s])[:, 0]
    sine = math.sin(q)
    cosine = math.cos(q)
    gear = a + 10.0 * sine
    gear_rate = j + 10.0 * cosine * u
    gear_acceleration = s + 10.0 * (cosine * a - sine * u * u)
    acceleration = a + gear_acceleration / 100.0
    assert_allclose(rows, [gear, gear_rate, gear_acceleration, q + gear / 100.0,
                           u + gear_rate / 100.0, acceleration, acceleration + gear],
                    rtol=1e-14)


def test_two_masses_on_a_spring():
    """With m q'' = k (theta - q), a sine of q takes both masses' torque."""
    m = 3.0
    B = 0.5
    k = 200.0
    w = 7.0
    t = 0.3
    b = ModelBuilder(gravity=(0, 0, 0))
    b.body('mass', 'world', 'prismatic', axis=(1, 0, 0), inertial=point_mass(m),
           drive=Drive(k, rotor_inertia=B))
    phases = [math.sin(w * t + 0.5 * math.pi * order) * w**order for order in range(5)]
    rows = ElasticFeedforward(Robot(b.model()))(*[[x] for x in phases])[:, 0]
    amplification = 1.0 - m * w * w / k
    assert rows[3] == pytest.approx(amplification * phases[0], rel=1e-14)
    assert rows[6] == pytest.approx((m + B * amplification) * phases[2], rel=1e-13)


def refused(**drive):
    """Return an elastic robot of one joint."""
    b = ModelBuilder()
    stiffness = drive.pop('stiffness', 100.0)
    b.body('link', axis=(0, 1, 0), inertial=rod(1, (0, 0, 0), (1, 0, 0)),
           drive=Drive(stiffness, rotor_inertia=1.0, **drive))
    return Robot(b.model())


@pytest.mark.parametrize('drive, message', [
    ({'full_coupling': True}, 'more than four derivatives'),
    ({'stiffness': StiffnessCurve([0.1, 0.2], [0.0, 1.0])}, 'a dead zone of 0.1'),
])
def test_motors_that_do_not_follow_from_four_derivatives_are_refused(drive, message):
    with pytest.raises(InputError, match=message):
        ElasticFeedforward(refused(**drive))


def test_other_robots_are_refused():
    model = random_model(0, 2)
    with pytest.raises(InputError, match='without drives'):
        ElasticFeedforward(Robot(model))


def smooth_motion(n, duration=1.0):
    """Return a motion of n joints from rest to rest."""
    points = np.random.default_rng(4).normal(size=(4, n))
    return SmoothMotion.from_points(np.linspace(0.0, duration, 4), points,
                                    joint_names=[f'j{k}' for k in range(n)])


def two_links(**drive):
    """Return an elastic arm of two joints, j0 and j1."""
    b = ModelBuilder()
    for k, on in enumerate(('world', 'l0')):
        b.body(
            f'l{k}', on, joint=f'j{k}', axis=(0, 1, 0), at=(1.0 * k, 0, 0),
            inertial=rod(1, (0, 0, 0), (1, 0, 0)),
            drive=Drive(**{'stiffness': 400.0, 'rotor_inertia': 0.3, 'friction': SMOOTH,
                           **drive}))
    return Robot(b.model())


def test_along_a_motion_without_damping_each_row_is_a_call():
    robot = two_links()
    motion = smooth_motion(2)
    feedforward = ElasticFeedforward(robot)
    result = feedforward.along(motion, 0.01)
    assert result.time.shape == (101,) and result.motor_torque.shape == (101, 2)
    rows = np.stack(result[2:], axis=1)
    assert_allclose(rows, feedforward(*motion.sample(result.time)),
                    rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize('law', [
    SMOOTH, SMOOTH | {'load_friction': 0.2, 'load_friction_backdriven': 0.3}],
                         ids=['plain', 'load friction'])
@pytest.mark.parametrize('stiffness',
                         [400.0, StiffnessCurve([0.02, 0.05], [6.0, 40.0], 0.03)])
def test_damped_deflections_satisfy_the_equations_of_the_elastic_robot(stiffness, law):
    """Also D delta' = tau_J - k(delta): the links' equations, no torque on links."""
    robot = two_links(stiffness=stiffness, damping=3.0, friction=law)
    motion = smooth_motion(2)
    step = 2.5e-4
    result = ElasticFeedforward(robot).along(motion, step)
    state = motion.sample(result.time)
    q = np.hstack([state.q, result.motor_position])
    u = np.hstack([state.u, result.motor_speed])
    udot = np.hstack([state.udot, result.motor_acceleration])
    tau = robot.inverse_dynamics(q, u, udot)
    size = np.abs(result.motor_torque).max()
    assert_allclose(tau[:, :2], 0.0, atol=1e-11 * size)
    assert_allclose(tau[:, 2:], result.motor_torque, rtol=0, atol=1e-11 * size)
    # The speed is the derivative of the position: Simpson's rule over every two steps.
    for position, speed in ((result.motor_position, result.motor_speed),
                            (result.motor_speed, result.motor_acceleration)):
        change = (speed[:-2:2] + 4 * speed[1:-1:2] + speed[2::2]) * step / 3
        assert_allclose(position[2::2] - position[:-2:2], change,
                        atol=1e-6 * np.abs(speed).max())


@pytest.mark.parametrize('integrator', ['rk4', 'implicit'])
def test_a_damped_drive_with_load_friction_moves_by_its_equations_written_by_hand(
        integrator):
    # A wheel of 1.5 kg m^2 behind a drive; the teeth carry spring, damping and rotor.
    B, k, D, inertia = 0.3, 90.0, 6.0, 1.5
    mu_driving, mu_backdriven, coulomb, speed = 0.2, 0.35, 0.4, 0.2
    b = ModelBuilder('wheel')
    b.body('wheel', axis=(0, 0, 1),
           inertial=Inertial(0.0, (0, 0, 0), np.eye(3) * inertia),
           drive=Drive(k, rotor_inertia=B, damping=D, friction={
               'friction': coulomb, 'friction_speed': speed, 'load_friction': mu_driving,
               'load_friction_backdriven': mu_backdriven}))
    robot = Robot(b.model())

    motor_torque = 4.0
    start = [0.2, 0.1, -2.0, -1.0]  # against the motor, so that the load drives it

    def rates(_, state):
        q, theta, u, rate = state
        gear = k * (theta - q) + D * (rate - u)
        y = np.tanh(rate / speed)
        mean = 0.5 * (mu_driving + mu_backdriven)
        half = 0.5 * (mu_driving - mu_backdriven)
        # torque = L + coulomb y + mean |L| y + half L y^2: linear for each sign of L.
        x = motor_torque - coulomb * y
        load = x / (1.0 + half * y * y + np.sign(x) * mean * y)
        return [u, rate, gear / inertia, (load - gear) / B]

    expected = solve_ivp(rates, (0.0, 1.0), start, rtol=1e-10, atol=1e-12).y[:, -1]
    run = simulate(robot, start[:2], start[2:], 1.0, step=5e-4,
                   torque=[0.0, motor_torque], integrator=integrator)
    end = np.concatenate([run.q[-1], run.u[-1]])
    assert np.abs(expected).min() > 0.01
    assert_allclose(end, expected, atol=2e-4 if integrator == 'implicit' else 2e-6)


def test_the_integration_of_the_deflection_is_of_order_five():
    robot = two_links(damping=30.0)
    motion = smooth_motion(2)
    feedforward = ElasticFeedforward(robot)
    ends = []
    for k in range(7):
        ends.append(feedforward.along(motion, 0.1 / 2**k,
                                      deflection=[0.05, -0.02]).motor_position)
    middles = np.array([end[len(end) // 2] for end in ends])
    errors = np.abs(middles[:-1] - middles[-1]).max(axis=1)
    orders = np.log2(errors[1:4] / errors[2:5])
    assert orders.min() > 4.5
    # Stiff: the time constant D / k is a thousandth of the step.
    stiff = ElasticFeedforward(two_links(stiffness=4e5, damping=4.0))
    result = stiff.along(motion, 0.01, deflection=[0.1, 0.1])
    deflection = result.motor_position - result.link_position
    lagging = result.gear_torque - 4.0 / 4e5 * result.gear_torque_rate
    assert_allclose(deflection[6:], lagging[6:] / 4e5, rtol=0,
                    atol=1e-6 * np.abs(lagging).max() / 4e5)


@pytest.mark.parametrize('settling', [1e-12, 1e-9, 1e-6, 1.1e-6, 1e-5])
def test_motors_of_drives_with_little_damping_are_those_of_springs_but_for_the_lag(
        settling):
    motion = smooth_motion(2)
    stiffness = 400.0
    undamped = ElasticFeedforward(two_links(stiffness=stiffness)).along(motion, 0.01)
    drives = two_links(stiffness=stiffness, damping=settling * stiffness)
    damped = ElasticFeedforward(drives).along(motion, 0.01)
    # The lag D / k is far shorter than the motion, of 1 s and the fourth derivative.
    for name in ('motor_position', 'motor_speed', 'motor_acceleration', 'motor_torque'):
        expected = getattr(undamped, name)
        size = np.abs(expected).max()
        assert_allclose(getattr(damped, name), expected, rtol=0,
                        atol=(1e-6 + 100.0 * settling) * size, err_msg=name)


@pytest.mark.parametrize('damping', [0.0, 2.0])
def test_the_joints_of_a_motion_may_have_any_order(damping):
    feedforward = ElasticFeedforward(two_links(damping=damping))
    motion = smooth_motion(2)
    times = np.linspace(0.0, 1.0, 4)
    points = motion.sample(times)[0]
    reversed_motion = SmoothMotion.from_points(times, points[:, ::-1],
                                               joint_names=['j1', 'j0'])
    expected = feedforward.along(motion, 0.01)
    result = feedforward.along(reversed_motion, 0.01)
    # The columns of the result are those of `joint_names`, whatever the motion's order.
    for name, values in expected._asdict().items():
        size = np.abs(values).max()
        assert_allclose(getattr(result, name), values, rtol=0, atol=1e-9 * size,
                        err_msg=name)


def test_along_refuses_jumps_other_joints_and_steps():
    feedforward = ElasticFeedforward(two_links(damping=2.0))
    spline = Motion.from_points([0.0, 1.0], np.eye(2), joint_names=['j0', 'j1'])
    with pytest.raises(InputError, match='jumps by'):
        feedforward.along(spline, 0.01)
    with pytest.raises(InputError, match='expected 2 of j0, j1'):
        feedforward.along(smooth_motion(1), 0.01)
    for step in (0.0, -1.0, 2.0, float('nan')):
        with pytest.raises(InputError, match='step'):
            feedforward.along(smooth_motion(2), step)
    with pytest.raises(InputError, match='deflection'):
        feedforward.along(smooth_motion(2), 0.01, deflection=[1.0])
    with pytest.raises(InputError, match='deflection is a state of its own'):
        feedforward([0, 0], [0, 0], [0, 0], [0, 0], [0, 0])
