"""Laws in the space of a frame, on random mechanisms, states and targets."""

from dataclasses import replace
from functools import cache

from ball_trees import random_ball_tree
from hypothesis import given, strategies as st
from kane_dynamics import (absolute_rates, CartesianImpedance, Coupling, HandGuiding,
                           JointImpedance, knife_edge, momenta, pose_exp, pose_from,
                           Robot, TaskSpace)
from kane_dynamics.mechanics.ball_joints import coordinate_rates, moved
from mechanisms import random_model
import numpy as np
import pytest
from random_loops import random_loops

K = np.array([300.0, 500.0, 800.0, 10.0, 30.0, 60.0])
# Half a turn and near it, besides ordinary angles.
ANGLES = st.sampled_from([0.0, 1e-9, 0.5, 2.0, 2.8, 3.1, np.pi - 1e-9, np.pi])
KINDS = ('tree', 'absolute', 'momenta', 'knife edge', 'coupling', 'planar loops',
         'spatial loops', 'ball joints')


@cache
def mechanism(kind):
    """Return a robot, one of its moving frames and a closed configuration."""
    if kind.endswith('loops'):
        loops = random_loops(0 if kind == 'planar loops' else 2)
        robot = unlimited(Robot(loops.model, constraints=loops.constraints,
                                configuration=loops.q0))
        return robot, moving_frame(robot), loops.q0
    if kind == 'ball joints':
        robot = unlimited(Robot(random_ball_tree(1)))
        q, = robot.random_configuration(np.random.default_rng(0), 1)
        return robot, moving_frame(robot), q
    model = random_model(5, 4, branching=0.3, prismatic=0.2, passive=True)
    tip = model.frames[-1].name
    options = {'absolute': {'speeds': absolute_rates}, 'momenta': {'speeds': momenta},
               'knife edge': {'constraints': [knife_edge(tip, (0, 1, 0))]},
               'coupling': {'constraints': [Coupling('joint3', {'joint1': -2.0}, 0.1)]}}
    robot = unlimited(Robot(model, **options.get(kind, {})))
    return robot, moving_frame(robot), robot.closed_configuration(
        np.full(robot.n_q, 0.3))


def unlimited(robot):
    """Return the robot with motors that no law saturates."""
    limits = robot.limits
    robot.limits = replace(limits, effort=np.full_like(limits.effort, np.inf))
    return robot


def moving_frame(robot):
    """Return the frame behind the most joints."""
    model = robot.model
    return max(model.frames, key=lambda frame: len(list(model.path(frame.body)))).name


@cache
def impedance(kind, axes):
    """Return an impedance with all that has an energy."""
    robot, frame, _ = mechanism(kind)
    walls = {'limit_stiffness': 40.0,
             'limit_margin': 0.0} if kind == 'ball joints' else {}
    return CartesianImpedance(robot, frame, stiffness=K, axes=axes, force_limit=60.0,
                              moment_limit=8.0, **walls)


def near(robot, q0, step):
    """Return a closed configuration near another one."""
    q = np.array(q0, dtype=float)
    move = np.resize(step, robot.model.n)
    q = q + 0.1 * coordinate_rates(robot.model, q, move)
    return robot.closed_configuration(q) if robot.constraint_names else q


def power(robot, stored, q, u, udot, h=1e-5):
    """Return the rate of kinetic plus stored energy by differences, W."""
    qdot = robot.joint_rates(q, u) if not robot.model.balls else None

    def energy(s):
        if qdot is None:
            at = moved(robot.model, q, s * (u + 0.5 * s * udot))
        else:
            at = q + s * qdot
        if robot.constraint_names and any('knife' not in x
                                          for x in robot.constraint_names):
            at = robot.closed_configuration(at)
        return robot.kinetic_energy(at, u + s * udot) + stored(at)
    return (energy(h) - energy(-h)) / (2.0 * h)


STEPS = st.lists(st.floats(-2.0, 2.0), min_size=3, max_size=3).map(np.array)
VECTORS = st.lists(st.floats(-1.0, 1.0), min_size=6, max_size=6).map(np.array)


@pytest.mark.slow
@pytest.mark.parametrize('axes', ['world', 'frame'])
@pytest.mark.parametrize('kind', KINDS)
@given(STEPS, VECTORS, VECTORS, ANGLES)
def test_a_resting_target_adds_no_energy(kind, axes, step, motion, displacement, angle):
    robot, frame, q0 = mechanism(kind)
    law = impedance(kind, axes)
    q = near(robot, q0, step)
    u = np.resize(motion, robot.n)
    axis = displacement[3:] + [0.0, 0.0, 2.0]
    turn = angle * axis / np.linalg.norm(axis)
    target = robot.frame_pose(frame, q) @ pose_from(displacement[:3]) @ pose_exp(
        [0, 0, 0, *turn])
    tau = robot.generalized_force(law.torque(q, u, target), q)
    udot = robot.forward_dynamics(q, u, tau)
    rate = power(robot, lambda at: law.energy(at, target), q, u, udot)
    assert rate < 1e-5 * (1.0 + np.abs(u).max() * np.abs(tau).max())


@pytest.mark.slow
@pytest.mark.parametrize('kind', ['tree', 'coupling', 'planar loops', 'spatial loops'])
@given(STEPS, VECTORS, VECTORS)
def test_joint_impedance_and_guiding_add_no_energy(kind, step, motion, target):
    robot, _, q0 = mechanism(kind)
    followed = [robot.coordinate_names[k] for k in robot.mechanism.free]
    law = JointImpedance(robot, stiffness=50.0, damping=2.0,
                         followed=None if robot.equations.in_joint_rates else followed)
    places = [robot.coordinate_names.index(name) for name in law.followed]
    q = near(robot, q0, step)
    u = np.resize(motion, robot.n)
    desired = q[places] + np.resize(target, robot.n)
    guiding = HandGuiding(robot, friction=1.0)
    for torque, stored in ((law.torque(q, u, desired),
                            lambda at: law.energy(at, desired)),
                           (guiding.torque(q, u), guiding.energy)):
        tau = robot.generalized_force(torque, q)
        udot = robot.forward_dynamics(q, u, tau)
        rate = power(robot, stored, q, u, udot)
        assert rate < 1e-5 * (1.0 + np.abs(u).max() * np.abs(tau).max())


@pytest.mark.slow
@pytest.mark.parametrize('kind', KINDS)
@given(STEPS, VECTORS)
def test_the_null_space_does_not_accelerate_the_frame(kind, step, force):
    """Of regular configurations; the null space's torque is bounded everywhere."""
    robot, frame, q0 = mechanism(kind)
    space = TaskSpace(robot, frame, directions=['x', 'z'])
    q = near(robot, q0, step)
    dynamics = space.at(q)
    tau = np.resize(force, robot.n)
    null = dynamics.null_projector.T @ tau
    acceleration = dynamics.jacobian @ robot.inverse_mass_matrix(q) @ null
    if dynamics.regularization == 0.0:
        without = dynamics.jacobian @ robot.inverse_mass_matrix(q) @ tau
        assert np.abs(acceleration).max() < 1e-9 * (1.0 + np.abs(without).max())
    assert np.isfinite(null).all()
