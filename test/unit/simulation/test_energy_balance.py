"""Every simulation checks its energy balance and warns where it does not close."""

from functools import partial
import warnings

from kane_dynamics import (absolute_rates, ComputedTorque, Coupling,
                           FlexibleLink, Inertial, knife_edge, load_urdf, ModelBuilder,
                           Motion, Prescribed, Robot, rod, simulate)
from kane_dynamics._util.resources import resource_path
from kane_dynamics.errors import ModelWarning
from kane_dynamics.mechanics.constraints.speeds import Speeds
from kane_dynamics.simulation.energy_balance import EnergyBalance
from kane_dynamics.sweep import read_table, run_sweep, Sweep
from mechanisms import random_model
import numpy as np
import pytest

URDF = resource_path('urdf', 'two_link.urdf')
# rad, rad/s
SLOPE = 0.3
TURN = 1.7


def pendulum(**joint):
    b = ModelBuilder()
    b.body('a', axis=(0, 1, 0), inertial=rod(1, (0, 0, 0), (0.5, 0, 0)), **joint)
    b.body('b', 'a', axis=(0, 1, 0), at=(0.5, 0, 0),
           inertial=rod(0.5, (0, 0, 0), (0.4, 0, 0)),
           **joint)
    return b.model()


def sleigh():
    """Return a knife edge on an incline whose speed along x dies as it turns."""
    b = ModelBuilder(gravity=(0, 9.81 * np.sin(SLOPE), -9.81 * np.cos(SLOPE)))
    b.body('body', kind='planar', inertial=Inertial(2.0, (0, 0, 0), 0.4 * np.eye(3)))
    return Robot(b.model(), constraints=[knife_edge('body', (0, 1, 0))],
                 independent=['body/x', 'body/rz'])


def coarse():
    """Simulate a pendulum in steps that are too long, though it does not diverge."""
    return simulate(Robot(pendulum()), [0.3, -0.2], [9.0, -6.0], 6.4, step=0.08)


def result_and_warnings(function):
    """Return what a function returns and the warnings of it."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter('always')
        result = function()
    return result, [str(warning.message) for warning in caught]


@pytest.mark.parametrize('step', [1e-3, 1e-4])
def test_singular_speeds_do_not_break_the_balance(step):
    # The named speeds, and those that the library chooses, are singular at 0.924 s.
    changing = Robot(sleigh().model, constraints=sleigh().mechanism.constraints)
    for robot in (sleigh(), changing):
        run, texts = result_and_warnings(
            partial(simulate, robot, np.zeros(3), [0.0, TURN], 3.0, step=step))
        assert run.warnings == () and texts == []


@pytest.mark.parametrize('integrator', ['rk4', 'implicit'])
def test_a_step_that_is_too_long_without_divergence_is_warned_of(integrator):
    robot = Robot(pendulum())
    step = 0.08 if integrator == 'rk4' else 0.03
    for N in (1, 3):
        q = [0.3, -0.2]
        u = [9.0, -6.0]
        start = (q, u) if N == 1 else (np.tile(q, (N, 1)), np.tile(u, (N, 1)))
        run, texts = result_and_warnings(partial(simulate, robot, *start, 80 * step,
                                                 step=step, integrator=integrator))
        assert len(texts) == 1
        assert 'energy balance' in texts[0]
        assert 'horten the step' in texts[0]
        energy = run.energy.sum(axis=-1)
        gained = np.abs(energy - energy[..., :1]).max()
        assert gained > 1e-3 * np.abs(run.energy[..., 0]).max()
        fine, texts = result_and_warnings(partial(simulate, robot, *start, 1.0,
                                                  integrator=integrator))
        assert fine.warnings == () and texts == []


def test_a_wrong_constraint_force_or_torque_would_not_close():
    """The balance sees each of its terms: without one of them it does not close."""
    robot = Robot(pendulum(damping=0.05, friction=0.02))
    h = 1e-3
    tau = np.array([0.4, -0.1])
    run = simulate(robot, [0.3, -0.2], [1.0, 2.0], 1.0, step=h, torque=tau, sample=h)
    states = np.concatenate([run.q, run.u], axis=1)[None]
    for held, faulty in ((tau, False), (0.9 * tau, True)):
        balance = EnergyBalance(robot, h, states[:, 0], 'rk4')
        balance.update(states, 0, held[None, None])
        assert np.isfinite(balance.began[0]) == faulty
    balance = EnergyBalance(Robot(pendulum(), friction=False), h, states[:, 0], 'rk4')
    balance.update(states, 0, tau[None, None])
    assert np.isfinite(balance.began[0])


def table(n, steps):
    return 2.0 * np.random.default_rng(3).normal(size=(steps, n))


@pytest.mark.parametrize(('seed', 'step'),
                         [*((seed, 1e-2) for seed in range(6)), (3, 1e-3)])
def test_no_alarm_on_random_mechanisms(seed, step):
    n = 2 + seed % 4
    rng = np.random.default_rng(seed)
    model = random_model(seed, n)
    q, u = rng.uniform(-1.0, 1.0, (2, n))
    steps = round(1.0 / step)
    for robot in (
            Robot(model, friction=False), Robot(model, speeds=absolute_rates(model)),
            Robot(model, constraints=[Coupling(model.coordinate_names[1],
                                               {model.coordinate_names[0]: 0.5})])):
        start = (robot.closed_configuration(q),
                 u[:robot.n]) if robot.constraint_names else (q, u)
        for torque in (None, table(robot.n, steps), lambda t, q, u: -0.5 * u):
            _, texts = result_and_warnings(
                partial(simulate, robot, *start, 1.0, step=step, torque=torque))
            assert not [text for text in texts if 'energy balance' in text], texts


def test_no_alarm_where_constraints_and_speeds_put_energy_in():
    driven = Robot(pendulum(),
                   constraints=[Prescribed('a', lambda t: 0.8 * np.sin(3.0 * t))])
    offset = Robot(pendulum(),
                   speeds=Speeds(lambda q, t: np.eye(2), lambda q, t: np.array(
                       [np.sin(q[1]), 0.4 * np.cos(2.0 * t)]), ('v', 'w')))
    for robot, start in ((driven, ([0.0, 0.2], [0.5])),
                         (offset, ([0.1, 0.2], [0.5, -0.3]))):
        for torque in (None, table(robot.n, 2000), lambda t, q, u: -0.1 * u):
            run, texts = result_and_warnings(
                partial(simulate, robot, *start, 2.0, torque=torque))
            assert texts == []
            assert robot is offset or np.ptp(run.energy.sum(axis=1)) > 0.1


def test_no_alarm_where_joints_stick_beams_swing_and_motions_are_followed():
    arm = Robot(load_urdf(URDF, supplement={'joints': {
        'joint1': {'friction': 5.0, 'friction_speed': 1e-4},
        'joint2': {'friction': 2.0}}}))
    motion = Motion.from_points([0.0, 1.0, 2.0], [[0, 0], [1, -1], [0, 0]],
                                joint_names=arm.joint_names)
    b = ModelBuilder()
    b.beam('arm', 'world',
           FlexibleLink(length=1.0, density=0.8, stiffness=120.0, modes=(0, 2)),
           axis=(0, -1, 0), stiffness=80.0, damping=2.0)
    beam = Robot(b.model())
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        simulate(arm, [0.3, 0.2], [1.0, -1.0], 3.0, integrator='implicit')
        simulate(arm, [0.0, 0.0], [0.0, 0.0], 2.0, integrator='implicit',
                 torque=ComputedTorque(arm, motion, 400.0, 40.0))
        simulate(beam, [0.3, 0.0, 0.0], [0.0, 0.0, 0.0], 2.0, integrator='implicit')
        simulate(beam, [0.3, 0.0, 0.0], [0.0, 0.0, 0.0], 0.5, step=1e-4)


def test_a_sweep_has_the_energy_warning_of_every_trial(tmp_path):
    pytest.importorskip('pyarrow')
    model = load_urdf(URDF)
    for step, closes in ((1e-3, True), (0.1, False)):
        sweep = Sweep(model, samples=4, duration=20.0 * step, step=step,
                      controller='none', u0=[8.0, -9.0])
        run_sweep(sweep, tmp_path / str(step), workers=1)
        rows = read_table(tmp_path / str(step))
        assert rows['energy_closes'].to_pylist() == [closes] * 4


def test_a_saved_trajectory_keeps_its_warnings(tmp_path):
    run, _ = result_and_warnings(coarse)
    run.save_npz(tmp_path / 'run.npz')
    assert type(run).load_npz(tmp_path / 'run.npz').warnings == run.warnings != ()


def test_the_simulated_arm_warns_of_energy_but_not_of_stops():
    pytest.importorskip('rclpy')
    from kane_dynamics.ros.plant.simulated_arm import SimulatedArm
    for step, warned in ((1e-3, False), (0.1, True)):
        arm = SimulatedArm(Robot(load_urdf(URDF)), step)
        arm.u[:] = [8.0, -9.0]
        arm.energy.restart(np.concatenate([arm.q, arm.u]))
        for _ in range(2500 if not warned else 30):
            arm.step(np.zeros(2))
        arm.energy.close()
        assert bool(arm.energy.warning) == warned, arm.energy.warning
    assert 'energy balance' in arm.energy.warning


def test_the_warning_is_one_of_the_packages_own():
    with pytest.warns(ModelWarning, match='energy balance'):
        coarse()
