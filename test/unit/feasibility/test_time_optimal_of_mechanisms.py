"""Timing of closed loops and chosen speeds against other formulations."""

from dataclasses import replace
from functools import cache, partial
import math
from runpy import run_path

from kane_dynamics import (absolute_rates, FlexibleLink, Inertial, InputError, Limits,
                           load_constraints, load_urdf, ModelBuilder, Motion, Prescribed,
                           Robot, rod, Speeds)
from kane_dynamics.feasibility import time_optimal
from kane_dynamics.feasibility.samples import NONE
from kane_dynamics.feasibility.torque_demand import demand_at
from kane_dynamics.loop_tracking.loop_error import LoopError, SINGULAR
from kane_dynamics.mechanics.definition import nonholonomic
from linkages import at_angle, four_bar_model, PIN, sleigh
import numpy as np
from palletizer import CONSTRAINTS, DRIVEN, palletizer, positions, URDF
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import linprog
from scipy.sparse import diags_array, vstack

WAYPOINTS = np.array(
    [[0.1, 0.2, -0.1, 0.3], [0.8, 0.4, -0.2, 0.6], [1.2, 0.1, 0.2, -1.0]])
# m, of the four-bar
BARS = (0.3, 0.9, 0.7)
SPAN = 1.0
CRANK = [[0.8], [2.0], [0.9]]  # rad, waypoints


@cache
def arm(friction=True, effort=1.0):
    """Return the palletizer with a payload frame and a part of its efforts."""
    robot = Robot(load_urdf(URDF), friction=friction, payload_frame='tool',
                  **load_constraints(CONSTRAINTS))
    robot.limits = replace(robot.limits, effort=effort * robot.limits.effort)
    return robot


@cache
def pinocchio_arm(payload):
    """Return Pinocchio's model of the open tree, which knows no friction."""
    pinocchio = pytest.importorskip('pinocchio')
    model = pinocchio.buildModelFromUrdf(str(URDF))
    if payload is not None:
        frame = model.frames[model.getFrameId('tool')]
        model.appendBodyToJoint(frame.parentJoint, pinocchio.Inertia(
            payload, np.zeros(3), np.zeros((3, 3))), frame.placement)
    return pinocchio, model, model.createData()


def motor_torques(robot, driving, payload=None):
    """Return q' and motor torques of rows: parallelograms and virtual work."""
    pinocchio, model, data = pinocchio_arm(payload)
    names = list(model.names)[1:]
    zero = positions(robot, *np.zeros(4))
    T = np.array([positions(robot, *unit) - zero for unit in np.eye(4)]).T
    order = [robot.joint_names.index(name) for name in names]
    q, u, udot = (rows @ T.T for rows in driving)
    tau = np.zeros_like(q)
    tau[:, order] = [pinocchio.rnea(model, data, *row) for row in zip(
        *(rows[:, order] for rows in (q, u, udot)))]
    for body in robot.model.bodies:
        joint = body.joint
        k = body.joint.coordinate
        tau[:, k] += joint.armature * udot[:, k]
        if robot.friction:
            tau[:, k] += joint.damping * u[:, k] + joint.friction_offset + (
                joint.friction * np.tanh(u[:, k] / joint.friction_speed))
    return u, tau @ T


def limits_of(robot, what):
    return getattr(robot.limits, what)[[robot.joint_names.index(name)
                                        for name in DRIVEN]]


def spline(rows):
    """Return a motion along waypoints of the motors."""
    return Motion.from_points(np.arange(float(len(rows))), rows, joint_names=DRIVEN)


def test_frictionless_duration_of_the_palletizer_is_that_of_a_linear_program():
    """The fastest profile has the largest sum of x that the limits allow."""
    robot = arm(friction=False, effort=0.8)
    path = Motion.from_points([0.0, 0.5, 1.0], WAYPOINTS,
                              [[1.0, 0.3, -0.2, 0.5],
                               [1.1, -0.1, 0.2, -1.2], [0.6, -0.5, 0.5, -2.0]],
                              joint_names=DRIVEN)
    count = 2000
    h = 1.0 / count
    s = (np.arange(count) + 0.5) / count
    q, first, second = path.sample(s)
    _, gravity_torque = motor_torques(robot, (q, 0.0 * q, 0.0 * q))
    _, inertia = motor_torques(robot, (q, 0.0 * q, first))
    rates, square = motor_torques(robot, (q, first, second))
    a = inertia - gravity_torque
    b = square - gravity_torque
    effort = limits_of(robot, 'effort')
    rows = vstack([diags_array([half - change, half + change], offsets=[0, 1],
                               shape=(count, count + 1))
                   for half, change in zip(0.5 * b.T, a.T / (2.0 * h))])
    bounds = np.concatenate(
        [(effort - gravity_torque).T.ravel(), (effort + gravity_torque).T.ravel()])
    limit = ((robot.limits.velocity / np.maximum(np.abs(rates), 1e-12)).min(axis=1))**2
    middle = diags_array([0.5, 0.5], offsets=[0, 1], shape=(count, count + 1))
    solution = linprog(-np.ones(count + 1), vstack([rows, -rows, middle]).tocsc(),
                       np.concatenate([bounds, limit]),
                       bounds=[(0.0, 0.0), *[(0.0, None)] * (count - 1), (0.0, 0.0)],
                       method='highs')
    root = np.sqrt(solution.x)
    expected = (2.0 * h / (root[1:] + root[:-1])).sum()
    assert time_optimal(robot, path).duration == pytest.approx(expected, rel=1e-3)


@cache
def linkage(friction=1.5, shared=False, **limits):
    """Return the four-bar with friction everywhere; crank, or rocker too, driven."""
    model = four_bar_model(bars=BARS, span=SPAN)
    arguments = {'effort': 14.0, 'velocity': 30.0, **limits}
    rows = []
    for body in model.bodies:
        rows.append(
            replace(body, joint=replace(body.joint, friction=friction, damping=0.2
                                        * (friction > 0.0), limits=Limits(**arguments))))
    bodies = tuple(rows)
    return Robot(replace(model, bodies=bodies), constraints=[PIN], independent=['crank'],
                 actuated={'crank': 1.0, 'rocker': 3.0} if shared else None,
                 configuration=at_angle(0.8))


def four_bar_angles(crank):
    """Return joint angles, (K, 3), by the intersection of two circles, coupler above."""
    tip = BARS[0] * np.stack([np.cos(crank), np.sin(crank)], axis=-1)
    across = np.array([SPAN, 0.0]) - tip
    distance = np.linalg.norm(across, axis=-1)
    along = (distance**2 + BARS[1]**2 - BARS[2]**2) / (2.0 * distance)
    coupler = np.arctan2(across[..., 1], across[..., 0]) + np.arccos(along / BARS[1])
    pin = tip + BARS[1] * np.stack([np.cos(coupler), np.sin(coupler)], axis=-1)
    rocker = np.arctan2(-pin[..., 1], SPAN - pin[..., 0])
    return np.stack([crank, coupler - crank, rocker - coupler], axis=-1)


def four_bar_torques(robot, crank, rate, change):
    """Return q' and the crank's torque: circles, slopes, virtual work in a tree."""
    h = 1e-4
    low, q, high = (np.unwrap(four_bar_angles(crank + x), axis=0) for x in (-h, 0.0, h))
    T = (high - low) / (2 * h)
    bend = (high - 2 * q + low) / h**2
    u = T * rate[:, None]
    tree = open_tree(robot.model, robot.friction)
    tau = tree.inverse_dynamics(q, u, T * change[:, None] + bend * rate[:, None]**2)
    return u, (tau * T).sum(axis=1)


@cache
def open_tree(model, friction):
    return Robot(model, friction=friction)


def least_duration(robot, begin, end):
    """
    Return the least duration of a turn of the crank, by integrating its equation.

    The one motor accelerates by all its torque, and then brakes by all of it, if no
    other limit is reached (Bobrow, Dubowsky and Gibson, Int. J. Robotics Research 4
    (1985)).
    """
    effort = robot.limits.effort[0]
    velocity = robot.limits.velocity

    def rates(sign, t, state):
        """Return the rates of angle and speed at full torque; sign -1 backwards."""
        q = state[:1]
        u = sign * state[1:]
        ones = np.ones(1)
        held = four_bar_torques(robot, q, u, 0.0 * ones)[1]
        inertia = four_bar_torques(robot, q, u, ones)[1] - held
        return [state[1], float(((sign * effort - held) / inertia)[0])]

    def curve(start, sign):
        """Return angles and speeds from rest until the motion passes the turn."""
        def passed(t, state):
            return abs(state[0] - start) - abs(end - begin)
        passed.terminal = True
        solution = solve_ivp(partial(rates, sign), (0.0, 10.0), [start, 0.0],
                             rtol=1e-8, atol=1e-9, events=passed, max_step=2e-3)
        return solution.y
    forward, backward = curve(begin, 1.0), curve(end, -1.0)
    # In x the speed is about linear at both ends, and its square is about linear in the
    # angle.
    x = np.linspace(0.0, np.pi / 2, 20_001)
    angles = begin + (end - begin) * np.sin(x)**2
    square = np.minimum(np.interp(angles, forward[0], forward[1]**2),
                        np.interp(angles, backward[0, ::-1], backward[1, ::-1]**2))
    u, _ = four_bar_torques(robot, angles, np.ones_like(angles), 0.0 * angles)
    speeds = np.sqrt(np.minimum(square, ((velocity / np.abs(u)).min(axis=1))**2))
    return (2.0 * np.diff(angles) / (speeds[1:] + speeds[:-1])).sum()


@pytest.mark.parametrize('friction, velocity', [(1.5, 30.0), (1.5, 5.0), *(
    pytest.param(0.0, velocity, marks=pytest.mark.slow) for velocity in (30.0, 5.0))])
def test_duration_of_a_four_bar_is_that_of_full_torque_there_and_full_torque_back(
        friction, velocity):
    robot = linkage(friction, velocity=velocity)
    timing = time_optimal(robot, [[0.8], [2.0]])
    assert timing.duration == pytest.approx(least_duration(robot, 0.8, 2.0), rel=1e-3)
    if velocity == 30.0:
        assert (timing.uses['effort'].max(axis=1) > 0.99).mean() > 0.99


def places_between(times, resolution):
    """Return times at a multiple of the resolution of the points of a motion."""
    fraction = np.arange(resolution) / resolution
    return (times[:-1, None] + fraction * np.diff(times)[:, None]).ravel()


@pytest.mark.parametrize(('payload', 'power', 'resolution'), [
    (None, math.inf, 20), pytest.param(80.0, 6000.0, 20, marks=pytest.mark.slow)])
def test_no_limit_of_the_palletizer_is_exceeded_by_a_thousandth_between_points(
        payload, power, resolution):
    """Friction included; torques by Pinocchio and virtual work in parallelograms."""
    robot = arm()
    robot.parameters.payload = payload and Inertial(payload, np.zeros(3),
                                                    np.zeros((3, 3)))
    timing = time_optimal(robot, WAYPOINTS, power=power)
    assert timing.motion.joint_names == DRIVEN
    u, tau = motor_torques(robot, timing.motion.sample(places_between(
        timing.motion.times, resolution)), payload)
    motors = [robot.joint_names.index(name) for name in DRIVEN]
    uses = [np.abs(tau / limits_of(robot, 'effort')), np.abs(u / robot.limits.velocity),
            np.abs(tau * u[:, motors] / power)]
    assert max(float(use.max()) for use in uses) <= 1.001
    busy = np.max([use.max(axis=1) for use in uses], axis=0)
    assert np.median(busy) == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize('velocity', [30.0, 4.0])
def test_no_limit_of_a_four_bar_is_exceeded_by_a_thousandth_between_points(velocity):
    """Closure by circles, torques by virtual work in the open tree with friction."""
    robot = linkage(velocity=velocity)
    timing = time_optimal(robot, CRANK, acceleration=60.0)
    q, u, udot = (rows[:, 0] for rows in timing.motion.sample(places_between(
        timing.motion.times, 100)))
    rates, tau = four_bar_torques(robot, q, u, udot)
    assert np.abs(tau).max() <= 1.001 * 14.0
    assert np.abs(rates).max() <= 1.001 * velocity
    accelerations = np.abs(
        np.diff(rates[::10], axis=0)
        / np.diff(places_between(timing.motion.times, 100)[::10])[:, None])
    inside = np.abs(np.diff(u[::10])) < 0.1  # not across the reversal in the middle
    assert accelerations[inside].max() <= 60.0 * 1.002


def test_points_and_uses_are_of_all_joints_as_in_the_demand_of_the_motion():
    robot = linkage(shared=True)
    timing = time_optimal(robot, CRANK, power=40.0)
    needed = demand_at(robot, timing.motion, 1.0, 1e-3, 40.0, NONE)
    assert timing.joint_names == needed.joint_names == ('crank', 'coupler', 'rocker')
    assert not timing.tau[:, 1].any() and timing.tau[:, [0, 2]].any(axis=0).all()
    for t, q, u, _, tau in list(zip(*timing.points, timing.tau))[5::97]:
        k = int(np.abs(needed.t - t).argmin())
        assert needed.t[k] == pytest.approx(t, abs=1e-9)
        assert needed.q[k] == pytest.approx(q, abs=1e-9)
        assert needed.u[k] == pytest.approx(u, abs=1e-7)
        assert needed.tau[k] == pytest.approx(tau, abs=1e-5)
    assert set(timing.uses) == {'effort', 'velocity', 'power'}
    assert {active.joint for active in timing.active} <= {'crank', 'rocker'}
    uses = timing.demand.uses
    assert uses['effort'].max() <= 1.001 and uses['power'].max() <= 1.001


def test_joints_without_actuators_need_no_power():
    robot = linkage()
    limit = [60.0, 0.0, 0.0]
    timing = time_optimal(robot, CRANK, power=limit)
    expected = time_optimal(robot, CRANK, power=[60.0, math.inf, math.inf])
    assert timing.duration == expected.duration < 1.2 * time_optimal(
        robot, CRANK).duration
    assert timing.uses['power'].max() <= 1.001


def test_torques_shared_by_two_motors_are_those_of_the_definition():
    robot = linkage(shared=True)
    timing = time_optimal(robot, CRANK)
    for q, u, udot, tau in list(zip(*timing.points[1:], timing.tau))[5::101]:
        expected = nonholonomic.inverse_dynamics(robot.mechanism, q, u[:1], udot[:1])
        T = u / u[0]
        assert T @ tau == pytest.approx(expected[0], rel=1e-7, abs=1e-7)
        assert tau[2] / T[2] == pytest.approx(tau[0] / (3.0 * T[0]), rel=1e-6, abs=1e-8)


@cache
def two_links():
    builder = ModelBuilder('two links')
    for k, on in enumerate(('world', 'rod0')):
        builder.body(f'rod{k}', on, axis=(0.0, 1.0, 0.0), at=(0.0, 0.0, -float(k)),
                     inertial=rod(1.0, (0.0, 0.0, 0.0), (0.0, 0.0, -1.0)),
                     joint=f'joint{k}', damping=2.0, friction=3.0, friction_speed=0.1,
                     limits=Limits(effort=(40.0, 18.0)[k], velocity=4.0))
    return builder.model()


@pytest.mark.parametrize('given', [{}, {'power': 60.0}, {'acceleration': 20.0},
                                   {'start_speed': 0.3, 'end_speed': 0.2}])
def test_tree_with_chosen_speeds_has_the_timing_of_the_tree(given):
    path = [[0.0, 0.3], [0.7, 1.2], [1.6, 0.4], [0.2, 0.1]]
    tree = Robot(two_links())
    chosen = Robot(two_links(), speeds=absolute_rates)
    expected = time_optimal(tree, path, **given)
    timing = time_optimal(chosen, path, **given)
    assert timing.duration == pytest.approx(expected.duration, rel=1e-9)
    assert timing.points.t == pytest.approx(expected.points.t, rel=1e-9, abs=1e-12)
    for name in ('q', 'u', 'udot'):
        assert getattr(timing.points, name) == pytest.approx(
            getattr(expected.points, name), rel=1e-9, abs=1e-6)
    assert timing.tau == pytest.approx(expected.tau, rel=1e-9, abs=1e-6)
    assert timing.active == expected.active or len(timing.active) == len(expected.active)


def test_speeds_at_the_ends_are_those_of_the_driving_joints():
    timing = time_optimal(linkage(), [[0.8], [2.0]], start_speed=0.5, end_speed=0.25)
    _, u, _ = timing.motion.sample(np.array([0.0, np.nextafter(timing.duration, 0.0)]))
    assert u[:, 0] == pytest.approx([0.5, 0.25], rel=1e-3)


def test_rests_of_a_path_separate_sections_in_one_assembly_mode():
    robot = arm()
    robot.parameters.payload = None
    rows = np.array([[0.0, 0.0, 0.0, 0.0], [0.2, 0.3, 0.1, 0.0], [0.2, 0.3, 0.1, 0.0],
                     [0.5, -0.1, 0.0, 1.0]])
    timing = time_optimal(robot,
                          Motion.from_points(np.arange(4.0), rows, np.zeros((4, 4)),
                                             joint_names=DRIVEN))
    parts = [time_optimal(robot, rows[k:k + 2]).duration for k in (0, 2)]
    assert timing.duration == pytest.approx(sum(parts), rel=1e-3)
    expected = np.array([positions(robot, *row) for row in timing.motion.positions])
    assert timing.points.q == pytest.approx(expected, abs=1e-9)


def test_assembly_mode_of_a_path_is_that_of_the_configuration_at_which_it_begins():
    robot = Robot(linkage().model, constraints=[PIN], independent=['crank'])
    low = at_angle(0.8)
    high = robot.closed_configuration([0.8, 1.2, 2.0], fixed=['crank'])
    assert np.abs(high - low).max() > 1.0
    for start in (low, high):
        timing = time_optimal(robot, CRANK, rest=start + [0.0, 1e-4, 0.0])
        assert timing.points.q[0] == pytest.approx(start, abs=1e-9)
        moved = time_optimal(robot, [[1.4], [2.0]], rest=start)
        near = timing.points.q[int(np.abs(timing.points.q[:500, 0] - 1.4).argmin())]
        assert moved.points.q[0] == pytest.approx(near, abs=0.02)
    with pytest.raises(InputError, match=r'rest: shape \(2,\)'):
        time_optimal(robot, CRANK, rest=[0.0, 1.0])


def test_motion_of_other_driving_joints_has_their_path_and_the_torques_of_the_motors():
    robot = linkage()
    q = four_bar_angles(np.array([0.8, 1.3]))[:, 2:]
    timing = time_optimal(robot,
                          Motion.from_points([0.0, 1.0], q, joint_names=['rocker']))
    assert timing.motion.joint_names == ('rocker',)
    crank, rate, change = (rows[2:-2, 0] for rows in timing.points[1:])
    _, tau = four_bar_torques(robot, crank, rate, change)
    assert timing.tau[2:-2, 0] == pytest.approx(tau, abs=1e-3)
    assert np.abs(tau).max() <= 1.001 * 14.0 and not timing.tau[:, 1:].any()


@pytest.mark.parametrize('distance', [1e-2, 1e-4, 1e-6])
def test_path_that_ends_next_to_a_dead_point_keeps_the_limits(distance):
    """The rocker drives; the crank turns by about the root of what is left."""
    robot = linkage()
    angles = four_bar_angles(np.linspace(0.8, 4.0, 200_001))
    rocker = angles[[0, angles[:, 2].argmax()], 2]
    timing = time_optimal(robot, Motion.from_points(
        [0.0, 1.0], rocker[:, None] - [[0.0], [distance]], joint_names=['rocker']))
    needed = demand_at(robot, timing.motion, 1.0, 1e-4, math.inf, NONE)
    moving = np.abs(needed.u[:, 0]) > 1e-3
    crank = needed.q[moving, 0]
    rate = needed.u[moving, 0]
    change = needed.udot[moving, 0]
    _, tau = four_bar_torques(robot, crank, rate, change)
    assert np.abs(tau).max() <= 1.001 * 14.0
    assert np.median(np.abs(tau)) == pytest.approx(14.0, rel=1e-3)
    assert four_bar_angles(crank)[:, 2] == pytest.approx(needed.q[moving, 2], abs=1e-9)


@pytest.mark.parametrize(('robot', 'path', 'given', 'error', 'words'), [
    (palletizer, [[0, 0, 0, 0], [0, -1.3, 0, 0]], {}, LoopError,
     (f'{SINGULAR}: path: '
      rf"0\.\d+ of it, {{'swivel': 0.0, 'shoulder': -1.1\d*, .*: conditioning")),
    (linkage, Motion.from_points([0.0, 1.0], [[-2.09], [-0.1]], joint_names=['rocker']),
     {}, LoopError, r"path: 0\.\d+ of it, {'rocker': -\S+}: "),
    (palletizer, [[0, 0, 0, 0], [3.0, 0, 0, 0]], {}, InputError,
     "path: joint 'swivel': position 3; expected within its upper limit 2.8798"),
    (linkage, Motion.from_points([0.0, 1.0], [[0.8], [1.0]], joint_names=['elbow']), {},
     InputError,
     r"path: joints \['elbow'\]; expected 1 of crank, coupler, rocker, as many as"),
    (linkage, Motion.from_points([0.0, 1.0], [[0.8, 0.0], [1.0, 0.0]],
                                 joint_names=['crank', 'rocker']), {}, InputError,
     r"path: joints \['crank', 'rocker'\]; expected 1 of crank"),
    (linkage, [[0.8, 0.1], [0.9, 0.1]], {}, InputError, r'waypoint 0: shape \(2,\)'),
    (linkage, CRANK, {'jerk': 100.0}, InputError,
     ('robot: chosen speeds or constraints '
      'with a limit of jerk or torque rate; expected')),
    (linkage, CRANK, {'torque_rate': 100.0}, InputError,
     'with a limit of jerk or torque rate'),
    (linkage, CRANK, {'power': [1.0, 2.0]}, InputError, 'power'),
    (linkage, CRANK, {'acceleration': 0.0}, InputError,
     "acceleration of joint 'crank': limit 0; expected a positive limit"),
    (lambda: Robot(two_links()), [[0.0, 0.0], [1.0, 1.0]], {'rest': [0.0, 0.0]},
     InputError, 'rest: given for a robot without constraints; expected None'),
    (linkage, CRANK, {'power': 0.0}, InputError, "power of joint 'crank': limit 0"),
    (lambda: linkage(effort=2.0), CRANK, {}, InputError,
     ("path: joint 'crank': torque "
      r'\S+ at rest at \S+ of the path, .*; expected at most its ef')),
    (lambda: linkage(effort=math.inf, velocity=math.inf), CRANK, {}, InputError,
     'robot: no limit bounds the motion'),
])
def test_paths_that_cannot_be_timed_are_named(robot, path, given, error, words):
    with pytest.raises(error, match=words):
        time_optimal(robot(), path, **given)


def test_mechanisms_that_cannot_be_timed_are_refused_by_their_reason():
    model = two_links()
    names = model.joint_names
    path = Motion.from_points([0.0, 1.0], [[0.0, 0.0], [1.0, 1.0]], joint_names=names)
    for robot in (Robot(model,
                        speeds=Speeds(lambda q, t: np.eye(2), lambda q, t: np.ones(2))),
                  Robot(model, constraints=[Prescribed('joint1', lambda t: np.sin(t))])):
        with pytest.raises(InputError,
                           match='robot: speeds or constraints that are functions'):
            time_optimal(robot, path if robot.n == 2 else Motion.from_points(
                [0.0, 1.0], [[0.0], [1.0]], joint_names=names[:1]))
    cart = sleigh('body/x', 'body/rz')
    with pytest.raises(InputError, match="constraint 'runner' is one of velocities"):
        time_optimal(cart, Motion.from_points([0.0, 1.0], [[0.0, 0.0], [1.0, 1.0]],
                                              joint_names=['body/x', 'body/rz']))
    builder = ModelBuilder('beam')
    builder.beam('mast', 'world', FlexibleLink(1.0, 2.0, 80.0, (1, 0)), axis=(0, 1, 0))
    with pytest.raises(InputError, match='robot: with beams; expected a rigid robot'):
        time_optimal(Robot(builder.model()), np.zeros((2, 3)))


def test_a_delta_robot_keeps_the_torques_of_its_arms_by_the_definition():
    example = run_path('examples/delta_robot.py')
    robot = example['robot']
    arms = example['driven']
    robot.limits = replace(robot.limits, effort=np.full(robot.n_q, 200.0))
    timing = time_optimal(robot,
                          [example['path'](t)[0] for t in np.linspace(0.0, 0.35, 9)])
    assert timing.motion.joint_names == ('x', 'y', 'z')
    middles = 0.5 * (timing.motion.times[1:] + timing.motion.times[:-1])[7:-7:40]
    largest = []
    for t, p, u, udot in zip(middles, *timing.motion.sample(middles)):
        q = timing.points.q[np.abs(timing.points.t - t).argmin()].copy()
        q[:3] = p
        q = robot.closed_configuration(q, fixed=('x', 'y', 'z'))
        needed = nonholonomic.inverse_dynamics(robot.mechanism, q, u, udot)
        T = np.array(
            [nonholonomic.joint_motion(robot.mechanism, q, unit, 0.0 * unit, 0.0)[0]
             for unit in np.eye(3)])
        largest.append(np.abs(np.linalg.solve(T[:, arms], needed)).max() / 200.0)
    assert max(largest) <= 1.001
    assert np.median(largest) == pytest.approx(1.0, abs=2e-3)
