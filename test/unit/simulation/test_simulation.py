"""Promises of simulate: integrator order, torques, sampling, limits."""

from copy import copy

from kane_dynamics import (Body, ComputedTorque, Inertial, InputError, Joint, Limits,
                           Model, Motion, Robot, simulate, Trajectory)
from kane_dynamics.mechanics.integrators.runge_kutta import runge_kutta_4
from kane_dynamics.robot.kernel_set import KernelSet
from kane_dynamics.simulation.step_kernels import state_names
from kane_dynamics.simulation.torque_input import torque_input
from linkages import at_angle, four_bar
from mechanisms import random_model, random_state
import numpy as np
import pytest

MODEL = random_model(11, 4, mimics=1, passive=False)
Q0, U0, _ = random_state(MODEL, 2)


@pytest.fixture(scope='module')
def robot():
    """Return a conservative robot."""
    return Robot(MODEL)


def pendulum(**joint):
    """Return a pendulum of 1 kg at 1 m about a horizontal axis, hanging down at 0."""
    bob = Inertial(1.0, [0.0, 0.0, -1.0], np.zeros((3, 3)))
    hinge = Joint('hinge', 'revolute', [0, 1, 0], **joint)
    return Robot(Model('pendulum', (Body('bob', -1, hinge, bob),), ('hinge',)))


def test_native_steps_are_the_readable_integrators_steps(robot):
    h = 1e-3
    steps = 50
    tau = np.array([1.0, -2.0, 0.5, 3.0])
    x = np.concatenate([Q0, U0])

    def rates(x, tau):
        return np.concatenate([x[4:], robot.forward_dynamics(x[:4], x[4:], tau)])
    for _ in range(steps):
        x = runge_kutta_4(rates, x, [tau] * 3, h)
    q = x[:4]
    u = x[4:]
    run = simulate(robot, Q0, U0, steps * h, step=h, torque=tau)
    np.testing.assert_allclose(run.q[-1], q, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(run.u[-1], u, rtol=1e-12, atol=1e-12)


def test_energy_drift_falls_at_the_integrators_order(robot):
    drift = []
    for step in (4e-3, 2e-3, 1e-3):
        run = simulate(robot, Q0, 0.3 * U0, 0.4, step=step)
        energy = run.energy.sum(axis=1)
        drift.append(abs(energy[-1] - energy[0]))
    assert drift[0] / drift[1] > 12.0 and drift[1] / drift[2] > 12.0


def test_computed_torque_follows_its_motion(robot):
    motion = Motion.from_points([0.0, 0.5, 1.0], [Q0, Q0 + 0.3, Q0 - 0.2],
                                [0 * Q0, 0 * Q0 + 0.1, 0 * Q0],
                                joint_names=robot.joint_names)
    run = simulate(robot, Q0, 0 * U0,
                   1.5, torque=ComputedTorque(robot, motion, 400.0, 40.0))
    desired = motion.sample(run.t)[0]
    assert np.abs(run.q - desired).max() < 1e-3
    middle = len(run.t) // 3
    np.testing.assert_allclose(
        run.tau[middle],
        robot.inverse_dynamics(run.q[middle], run.u[middle], run.udot[middle]),
        rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize('options', [
    {}, {'sticking': True}, {'stops': True}, {'t0': 1e4}])
def test_computed_torque_keeps_the_order_where_the_desired_acceleration_jumps(
        robot, options):
    """The points of the motion are at multiples of the step, whose times are rounded."""
    begin = options.get('t0', 0.0)
    velocities = [0 * Q0, 0 * Q0 + 0.4, 0 * Q0]
    motion = Motion.from_points(begin + np.array([0.1, 0.3, 0.6]),
                                [Q0, Q0 + 0.2, Q0 - 0.1], velocities,
                                joint_names=robot.joint_names)
    law = ComputedTorque(robot, motion, 50.0, 10.0)
    errors = []
    for step in (8e-3, 4e-3, 2e-3):
        run = simulate(robot, Q0, 0 * U0, 0.6 if step < 5e-3 else 0.592,
                       step=step, torque=law,
                       **options)
        errors.append(np.abs(run.q - motion.sample(run.t)[0]).max())
    assert errors[1] / errors[2] > 8.0 and errors[2] < 1e-8


def test_computed_torque_with_friction_uses_the_desired_speed():
    robot = pendulum(damping=0.3, friction=0.5)
    motion = Motion.from_points([0.0, 1.0], [[0.2], [1.2]], joint_names=['hinge'])
    run = simulate(robot, [0.2], [0.4],
                   1.0, torque=ComputedTorque(robot, motion, 100.0, 20.0))
    # At its end the motion is at rest already.
    until = np.minimum(run.t, np.nextafter(1.0, 0.0))
    q_d, u_d, udot_d = motion.sample(until)
    commanded = udot_d + 20.0 * (u_d - run.u) + 100.0 * (q_d - run.q)
    expected = (commanded + 9.81 * np.sin(run.q) + 0.3 * u_d + 0.5 * np.tanh(u_d / 0.05))
    np.testing.assert_allclose(run.tau, expected, rtol=1e-12)


def test_a_table_is_held_row_by_row_and_a_callable_step_by_step(robot):
    table = np.random.default_rng(0).normal(size=(40, 4))
    by_table = simulate(robot, Q0, U0, 0.04, torque=table, sample=1e-3)
    by_call = simulate(robot, Q0, U0, 0.04, sample=1e-3,
                       torque=lambda t, q, u: table[min(round(t / 1e-3), 39)])
    np.testing.assert_array_equal(by_table.q, by_call.q)
    np.testing.assert_array_equal(by_table.tau, by_call.tau)
    np.testing.assert_array_equal(by_table.tau[:40], table)


def test_a_constant_torque_balances_gravity(robot):
    held = robot.gravity_force(Q0)
    run = simulate(robot, Q0, np.zeros(4), 0.1, torque=held)
    np.testing.assert_allclose(run.q[-1], Q0, atol=1e-10)


def test_rows_are_where_sample_says_and_ends_are_in(robot):
    run = simulate(robot, Q0, U0, 0.025, step=1e-3, sample=0.01)
    np.testing.assert_allclose(run.t, [0.0, 0.01, 0.02, 0.025])
    long = simulate(robot, Q0, 0 * U0, 0.5, step=1e-4)
    assert 900 < len(long.t) <= 1001 and long.t[-1] == pytest.approx(0.5)


def test_fields_of_a_simulation_are_consistent(robot):
    run = simulate(robot, Q0, U0, 0.05, torque=np.ones(4))
    k = 20
    # Samples are a batch, whose last digits may differ from those of one state.
    one = robot.forward_dynamics(run.q[k], run.u[k], run.tau[k])
    np.testing.assert_allclose(run.udot[k], one, rtol=1e-12)
    assert run.energy[k, 0] == robot.kinetic_energy(run.q[k], run.u[k])
    assert run.energy[k, 1] == robot.potential_energy(run.q[k])


def test_limits_are_reported_when_they_are_passed():
    robot = pendulum(limits=Limits(-0.5, 0.5, 2.0, 10.0))
    run = simulate(robot, [0.4], [1.0], 3.0)
    kinds = [event.limit for event in run.limit_events]
    assert kinds[0] == 'upper' and {'lower', 'upper'} <= set(kinds)
    first = run.limit_events[0]
    assert first.joint == 'hinge' and first.bound == 0.5 and 0.5 < first.value < 0.51
    assert "joint 'hinge' passes its upper limit" in str(first)
    assert [e.t for e in run.limit_events] == sorted(e.t for e in run.limit_events)


def test_a_start_beyond_a_limit_is_reported():
    run = simulate(pendulum(limits=Limits(-0.5, 0.5)), [0.7], [0.0], 0.01)
    assert run.limit_events[0].t == 0.0


def test_progress_is_reported_and_can_end_the_simulation(robot):
    reported = []
    simulate(robot, Q0, 0 * U0, 2.0, progress=lambda t: reported.append(t))
    assert reported == sorted(reported)
    assert reported[-1] == pytest.approx(2.0)
    assert len(reported) > 1
    run = simulate(robot, Q0, 0 * U0, 100.0, sample=1e-2, progress=lambda t: False)
    assert 0.0 < run.t[-1] < 10.0
    run = simulate(robot, Q0, 0 * U0, 10.0, torque=lambda t, q, u: 0 * q,
                   progress=lambda t: False)
    assert 0.0 < run.t[-1] < 5.0
    run = simulate(robot, Q0, 0 * U0, 10.0, torque=lambda t, q, u: 0 * q, sample=10.0,
                   progress=lambda t: False)
    assert 0.0 < run.t[-1] < 5.0 and len(run.t) == 2  # the end is in, sampled or not


def test_a_function_of_torque_passes_the_same_limits_as_zero_torque():
    robot = pendulum(limits=Limits(-0.5, 0.5, 2.0, 10.0))
    asked = simulate(robot, [0.4], [1.0], 3.0, torque=lambda t, q, u: [0.0])
    zero = simulate(robot, [0.4], [1.0], 3.0, torque=None)
    assert asked.limit_events == zero.limit_events and len(zero.limit_events) > 2


def test_files_keep_every_number(robot, tmp_path):
    run = simulate(pendulum(limits=Limits(-0.5, 0.5)), [0.4], [1.0], 0.5)
    run.save_npz(tmp_path / 'run.npz')
    back = Trajectory.load_npz(tmp_path / 'run.npz')
    for name in ('t', 'q', 'u', 'udot', 'tau', 'energy'):
        np.testing.assert_array_equal(getattr(back, name), getattr(run, name))
    assert back.joint_names == run.joint_names and back.limit_events == run.limit_events
    run.save_csv(tmp_path / 'run.csv')
    table = np.genfromtxt(tmp_path / 'run.csv',
                          delimiter=',', names=True, deletechars='')
    np.testing.assert_array_equal(table['q.hinge'], run.q[:, 0])
    np.testing.assert_array_equal(table['potential_energy'], run.energy[:, 1])
    (tmp_path / 'other.npz').write_bytes(b'nothing')
    with pytest.raises(InputError, match=r'other\.npz'):
        Trajectory.load_npz(tmp_path / 'other.npz')


@pytest.mark.parametrize('change, words', [
    ({'q0': np.zeros(3)}, ['q0', '(3,)']),
    ({'q0': np.zeros((2, 4))}, ['q0', '(2, 4)']),
    ({'u0': [0, np.nan, 0, 0]}, ['u0[1]', 'nan']),
    ({'duration': -1.0}, ['duration', '-1 s', 'positive']),
    ({'duration': np.inf}, ['duration', 'inf']),
    ({'duration': 'long'}, ['duration', "'long'"]),
    ({'step': 0.0}, ['step', '0 s']),
    ({'step': 3e-4}, ['duration', 'whole number of steps']),
    ({'sample': 1e308}, ['sample', 'whole number of steps']),
    ({'sample': 1.5e-3}, ['sample', 'whole number']),
    ({'duration': 1e9}, ['duration', 'at most 100000000']),
    ({'duration': 1e4, 'sample': 1e-3}, ['10000000 steps', 'at most 1000000']),
    ({'torque': np.zeros((5, 4))}, ['torque: 5 rows', '100']),
    ({'torque': np.zeros(3)}, ['torque', '(3,)']),
    ({'torque': lambda t, q, u: [1.0]}, ['torque at 0 s', '(1,)']),
    ({'torque': lambda t, q, u: [np.nan] * 4}, ['torque at 0 s', 'nan']),
    ({'u0': [1e200] * 4}, ['the state diverged (is not finite)', 'joint']),
])
def test_bad_requests_are_refused_in_words(robot, change, words):
    request = {'q0': Q0, 'u0': U0, 'duration': 0.1, **change}
    with pytest.raises(InputError) as error:
        simulate(robot, **request)
    for word in words:
        assert word in str(error.value)


def test_a_motion_of_other_joints_is_refused(robot):
    motion = Motion.from_points([0.0, 1.0], [[0.0], [1.0]], joint_names=['x'])
    with pytest.raises(InputError, match=r"\['x'\]; expected \['joint0'"):
        simulate(robot, Q0, U0, 0.1, torque=ComputedTorque(robot, motion, 1.0, 1.0))


def test_gravity_and_payload_are_those_of_the_moment():
    robot = Robot(MODEL, payload_frame='frame2')
    fallen = simulate(robot, Q0, 0 * U0, 0.1).q[-1]
    robot.parameters.gravity = np.zeros(3)
    np.testing.assert_allclose(simulate(robot, Q0, 0 * U0, 0.1).q[-1], Q0, atol=1e-12)
    robot.parameters.gravity = MODEL.gravity
    robot.parameters.payload = Inertial(2.0, [0.1, 0.0, 0.0])
    assert np.abs(simulate(robot, Q0, 0 * U0, 0.1).q[-1] - fallen).max() > 1e-5


def test_a_second_simulation_looks_its_kernels_up(robot, monkeypatch):
    q = np.full(robot.n, 0.1)
    u = np.zeros(robot.n)
    first = simulate(robot, q, u, 0.01)
    monkeypatch.setattr(type(robot.kernels), 'compiled', None)  # which reads functions
    np.testing.assert_array_equal(simulate(robot, q, u, 0.01).q, first.q)


def test_a_step_whose_watch_is_left_out_is_the_same_step():
    robot = four_bar('crank')
    equations = copy(robot.equations)
    equations.watched = False
    unwatched = Robot(robot.model, **robot.options)
    kernels = KernelSet(equations, None, unwatched.parameters.block)
    # Robots refuse assignments.
    vars(unwatched).update(equations=equations, kernels=kernels)
    q = at_angle(0.8)
    ends = []
    for one in (robot, unwatched):
        source = torque_input(one, 1e-2, 100, None, None, 'rk4')
        states = np.ones((1, 101, len(state_names(one))))
        states[0, 0, :4] = *q, 2.0
        source.advance(states, 0)
        ends.append(states[0, -1, :4])
    np.testing.assert_allclose(ends[1], ends[0], rtol=1e-12)
    assert np.abs(robot.constraint_residual(ends[0][:3])).max() < 1e-9
