"""Compiled robots with chosen speeds and constraints: physical laws and identities."""

from functools import cache

from kane_dynamics import (absolute_rates, ConstraintError, Coupling, InputError,
                           knife_edge, momenta, PointVelocity, power_balance, Prescribed,
                           Robot, simulate, Speeds, Trajectory)
from kane_dynamics.mechanics.definition import kinematics
from linkages import at_angle, four_bar, four_bar_model, PIN
from mechanisms import random_model
import numpy as np
import pytest


@cache
def chain(kind, passive=True):
    """Return a spatial chain of five joints under a choice of speeds or a constraint."""
    model = random_model(5, 5, branching=0.0, prismatic=0.2, passive=passive)
    tip = model.frames[-1].name
    rheonomic = Speeds(lambda q, t: np.diag([2.0 + np.sin(x + t) for x in q]),
                       lambda q, t: np.array([np.cos(t) * x for x in q]))
    return Robot(model, wrench_frames=(tip,), payload_frame=tip, **{
        'absolute': {'speeds': absolute_rates}, 'momenta': {'speeds': momenta},
        'rheonomic': {'speeds': rheonomic},
        'knife edge': {'constraints': [knife_edge(tip, (0, 1, 0))]},
        'coupling': {'constraints': [Coupling('joint3', {'joint1': -2.0}, 0.1)]},
        'prescribed': {'constraints': [Prescribed('joint1',
                                                  lambda t: 0.3 * np.sin(2.0 * t))]},
        'a point in time': {'constraints': [
            PointVelocity(tip, (1, 0, 1), value=lambda t: np.sin(2.0 * t))]},
    }[kind])


KINDS = ('absolute', 'momenta', 'rheonomic', 'knife edge', 'coupling', 'prescribed',
         'a point in time')
T = 0.4  # s


def state(robot, seed=0, t=T):
    """Return a random state of moderate size, conditions on positions met."""
    rng = np.random.default_rng(seed)
    return (robot.closed_configuration(rng.uniform(-0.8, 0.8, robot.n_q), t=t),
            rng.uniform(-1.0, 1.0, robot.n), rng.uniform(-1.0, 1.0, robot.n))


@pytest.mark.parametrize('kind',
                         ['knife edge', 'coupling', 'prescribed', 'a point in time'])
def test_joints_carry_what_constraints_exert(kind):
    robot = chain(kind, passive=False)
    q, u, udot = state(robot, 3)
    tau = robot.inverse_dynamics(q, u, udot, t=T)
    tree = Robot(robot.model)
    rate = robot.joint_rates(q, u, t=T)
    h = 1e-6
    acceleration = (robot.joint_rates(q + h * rate, u + h * udot, t=T + h)
                    - robot.joint_rates(q - h * rate, u - h * udot, t=T - h)) / (2 * h)
    needed = tree.inverse_dynamics(q, rate, acceleration)
    forces = robot.constraint_forces(q, u, tau, t=T)
    placed = robot.mechanism.state(q, T)
    J = np.array(robot.mechanism.rows(placed).J, dtype=float)
    supplied = robot.joint_torques(tau, q, t=T) + J.T @ forces
    np.testing.assert_allclose(supplied, needed,
                               atol=1e-5 * (1.0 + np.abs(needed).max()))
    together = robot.joint_reactions(q, u, udot, t=T)
    for k, body in enumerate(robot.model.bodies):
        axis = kinematics.configurations(robot.model, q)[k].axis
        reaction = robot.joint_reaction(body.joint.name, q, u, udot, t=T)
        np.testing.assert_allclose(together[k], reaction, rtol=1e-9, atol=1e-9)
        along = (reaction[3:] if body.joint.kind == 'revolute' else reaction[:3]) @ axis
        # A coupling or a drive acts at the joint itself.
        in_joints = kind in ('coupling', 'prescribed')
        expected = (robot.joint_torques(tau, q, t=T) + in_joints * (J.T @ forces))[k]
        assert along == pytest.approx(expected,
                                      rel=1e-7, abs=1e-8 * (1.0 + np.abs(needed).max()))


def test_pins_of_a_loop_pass_on_the_force_of_its_closure():
    robot = four_bar('crank')
    u = np.array([5.0])
    q = at_angle(0.8)
    tau = robot.inverse_dynamics(q, u, np.zeros(1))
    pin = dict(zip(robot.constraint_names, robot.constraint_forces(q, u, tau)))
    rocker = robot.joint_reaction('rocker', q, u, np.zeros(1))
    # Newton for the rocker alone: from the coupler's pin and the ground's to its
    # acceleration.
    com = robot.model.bodies[2].inertial.com
    h = 1e-5
    mass = robot.model.bodies[2].inertial.mass

    def place(angle):
        T_rocker = robot.frame_pose('rocker', at_angle(angle))
        return T_rocker[:3, :3] @ com + T_rocker[:3, 3]
    acceleration = (place(0.8 + 5 * h) - 2 * place(0.8) + place(0.8 - 5 * h)) / h**2
    push = np.array([pin['pin/x'], pin['pin/y'], pin['pin/z']])
    # The closure moves its second frame, in the ground, against the first.
    np.testing.assert_allclose(rocker[:3] - push,
                               mass * (acceleration - robot.model.gravity), atol=1e-3)
    assert np.abs(rocker[3:]).max() < 1e-9  # a pin without a motor turns freely


def test_constraints_that_time_does_not_move_take_no_part_in_the_balance_of_power():
    for kind in ('knife edge', 'coupling', 'momenta'):
        robot = chain(kind)
        balance = power_balance(robot, *state(robot))
        assert abs(balance.joints) > 0.1
        assert abs(balance.residual) < 1e-9 * (abs(balance.joints)
                                               + abs(balance.energy_rate))


def test_actuators_share_a_load_with_the_least_sum_of_squares():
    robot = Robot(four_bar_model(), constraints=[PIN], independent=['crank'],
                  actuated=['crank', 'rocker'])
    q = at_angle(1.1)
    tau = np.array([2.0])
    torques = robot.joint_torques(tau, q)
    rates = robot.joint_rates(q, np.ones(1))
    assert torques[1] == 0.0
    assert torques @ rates == pytest.approx(2.0)
    np.testing.assert_allclose(torques[[0, 2]],
                               2.0 * rates[[0, 2]] / (rates[[0, 2]] ** 2).sum())


def test_torques_of_joints_are_tau_where_speeds_are_joint_rates():
    robot = Robot(four_bar_model())
    tau = np.array([1.0, -2.0, 3.0])
    out = np.zeros(3)
    np.testing.assert_array_equal(robot.joint_torques(tau), tau)
    assert robot.joint_torques(tau, out=out) is out
    np.testing.assert_array_equal(out, tau)
    with pytest.raises(InputError, match='tau: shape'):
        robot.joint_torques(np.ones(2))


def test_a_loop_stays_closed_and_keeps_its_energy_at_the_integrators_order():
    robot = four_bar('crank')
    errors = []
    for step in (8e-3, 4e-3, 2e-3):
        run = simulate(robot, at_angle(0.8), [5.0], 4.0, step=step)
        energy = run.energy.sum(axis=1)
        errors.append(np.abs(energy - energy[0]).max())
        assert run.drift < 1e-10
    assert errors[0] / errors[1] > 12.0 and errors[1] / errors[2] > 12.0


def test_many_mechanisms_move_as_each_alone():
    robot = four_bar('crank')
    q0 = np.array([at_angle(angle) for angle in (0.3, 0.8, 1.4)])
    u0 = np.array([[1.0], [-2.0], [4.0]])
    together = simulate(robot, q0, u0, 0.1)
    for k in range(3):
        alone = simulate(robot, q0[k], u0[k], 0.1)
        np.testing.assert_allclose(together.state(k).q, alone.q, rtol=1e-10, atol=1e-10)
        np.testing.assert_allclose(together.state(k).constraint_forces,
                                   alone.constraint_forces, rtol=1e-8, atol=1e-8)


def test_a_prescribed_joint_moves_as_prescribed():
    robot = chain('prescribed')
    run = simulate(robot, robot.closed_configuration(np.full(5, 0.1)), np.zeros(4), 0.5)
    at = robot.joint_names.index('joint1')
    np.testing.assert_allclose(run.q[:, at], 0.3 * np.sin(2.0 * run.t), atol=1e-10)
    assert run.constraint_forces.shape == (501, 1)


def test_a_trajectory_of_a_mechanism_is_saved_whole(tmp_path):
    run = simulate(four_bar('crank'), at_angle(0.8), [5.0], 0.01)
    run.save_npz(tmp_path / 'run.npz')
    again = Trajectory.load_npz(tmp_path / 'run.npz')
    for name in ('q', 'u', 'constraint_forces', 'constraint_residual'):
        np.testing.assert_array_equal(getattr(again, name), getattr(run, name))
    assert (again.speed_names, again.constraint_names) == (('crank',),
                                                           run.constraint_names)
    run.save_csv(tmp_path / 'run.csv')
    header = (tmp_path / 'run.csv').read_text().splitlines()[0].split(',')
    assert {'q.rocker', 'u.crank', 'tau.crank', 'constraint_force.pin/x'} <= set(header)


def test_a_robot_without_constraints_has_no_rows():
    tree = Robot(four_bar_model())
    zero = np.zeros(3)
    rows = np.zeros((4, 3))
    assert tree.constraint_residual(zero).shape == (0,)
    assert tree.constraint_residual(rows).shape == (4, 0)
    assert tree.constraint_velocity_residual(rows, rows).shape == (4, 0)
    assert tree.constraint_forces(rows, rows, rows).shape == (4, 0)
    out = np.empty((4, 0))
    assert tree.constraint_residual(rows, out=out) is out
    # Arguments are checked all the same, and nothing is compiled.
    with pytest.raises(InputError, match='q'):
        tree.constraint_residual(np.full(3, np.nan))
    with pytest.raises(InputError, match='q'):
        tree.constraint_residual(np.full((4, 3), np.inf))
    with pytest.raises(InputError, match='q'):
        tree.constraint_forces(np.zeros(2), zero, zero)
    assert not tree.kernels.kernel('constraint_residual').is_compiled


def test_misuse_is_rejected_by_name():
    model = four_bar_model()
    with pytest.raises(InputError,
                       match=r"residual of 'pin/.' is .*closed_configuration"):
        simulate(four_bar('crank'), [0.8, 0.0, -1.5], [5.0], 0.1)
    with pytest.raises(ConstraintError,
                       match=r"singular at \{'crank': 0.0.*speeds crank"):
        four_bar('crank').inverse_dynamics(np.zeros(3), np.ones(1), np.ones(1))
    with pytest.raises(InputError,
                       match='q: missing; expected the configuration, on which the f'):
        four_bar('crank').friction_force(np.ones(1))
    with pytest.raises(ConstraintError,
                       match=r'actuated: .motor.; expected one of crank, coupler'):
        Robot(model, constraints=[PIN], actuated=['motor'])
    with pytest.raises(ConstraintError, match='actuated: 2 joints; expected at least 3'):
        Robot(model, actuated=['crank', 'rocker'])
    with pytest.raises(InputError, match='q: missing'):
        four_bar('crank').joint_torques(np.ones(1))
    wrong = Speeds(lambda q, t: np.eye(2))
    with pytest.raises(ConstraintError, match=r'Y\(q, t\) returns shape \(2, 2\)'):
        Robot(model, speeds=wrong)
    with pytest.raises(ConstraintError, match='Y is singular at'):
        Robot(model, speeds=Speeds(lambda q, t: np.zeros((3, 3))))
