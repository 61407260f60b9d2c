"""Each kind of effort gives the actuators' torques of loops and chosen speeds."""

from dataclasses import replace
from functools import cache

from kane_dynamics import (absolute_rates, box, InputError, load_constraints, load_urdf,
                           Robot)
from kane_dynamics.identification import Efforts, identify_payload, Recording
from kane_dynamics.loop_tracking.driven_mechanism import mechanism_motion
from kane_dynamics.mechanics.definition import nonholonomic
from kane_dynamics.mechanics.friction import friction_torque
from kane_dynamics.model.model import with_payload
from kinds_of_mechanism import case
from linkages import five_bar, five_bar_at
import numpy as np
from palletizer import CONSTRAINTS, DRIVEN, URDF
import pytest

KINDS = ('current', 'current without gravity', 'motor without gravity', 'joint',
         'joint without gravity', 'external')
LOAD = box(20.0, (0.3, 0.2, 0.4), at=(0.05, 0.02, 0.25))


@cache
def lossy_palletizer():
    """Return the palletizer with friction and rotors, and the motion of its motors."""
    losses = {'joints': {name: {'damping': 20.0, 'friction': 30.0, 'armature': 15.0}
                         for name in DRIVEN} | {'elbow': {'damping': 5.0}}}
    robot = Robot(load_urdf(URDF, supplement=losses), **load_constraints(CONSTRAINTS))
    t = np.arange(0.0, 6.0, 0.1)
    w = np.array([0.7, 1.1, 1.3, 3.7])
    a = np.array([0.5, 0.3, 0.3, 1.0])
    s = np.sin(np.outer(t, w))
    c = np.cos(np.outer(t, w))
    state = a * s + [0.2, 0.1, -0.1, 0.5], a * w * c, -a * w**2 * s
    return robot, t, DRIVEN, state


@cache
def driven_at_the_rocker():
    """Return a four-bar linkage in its crank's speed, the motor at its rocker."""
    robot = case('closed loop').robot
    options = {**robot.options, 'independent': ['crank'], 'actuated': ['rocker']}
    t = np.arange(0.0, 2.0, 0.1)
    state = 0.8 + 0.5 * np.sin(2.0 * t), np.cos(2.0 * t), -2.0 * np.sin(2.0 * t)
    return Robot(robot.model, **options), t, ('crank',), tuple(x[:, None] for x in state)


@cache
def preloaded_five_bar():
    """Return a five-bar linkage with three motors, which may work against each other."""
    robot = five_bar('left_crank', 'right_crank', 'right_bar')
    bodies = tuple(replace(body, joint=replace(body.joint, damping=0.4, armature=0.3))
                   for body in robot.model.bodies)
    robot = Robot(replace(robot.model, bodies=bodies),
                  **{**robot.options, 'configuration': five_bar_at(2.0, 1.0),
                     'friction': True})
    t = np.arange(0.0, 2.0, 0.1)
    w = np.array([2.1, 3.3])
    a = np.array([0.5, 0.4])
    s = np.sin(np.outer(t, w))
    c = np.cos(np.outer(t, w))
    return robot, t, ('left_crank', 'right_crank'), (a * s + [2.0, 1.0], a * w * c,
                                                     -a * w**2 * s)


MECHANISMS = (lossy_palletizer, driven_at_the_rocker, preloaded_five_bar)


@cache
def states_of(mechanism):
    """Return the robot, its motion, and by Kane's definition what its motors do."""
    robot, t, joints, state = mechanism()
    motion = mechanism_motion(robot, joints, t, *state)
    names = robot.joint_names
    places = [names.index(name) for name in robot.actuated_names]
    rng = np.random.default_rng(2)
    light = Robot(replace(robot.model, gravity=np.zeros(3)), **robot.options).mechanism
    tau = []
    losses = []
    weight = []
    force = []
    for q, u, udot in zip(*motion):
        of_motion = nonholonomic.inverse_dynamics(robot.mechanism, q, u, udot)
        at_rest = 0.0 * u
        of_weight = (nonholonomic.inverse_dynamics(robot.mechanism, q, at_rest, at_rest)
                     - nonholonomic.inverse_dynamics(light, q, at_rest, at_rest))
        # Rates of the motors per unit of each independent speed.
        T = np.array([nonholonomic.joint_motion(robot.mechanism, q, e, at_rest)[0]
                      for e in np.eye(robot.n)]).T[places]
        against = np.linalg.svd(T)[0][:, robot.n:]  # torques without a generalized force
        preload = against @ (20.0 * rng.normal(size=against.shape[1]))
        tau.append(np.linalg.pinv(T).T @ of_motion + preload)
        weight.append(np.linalg.pinv(T).T @ of_weight)
        rates, accelerations = nonholonomic.joint_motion(robot.mechanism, q, u, udot)
        joints_of_motors = [robot.model.coordinate_joints[k] for k in places]
        losses.append(
            [friction_torque(joint, rates[k]) + joint.armature * accelerations[k]
             for k, joint in zip(places, joints_of_motors)])
        force.append(of_motion)
    return (robot, t, motion, *map(np.array, (tau, losses, weight, force)))


def as_reported(kind, tau, losses, weight):
    """Return what a driver of each kind reports of the motors."""
    constants = np.linspace(3.0, 7.0, tau.shape[1])
    return {'current': (Efforts('motor_current', constants=constants), tau / constants),
            'current without gravity': (Efforts('motor_current', False, constants),
                                        (tau - weight) / constants),
            'motor without gravity': (Efforts('motor_torque', False), tau - weight),
            'joint': (Efforts('joint_torque'), tau - losses),
            'joint without gravity': (Efforts('joint_torque', False),
                                      tau - losses - weight),
            'external': (Efforts('external_torque'), 0.0 * tau)}[kind]


@pytest.mark.parametrize('kind', KINDS)
@pytest.mark.parametrize('mechanism', MECHANISMS)
def test_the_torque_of_the_actuators_follows_from_every_kind_of_effort(mechanism, kind):
    robot, _, motion, tau, losses, weight, force = states_of(mechanism)
    efforts, reported = as_reported(kind, tau, losses, weight)
    torque = efforts.torque(robot, motion.q, motion.u, reported, motion.udot)
    if mechanism is not preloaded_five_bar:  # else single torques depend on the preload
        np.testing.assert_allclose(torque, tau, atol=1e-8 * np.abs(tau).max())
    whole = np.zeros((len(tau), robot.n_q))
    whole[:, [robot.joint_names.index(name) for name in robot.actuated_names]] = torque
    np.testing.assert_allclose(robot.generalized_force(whole, motion.q), force,
                               atol=1e-8 * np.abs(force).max())
    single = efforts.torque(robot, motion.q[3], motion.u[3], reported[3], motion.udot[3])
    np.testing.assert_allclose(single, torque[3], rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize('kind', KINDS)
def test_a_payload_of_a_palletizer_is_found_from_every_kind_of_effort(kind):
    robot, t, joints, state = lossy_palletizer()
    _, _, motion, tau, losses, weight, _ = states_of(lossy_palletizer)
    heavy = Robot(with_payload(robot.model, 'tool', LOAD), **robot.options)
    places = [robot.joint_names.index(name) for name in robot.actuated_names]
    loaded = heavy.inverse_dynamics(*motion)
    of_motors = heavy.joint_torques(loaded, motion.q)[:, places]
    efforts, reported = as_reported(kind, of_motors, losses, weight)
    if kind == 'external':  # an arm that knows nothing of the payload
        reported = tau - of_motors
    order = [joints.index(name) for name in robot.actuated_names]
    recording = Recording(t, *(x[:, order] for x in state), reported)
    converted = efforts.applied(robot, recording)
    payload = identify_payload(robot, converted, 'tool')
    assert payload.inertial.mass == pytest.approx(LOAD.mass, abs=0.01)


def test_efforts_of_loops_at_rest_that_contradict_their_meaning_are_named():
    robot, _, motion, _, _, weight, _ = states_of(lossy_palletizer)
    q = motion.q[0]
    held = weight[0]
    without = Efforts('motor_torque', gravity=False)
    assert Efforts().contradiction(robot, q, held) == ''
    assert without.contradiction(robot, q, 0.01 * held) == ''
    assert 'sign is reversed' in Efforts().contradiction(robot, q, -held)
    assert 'do they contain gravity' in without.contradiction(robot, q, held)
    assert 'do they lack gravity' in Efforts().contradiction(robot, q, 0.01 * held)


def test_efforts_of_a_tree_with_chosen_speeds_are_those_of_its_joints():
    model = case('tree').robot.model
    tree = Robot(model)
    robot = Robot(model, speeds=absolute_rates)
    rng = np.random.default_rng(1)
    q, u, udot, effort = rng.normal(size=(4, robot.n))
    qdot = robot.joint_rates(q, u)
    qddot = robot.joint_accelerations(q, u, udot)
    for efforts in (Efforts('joint_torque', gravity=False), Efforts('external_torque')):
        torque = efforts.torque(robot, q, u, effort, udot)
        expected = efforts.torque(tree, q, qdot, effort, qddot)
        np.testing.assert_allclose(torque, expected, atol=1e-10)


def test_efforts_and_constants_fit_the_actuators():
    robot, _, motion, *_ = states_of(lossy_palletizer)
    q = motion.q[0]
    u = motion.u[0]
    with pytest.raises(InputError,
                       match=r'effort: shape \(10,\); expected \(4,\) or \(N, 4\), '
                       r'of swivel, shoulder, turn, lever_drive'):
        Efforts('joint_torque').torque(robot, q, u, np.zeros(10))
    with pytest.raises(InputError, match=r'constants: .*expected one number, or 4'):
        Efforts('motor_current', constants=[1.0, 2.0]).torque(robot, q, u, np.zeros(4))
