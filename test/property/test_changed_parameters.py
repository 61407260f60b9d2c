"""
What is kept with a robot counts with its present parameters.

Each use of a robot is made once, then gravity, payload and limits change, and the same
use must give the numbers of a robot that has had these parameters from the start.
"""

from dataclasses import replace
from functools import partial

from kane_dynamics import (ComputedTorque, Controller, Drive, ElasticFeedforward,
                           Inertial, inverse_kinematics, Limits, ModelBuilder,
                           MomentumObserver, Motion, Robot, rod, simulate, SmoothMotion,
                           Speeds, with_drives)
from kane_dynamics.feasibility import demand, fastest, time_optimal
from kane_dynamics.optimal_control import TrajectoryOptimizer
from linkages import at_angle, four_bar_model, PIN
from mechanisms import with_joints
import numpy as np
import pytest

Q, U, UDOT = np.array([[0.3, -0.4], [0.6, -0.2], [1.0, 0.5]])


def model(**law):
    """Return an arm of two links with limits."""
    b = ModelBuilder('arm')
    limits = Limits(-1.5, 1.5, 3.0, 80.0)
    b.body('upper', joint='a', axis=(0, 1, 0), inertial=rod(2.0, (0, 0, 0), (0.5, 0, 0)),
           limits=limits, **law)
    b.body('lower', 'upper', joint='b', axis=(0, 1, 0), at=(0.5, 0, 0), limits=limits,
           inertial=rod(1.0, (0, 0, 0), (0.4, 0, 0)), **law)
    return b.model()


def arm(**law):
    return Robot(model(**law), payload_frame='lower')


def in_chosen_speeds(**law):
    Y = np.array([[1.0, 0.0], [1.0, 1.0]])
    return Robot(model(**law), payload_frame='lower',
                 speeds=Speeds(lambda q, t: Y, names=('x', 'y')))


def elastic():
    return Robot(with_drives(model(), {
        'a': Drive(900.0, damping=2.0, rotor_inertia=0.3)}), payload_frame='lower')


def four_bar():
    robot = Robot(with_joints(four_bar_model(), friction=0.3), constraints=[PIN],
                  independent=['crank'], payload_frame='coupler')
    bounds = {'lower': np.full(3, -4.0), 'upper': np.array([1.5, 4.0, 4.0])}
    robot.limits = replace(robot.limits, **bounds)
    return robot


MOTION = Motion.from_points([0.0, 0.4, 0.9], [Q, Q + 0.3, Q - 0.1], np.zeros((3, 2)),
                            joint_names=('a', 'b'))
SMOOTH = SmoothMotion.from_points([0.0, 0.9], [Q, Q + 0.2], joint_names=('a', 'b'))


def simulated(robot, **options):
    """Return a function: the ends of a simulation into the stops."""
    n_q, n = robot.n_q, robot.n
    q0 = np.resize(Q, n_q)
    if robot.constraint_names:
        q0 = at_angle(0.6)
    torque = options.pop('torque', None)

    def run():
        law = torque(robot) if torque else np.full(n, 6.0)
        ran = simulate(robot, q0, np.full(n, 0.5), 0.4, step=2e-3, torque=law, **options)
        return np.concatenate([ran.q[-1], ran.u[-1], ran.stop_forces[-1]])
    return run


def of_object(make, call):
    """Return a use: an object that is made once, and its call."""
    def use(robot):
        made = make(robot)
        return partial(call, made)
    return use


def of_function(call):
    return lambda robot: partial(call, robot)


def observed(observer):
    observer.reset()
    for t in (0.0, 0.01, 0.02):
        torque = observer.update(t, Q, U, np.ones(2))
    return torque


LAW = {'friction': 0.3}
BRISTLES = {'friction': 0.3, 'presliding_stiffness': 40.0}
USES = {
    'quantities': (arm, of_function(lambda r: np.concatenate([
        r.inverse_dynamics(Q, U, UDOT), r.forward_dynamics(Q, U, U),
        r.gravity_force(Q[None])[0], r.mass_matrix(Q).ravel()]))),
    'workspace': (arm, of_object(lambda r: r.bind(), lambda w: (
        w.q.__setitem__(slice(None), Q), w.u.__setitem__(slice(None), U),
        w.inverse_dynamics().copy())[-1])),
    'wrench by name': (arm, of_function(lambda r: r.inverse_dynamics(
        Q, U, UDOT, wrench={'upper': np.arange(6.0)}))),
    'inverse kinematics': (arm, of_function(lambda r: inverse_kinematics(
        r, 'lower', r.frame_pose('lower', [1.2, -0.2])).q)),
    'elastic feedforward': (elastic, of_object(
        ElasticFeedforward, lambda f: f.along(SMOOTH, 0.05).motor_torque)),
    'controller': (arm, of_object(partial(Controller, mode='computed_torque'),
                                  lambda c: c.command(0.0, Q, U, MOTION).tau)),
    'observer': (arm, of_object(partial(MomentumObserver, gain=50.0, max_gap=1.0),
                                observed)),
    'optimizer': (arm, of_object(
        lambda r: TrajectoryOptimizer(r, nodes=5, interval=0.02, torque_limits=60.0),
        lambda o: (o.start(o.holding_torques(Q)), o.solve(Q, U).tau)[-1])),
    'demand': (arm, of_function(lambda r: demand(r, MOTION).uses['effort'])),
    'fastest': (arm, of_function(lambda r: np.array([fastest(r, MOTION).speed]))),
    'time_optimal': (arm, of_function(lambda r: np.array([
        time_optimal(r, [Q, Q + 0.3]).duration]))),
    'simulate': (arm, partial(simulated, stops=True)),
    'implicit': (partial(arm, **LAW), partial(simulated, stops=True,
                                              integrator='implicit')),
    'computed torque': (arm, partial(simulated, torque=lambda r: ComputedTorque(
        r, MOTION, 50.0, 10.0))),
    'sticking': (partial(arm, **LAW), partial(simulated, stops=True, sticking=True)),
    'bristles': (partial(arm, **BRISTLES), partial(simulated, stops=True)),
    'sticking in chosen speeds': (partial(in_chosen_speeds, **LAW), partial(
        simulated, stops=True, sticking=True)),
    'bristles in chosen speeds': (partial(in_chosen_speeds, **BRISTLES), partial(
        simulated, stops=True)),
    'closed loop': (four_bar, partial(simulated, stops=True, sticking=True))}


def lower_limits(robot):
    limits = robot.limits
    robot.limits = replace(limits, lower=0.7 * limits.lower, upper=0.6 * limits.upper,
                           velocity=0.5 * limits.velocity, effort=0.6 * limits.effort)


def raise_upper_limits(robot):
    robot.limits = replace(robot.limits, upper=np.full(robot.n_q, np.inf))


def raise_lower_limits(robot):
    robot.limits = replace(robot.limits, lower=np.full(robot.n_q, -np.inf))


def turn_gravity(robot):
    robot.parameters.gravity = [2.0, 1.0, -5.0]


def add_payload(robot):
    robot.parameters.payload = Inertial(0.8, np.array([0.3, 0.0, 0.1]),
                                        0.01 * np.eye(3))


@pytest.mark.parametrize('name', USES)
def test_a_use_after_changes_is_that_of_a_robot_with_these_parameters(name):
    make, use = USES[name]
    robot = make()
    call = use(robot)
    call()
    changes = []
    for change in (turn_gravity, add_payload, lower_limits, raise_upper_limits,
                   raise_lower_limits):
        change(robot)
        changes.append(change)
        fresh = make()
        for each in changes:
            each(fresh)
        np.testing.assert_array_equal(call(), use(fresh)(), err_msg=change.__name__)
