"""Inverse dynamics of elastic joints to 4th order, in loops, with chosen speeds."""

import copy
from dataclasses import replace
import math
import pickle

from differentiated import taylor_motion, time_derivatives
from kane_dynamics import (absolute_rates, ConstraintError, DependentSpeeds, Drive,
                           ElasticFeedforward, Inertial, InputError, knife_edge,
                           ModelBuilder, momenta, Prescribed, Robot, rod,
                           SmoothMotion, Speeds, StiffnessCurve, with_drives)
from kane_dynamics.feasibility import demand, fastest, time_optimal
from kane_dynamics.model.elastic_model import link_side
from linkages import four_bar_model, PIN
import numpy as np
from numpy.testing import assert_allclose
import pytest

SMOOTH = {'damping': 0.7, 'friction': 1.2, 'friction_speed': 2.0, 'friction_offset': 0.1}
CURVE = StiffnessCurve([0.01, 0.03], [6.0, 40.0], rounding=0.01)
TABLE_AND_CRANK = {'table': Drive(900.0, rotor_inertia=0.3, friction=SMOOTH),
                   'crank': Drive(CURVE, rotor_inertia=0.2)}


def slow(*values):
    """Return a parameter of a test that takes long."""
    return pytest.param(*values, marks=pytest.mark.slow)


def turning_four_bar(drives=TABLE_AND_CRANK, **options):
    """Return a four-bar on a turntable with elastic drives, and the rigid one."""
    model = four_bar_model(turntable=True)
    bodies = []
    for body in model.bodies:  # friction that changes slowly, for the reference
        law = {'damping': 0.2, 'friction': 0.4, 'friction_speed': 2.0}
        bodies.append(replace(body, joint=replace(body.joint, **law)))
    model = replace(model, bodies=tuple(bodies))
    elastic = Robot(with_drives(model, drives), constraints=[PIN], **options)
    return elastic, Robot(model, constraints=[PIN], independent=('table', 'crank'),
                          actuated=tuple(drives))


def closed_motion(rigid, q, rates):
    """Return a function of time: q, u, udot of a loop with polynomial speeds."""
    names = rigid.speed_names
    places = [rigid.coordinate_names.index(name) for name in names]
    motion = taylor_motion(q[places], *rates)

    def at(t):
        position, u, udot = motion(t)
        near = q.copy()
        near[places] = position
        closed = rigid.closed_configuration(near, fixed=names)
        # One more step of Newton's method, to rounding.
        return rigid.equations.closure_step(closed).astype(float), u, udot
    return at


def assert_equations(robot, rows, q, speeds, tolerance=1e-10):
    """
    Check that links and motors satisfy the equations of the elastic robot.

    `speeds` are u and udot of the links, in the order of the robot's independent speeds.
    """
    names = [robot.speed_names.index(elastic.drive.motor) for elastic in robot.drives]
    links = [k for k in range(robot.n) if k not in names]
    joints = list(link_side(robot.model).joint_names)
    column = [joints.index(elastic.name) for elastic in robot.drives]
    coordinates = np.zeros(robot.n_q)
    u, udot = np.zeros((2, robot.n))
    coordinates[:len(q)] = q
    for k, elastic in zip(column, robot.drives):
        coordinates[elastic.motor] = rows[3, k]
    u[links], udot[links] = speeds
    u[names] = rows[4, column]
    udot[names] = rows[5, column]
    tau = robot.inverse_dynamics(coordinates, u, udot)
    size = np.abs(rows[[0, 6]]).max()
    assert_allclose(tau[names], rows[6, column], rtol=0, atol=tolerance * size)
    assert_allclose(tau[links], 0.0, rtol=0, atol=tolerance * size)


@pytest.mark.parametrize('seed', [0, slow(1)])
def test_gears_of_a_loop_have_the_differentiated_torques_of_the_rigid_one(seed):
    robot, rigid = turning_four_bar()
    feedforward = ElasticFeedforward(robot)
    assert feedforward.speed_names == rigid.speed_names
    q = rigid.closed_configuration([0.3, 0.9 + seed, 0.0, -1.5], fixed=rigid.speed_names)
    rates = np.random.default_rng(seed).normal(size=(4, 2))
    rows = feedforward(q, *rates)
    motion = closed_motion(rigid, q, rates)

    def torque_at(t):
        q, u, udot = motion(t)
        return rigid.joint_torques(rigid.inverse_dynamics(q, u, udot), q=q)
    expected = time_derivatives(torque_at, 2, window=0.2)
    for order in range(3):
        assert_allclose(rows[order, :2], expected[order][:2], rtol=0,
                        atol=1e-8 * np.abs(expected[order]).max())
    assert_allclose(rows[[0, 1, 2, 6], 2:], 0.0)
    assert_equations(robot, rows, q, rates[:2])

    # Joints without motors move as in the loop.
    def links_at(t):
        return motion(t)[0]
    expected = time_derivatives(links_at, 2, window=0.2)
    assert_allclose(rows[3:6, 2:], expected[:, 2:], rtol=0, atol=1e-8)


@pytest.mark.parametrize('positions', [(-3.0, -2.0), (3.0, 4.5)])
def test_a_motion_of_a_loop_may_begin_far_from_zero(positions):
    model = with_drives(four_bar_model(), {'crank': Drive(700.0, rotor_inertia=0.1)})
    robot = Robot(model, constraints=[PIN])
    feedforward = ElasticFeedforward(robot, actuated=['crank'])
    motion = SmoothMotion.from_points([0.0, 1.0], np.transpose([positions]),
                                      joint_names=['crank'])
    links = feedforward.along(motion, 0.05).link_position
    assert_allclose(links[[0, -1], 0], positions, rtol=0, atol=1e-9)
    # The crank turns there in the assembly mode of the configuration near zero.
    rigid = Robot(four_bar_model(), constraints=[PIN], independent=('crank',))
    q = rigid.neutral()
    for crank in np.linspace(q[0], positions[0], 400):
        q = rigid.closed_configuration([crank, *q[1:]], fixed=('crank',))
    assert_allclose(links[0], q, rtol=0, atol=1e-8)


@pytest.mark.parametrize('weights',
                         [slow(('crank', 'rocker')), {'crank': 1.0, 'rocker': 4.0}])
def test_redundant_drives_share_the_load_as_rigid_ones(weights):
    drives = {'crank': Drive(700.0, rotor_inertia=0.1),
              'rocker': Drive(500.0, rotor_inertia=0.2)}
    model = four_bar_model()
    robot = Robot(with_drives(model, drives), constraints=[PIN])
    rigid = Robot(model, constraints=[PIN], independent=('crank',), actuated=weights)
    feedforward = ElasticFeedforward(robot, actuated=weights)
    q = rigid.closed_configuration([1.2, 0.0, -1.5], fixed=('crank',))
    # The robot may have chosen another independent speed.
    T = rigid.joint_rates(q, [1.0])
    scale = T[model.joint_names.index(feedforward.speed_names[0])]
    rows = feedforward(q, *np.outer([scale, 0.0, 0.0, 0.0], [0.6]))
    u = np.array([0.6])
    udot = [(0.0 - rigid.joint_accelerations(q, u, [0.0])[
        model.joint_names.index(feedforward.speed_names[0])]) / scale]
    torques = rigid.joint_torques(rigid.inverse_dynamics(q, u, udot), q=q)
    assert_allclose(rows[0, [0, 2]], torques[[0, 2]], rtol=1e-9, atol=1e-9)


def chosen(q, t):
    """Return Y of speeds that depend on configuration and time, for three links."""
    a = 1.0 + 0.3 * np.sin(q[1])
    b = 0.2 * np.cos(q[0]) + 0.1 * t
    Y = np.array([[a, b, 0.0], [0.0, 1.0, 0.2], [0.1, 0.0, 1.5 + 0.0 * t]])
    full = np.eye(len(q)).astype(object)
    full[:3, :3] = Y
    return full


@pytest.mark.parametrize('speeds', [slow(absolute_rates), slow(momenta), Speeds(chosen)])
def test_trees_with_chosen_speeds_have_the_torques_of_joint_rates(speeds):
    b = ModelBuilder()
    for k, on in enumerate(('world', 'l0', 'l1')):
        b.body(f'l{k}', on, joint=f'j{k}', axis=(0, 1, 0) if k else (0, 0, 1),
               at=(0.5 * k, 0, 0), inertial=rod(2.0, (0, 0, 0), (0.5, 0.1, 0)),
               **({'drive': Drive(400.0, rotor_inertia=0.3)} if k else {}))
    robot = Robot(b.model(), speeds=speeds)
    in_joint_rates = ElasticFeedforward(Robot(robot.model))
    feedforward = ElasticFeedforward(robot)
    rates = np.random.default_rng(0).normal(size=(5, 3))
    motion = taylor_motion(*rates)

    def speeds_at(t):
        q, qdot, _ = motion(t)
        full_q = np.concatenate([q, [0, 0]])
        full_rate = np.concatenate([qdot, [0, 0]])
        Y, Z = robot.mechanism.speeds.of(full_q, t)
        return (np.asarray(Y, dtype=float) @ full_rate + Z)[:3]
    u = time_derivatives(speeds_at, 3, window=0.1)
    rows = feedforward(rates[0], *u)
    expected = in_joint_rates(*rates)
    sizes = np.abs(expected).max(axis=1, keepdims=True)
    assert_allclose(rows / sizes, expected / sizes, rtol=0, atol=1e-8)
    # A motion is that of the joints, whatever the speeds.
    lift = SmoothMotion.from_points([0.0, 0.5, 1.0],
                                    np.random.default_rng(1).normal(size=(3, 3)),
                                    joint_names=['j0', 'j1', 'j2'])
    for row, same in zip(feedforward.along(lift, 0.1), in_joint_rates.along(lift, 0.1)):
        assert_allclose(row, same, rtol=1e-12, atol=1e-12)


def test_a_rolling_base_with_an_elastic_arm():
    b = ModelBuilder()
    b.body('base', kind='planar',
           inertial=Inertial(9.0, (0.1, 0, 0), np.diag([1, 1, 1.4])))
    b.body('arm', 'base', axis=(0, 0, 1), at=(0.2, 0, 0),
           inertial=rod(2.0, (0, 0, 0), (0.8, 0, 0)),
           drive=Drive(300.0, rotor_inertia=0.2))
    edge = knife_edge('base', (0, 1, 0))
    robot = Robot(b.model(), constraints=[edge])
    model = link_side(robot.model)
    feedforward = ElasticFeedforward(robot, actuated=model.joint_names)
    rigid = Robot(model, constraints=[edge], independent=feedforward.speed_names,
                  actuated=model.joint_names)
    rng = np.random.default_rng(2)
    q0 = rng.normal(size=4)
    rates = rng.normal(size=(4, 3))
    rows = feedforward(q0, *rates)
    speeds = taylor_motion(*rates)

    def torque_at(t):
        # q' = T(q) u has no integral: by many Runge-Kutta steps.
        q = q0.copy()
        steps = 20
        h = t / steps
        for k in range(steps):
            s = k * h
            k1 = rigid.joint_rates(q, speeds(s)[0])
            k2 = rigid.joint_rates(q + h / 2 * k1, speeds(s + h / 2)[0])
            k3 = rigid.joint_rates(q + h / 2 * k2, speeds(s + h / 2)[0])
            k4 = rigid.joint_rates(q + h * k3, speeds(s + h)[0])
            q = q + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        u, udot, _ = speeds(t)
        return rigid.joint_torques(rigid.inverse_dynamics(q, u, udot), q=q)
    expected = time_derivatives(torque_at, 2, window=0.1)
    for order in range(3):
        assert_allclose(rows[order], expected[order], rtol=0,
                        atol=1e-7 * np.abs(expected[order]).max())
    motion = SmoothMotion.from_points([0.0, 1.0], np.zeros((2, 3)),
                                      joint_names=feedforward.joint_names[:3])
    with pytest.raises(InputError, match='one of velocities'):
        feedforward.along(motion, 0.1)


@pytest.mark.slow
def test_constraints_may_depend_on_time():
    robot, rigid = turning_four_bar()

    def position(t):
        return 0.3 + 0.5 * np.sin(1.3 * t)
    shaken = Prescribed('table', position)
    robot = Robot(robot.model, constraints=[PIN, shaken])
    feedforward = ElasticFeedforward(robot, actuated=['crank'])
    assert feedforward.speed_names == ('crank',)
    held = Robot(rigid.model, constraints=[PIN, shaken], independent=('crank',),
                 actuated=['crank'])
    start = 0.4
    rates = np.random.default_rng(3).normal(size=(4, 1))
    motion = taylor_motion(np.array([0.9]), *rates)

    def configuration(t):
        near = [position(t + start), motion(t)[0][0], 0.0, -1.5]
        return rigid.closed_configuration(near, fixed=('table', 'crank'))

    def torque_at(t):
        q = configuration(t)
        _, u, udot = motion(t)
        tau = held.inverse_dynamics(q, u, udot, t=t + start)
        return held.joint_torques(tau, q=q, t=t + start)
    rows = feedforward(configuration(0.0), *rates, t=start)
    expected = time_derivatives(torque_at, 2, window=0.1)
    for order in range(3):
        assert_allclose(rows[order, 1], expected[order][1], rtol=0,
                        atol=1e-8 * np.abs(expected[order]).max())


@pytest.mark.parametrize('joints, damping', [
    (('rocker', 'table'), 3.0), slow(('rocker', 'table'), 0.0),
    slow(('table', 'crank'), 0.0)])
def test_along_a_motion_loops_and_motors_satisfy_the_equations(joints, damping):
    drives = {name: replace(drive, damping=damping)
              for name, drive in TABLE_AND_CRANK.items()}
    robot, rigid = turning_four_bar(drives)
    start = rigid.closed_configuration([0.3, 0.9, 0.0, -1.5], fixed=rigid.speed_names)
    robot = Robot(robot.model, constraints=[PIN], configuration=[*start, 0.0, 0.0])
    begin = start[[rigid.joint_names.index(name) for name in joints]]
    motion = SmoothMotion.from_points([0.0, 0.5], [begin, begin + [0.3, 0.2]],
                                      joint_names=joints)
    step = 5e-4
    result = ElasticFeedforward(robot).along(motion, step)
    driven = [robot.coordinate_names.index(name) for name in joints]
    assert_allclose(result.link_position[:, driven], motion.sample(result.time).q,
                    atol=1e-12)
    # Speeds and accelerations by differences of the positions, of order four.
    whole = np.hstack([result.link_position, result.motor_position[:, :2]])
    inside = slice(2, -2)
    speed = (8 * (whole[3:-1] - whole[1:-3]) - (whole[4:] - whole[:-4])) / (12 * step)
    acceleration = (16 * (whole[3:-1] + whole[1:-3]) - (whole[4:] + whole[:-4])
                    - 30 * whole[2:-2]) / (12 * step**2)
    names = [robot.joint_names.index(name) for name in robot.speed_names]
    tau = robot.inverse_dynamics(whole[inside], speed[:, names], acceleration[:, names])
    motors = [robot.speed_names.index(elastic.drive.motor) for elastic in robot.drives]
    links = [k for k in range(robot.n) if k not in motors]
    size = np.abs(result.motor_torque).max()
    assert_allclose(tau[:, motors], result.motor_torque[inside, :2],
                    rtol=0, atol=2e-6 * size)
    assert_allclose(tau[:, links], 0.0, rtol=0, atol=2e-6 * size)


@pytest.mark.parametrize('options, arguments, message', [
    ({'constraints': [PIN, Prescribed('crank_motor', lambda t: 0.1 * t)]}, {},
     'on motors'),
    ({'constraints': [PIN]}, {'actuated': ['crank']}, 'at least 2'),
    ({'constraints': [PIN]}, {'actuated': ['crank', 'wheel']}, "actuated: 'wheel'"),
    ({'constraints': [PIN]}, {'actuated': {'crank': 1.0, 'table': -1.0}}, 'positive'),
    ({}, {'actuated': ['crank', 'table']}, 'of a tree'),
    ({'speeds': Speeds(lambda q, t: np.eye(6) + 0.5 * np.eye(6, k=4))}, {},
     'of links alone'),
])
def test_mechanisms_whose_motors_do_not_follow_are_refused(options, arguments, message):
    model = with_drives(four_bar_model(turntable=True), TABLE_AND_CRANK)
    robot = Robot(model, **options)
    with pytest.raises(InputError, match=message):
        ElasticFeedforward(robot, **arguments)


def test_open_loops_singular_states_and_other_motions_are_refused():
    robot, rigid = turning_four_bar(
        independent=('table', 'crank', 'table_motor', 'crank_motor'))
    feedforward = ElasticFeedforward(robot)
    rates = np.zeros((4, 2))
    with pytest.raises(ConstraintError, match='residual'):
        feedforward([0.0, 0.9, 0.3, -1.5], *rates)
    # With the crank along the ground, the angle between coupler and rocker is extreme.
    q = rigid.closed_configuration([0.0, 0.0, 0.0, -1.5], fixed=('table', 'crank'))
    assert np.isfinite(feedforward(q, *rates)).all()
    by_rocker = ElasticFeedforward(robot, actuated=['table', 'rocker'])
    with pytest.raises(ConstraintError, match='singular configuration of the actuation'):
        by_rocker(q, *rates)
    for joints in (('crank',), ('crank', 'wheel'), ('crank', 'coupler', 'rocker')):
        motion = SmoothMotion.from_points([0.0, 1.0], np.zeros((2, len(joints))),
                                          joint_names=joints)
        with pytest.raises(InputError, match='as many as independent speeds'):
            feedforward.along(motion, 0.1)
    out_of_reach = SmoothMotion.from_points([0.0, 1.0], [[0.0, -1.5], [0.0, 2.5]],
                                            joint_names=('table', 'rocker'))
    with pytest.raises(ConstraintError, match='near a singular configuration'):
        feedforward.along(out_of_reach, 0.1)


def test_the_demand_of_a_loop_is_that_of_its_motors_and_gears():
    drive = Drive(800.0, rotor_inertia=0.2, motor_effort=60.0, motor_velocity=4.0,
                  gear_effort=50.0)
    robot = Robot(with_drives(four_bar_model(), {'crank': drive}), constraints=[PIN])
    motion = SmoothMotion.from_points([0.0, 1.0], [[0.5], [2.0]], joint_names=['crank'])
    needed = demand(robot, motion, step=1e-2)
    rows, links = ElasticFeedforward(robot).rows_along(needed.t, motion.sample(needed.t),
                                                       ['crank'])
    assert needed.joint_names == ('crank', 'coupler', 'rocker', 'crank_motor')
    assert_allclose(needed.tau[:, 0], rows[:, 0, 0], atol=1e-9)
    assert_allclose(needed.tau[:, 3], rows[:, 6, 0], atol=1e-9)
    assert_allclose(needed.q[:, :3], links[:, 0], atol=1e-9)
    scale = fastest(robot, motion)
    assert (scale.joint, scale.limit) == ('crank_motor', 'velocity')
    uses = demand(robot, motion, speed=scale.speed).uses
    assert max(use.max() for use in uses.values()) == pytest.approx(1.0, abs=1e-3)
    with pytest.raises(InputError, match='robot: elastic joints; expected rigid ones'):
        time_optimal(robot, [[0.5], [2.0]])


def test_copies_arguments_that_no_equation_uses_and_deflections_are_checked():
    drive = Drive(800.0, rotor_inertia=0.2)
    robot = Robot(with_drives(four_bar_model(), {'crank': drive}), constraints=[PIN])
    weights = {'crank': 1.0, 'rocker': 2.0}
    feedforward = ElasticFeedforward(robot, actuated=weights)
    q = robot.closed_configuration([0.5, 0.0, -1.5,
                                    0.5], fixed=('crank', 'crank_motor'))[:3]
    rows = feedforward(q, *np.ones((4, 1)))
    for duplicate in (pickle.loads(pickle.dumps(feedforward)),
                      copy.deepcopy(feedforward)):
        assert_allclose(duplicate(q, *np.ones((4, 1))), rows, rtol=1e-13)
    for time in ('a', math.nan, [0.0, 1.0]):
        with pytest.raises(InputError, match='t: '):
            feedforward(q, *np.ones((4, 1)), t=time)
    motion = SmoothMotion.from_points([0.0, 1.0], [[0.5], [2.0]], joint_names=['crank'])
    with pytest.raises(InputError, match='deflection'):
        feedforward.along(motion, 0.1, deflection=[1.0])


def test_functions_may_be_defined_in_a_part_of_all_configurations():
    b = ModelBuilder()
    b.body('upper', axis=(0, 1, 0), inertial=rod(1.0, (0, 0, 0), (1, 0, 0)),
           drive=Drive(400.0, rotor_inertia=0.3))
    b.body('lower', 'upper', at=(1, 0, 0), axis=(0, 1, 0),
           inertial=rod(1.0, (0, 0, 0), (1, 0, 0)))
    follows = DependentSpeeds(['lower'], lambda q, t: [[np.sqrt(q[0]), 0.0]],
                              lambda q, t: [0.0])
    robot = Robot(b.model(), constraints=[follows], configuration=[0.5, 0.1, 0.5])
    rates = np.random.default_rng(0).normal(size=(4, 1))
    rows = ElasticFeedforward(robot)([0.5, 0.1], *rates)
    assert_equations(robot, rows, np.array([0.5, 0.1]), rates[:2])


def test_a_motion_has_the_same_rows_after_any_other_motion():
    # The crank turns more than once, so that the same pose has coordinates of several
    # turns.
    robot = Robot(
        with_drives(four_bar_model(), {'crank': Drive(800.0, rotor_inertia=0.2)}),
        constraints=[PIN])

    def motion(begin, end):
        return SmoothMotion.from_points([0.0, 1.0], [[begin], [end]],
                                        joint_names=['crank'])
    expected = ElasticFeedforward(robot).along(motion(6.8, 7.5), 0.1)
    used = ElasticFeedforward(robot)
    used.along(motion(-7.0, 8.0), 1e-3)
    for column, expected_column in zip(used.along(motion(6.8, 7.5), 0.1), expected):
        assert_allclose(column, expected_column, rtol=1e-9, atol=1e-9)
