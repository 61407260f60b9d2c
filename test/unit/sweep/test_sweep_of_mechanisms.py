"""Sweeps with chosen speeds, constraints, functions of time and ball joints."""

from dataclasses import replace
from functools import cache

from kane_dynamics import (ComputedTorque, ConstraintError, Drive, InputError,
                           ModelBuilder, Motion, Prescribed, Robot, rod, simulate,
                           Speeds, with_drives)
from kane_dynamics.cli.commands.sweep_command import read_sweep
from kane_dynamics.model.inertial import Inertial
from kane_dynamics.sweep import read_table, run_sweep, Sweep
from kane_dynamics.sweep.simulator import Simulator
from kinds_of_mechanism import case
import numpy as np
from palletizer import DRIVEN, LOOPS, palletizer, URDF
import pytest
import yaml

STEP = 1e-3
MOTION = Motion.from_points([0.0, 0.1, 0.2], [[0.8], [0.9], [1.2]],
                            joint_names=('crank',))
START = {'crank': 0.8, 'coupler': -0.3, 'rocker': -1.5}


@cache
def linkage(**options):
    """Return the four-bar linkage, by the speed of its crank."""
    robot = case('closed loop').robot
    return Robot(robot.model, **{**robot.options, 'independent': ['crank'],
                                 'payload_frame': None, 'wrench_frames': (), **options})


def columns(sweep):
    """Return the rows of a sweep of one chunk."""
    return Simulator(sweep).columns(0)


def rows_of(found, name, names):
    """Return columns of a quantity, (N, names)."""
    return np.stack([found[f'{name}.{x}'] for x in names], axis=1)


@pytest.mark.parametrize('integrator', ['rk4', 'implicit'])
def test_trials_of_a_loop_are_closed_and_equal_simulate_with_computed_torque(integrator):
    robot = linkage()
    rows = columns(Sweep(
        robot, samples=12, seed=3, duration=0.2, step=STEP, motion=MOTION,
        integrator=integrator, q0={**START, 'crank': {'uniform': [0.5, 1.1]}},
        u0={'crank': {'normal': [0.0, 1.0]}},
        controller={'kind': 'computed_torque', 'kp': 50.0,
                    'kd': {'choice': [10.0, 15.0]}}))
    assert rows['ok'].all() and rows['energy_closes'].all()
    assert len(set(rows['q0.crank'])) == 12
    for k in range(12):
        start = robot.closed_configuration(
            [rows[f'q0.{name}'][k] for name in robot.joint_names], fixed=['crank'])
        assert start[0] == rows['q0.crank'][k]
        law = ComputedTorque(robot, MOTION, kp=50.0, kd=rows['kd'][k])
        run = simulate(robot, start, [rows['u0.crank'][k]], 0.2, step=STEP, torque=law,
                       integrator=integrator, sample=STEP)
        np.testing.assert_allclose(rows_of(rows, 'q', robot.joint_names)[k], run.q[-1],
                                   atol=1e-10)
        assert abs(rows['u.crank'][k] - run.u[-1, 0]) < 1e-9
        assert abs(rows['peak_torque.crank'][k] - np.abs(run.tau[:-1]).max()) < 1e-8
        error = (MOTION.sample(run.t)[0] - run.q[:, :1])[:, 0]**2
        rms = np.sqrt(np.trapezoid(error, run.t) / 0.2)
        assert abs(rows['rms_error.crank'][k] - rms) < 1e-4 * max(rms, 1e-2)


def test_trials_stay_on_the_branch_of_a_closed_start():
    one = linkage()
    first = one.closed_configuration((0.8, 0.0, -1.5), fixed=['crank'])
    other_branch = one.closed_configuration((0.8, -2.5, 2.0), fixed=['crank'])
    robot = linkage(configuration=tuple(first.tolist()))
    names = robot.joint_names
    for start in (first, other_branch):
        rows = columns(Sweep(robot, samples=1, duration=STEP, step=STEP,
                             q0=dict(zip(names, start.tolist()))))
        np.testing.assert_allclose(rows_of(rows, 'q', names)[0], start, atol=1e-3)
    moved = columns(Sweep(robot, samples=1, duration=STEP, step=STEP, q0={'crank': 2.0}))
    np.testing.assert_allclose(rows_of(moved, 'q', names)[0], robot.closed_configuration(
        (2.0, 0.0, 0.0), fixed=['crank']), atol=1e-3)


def test_gravity_compensation_with_the_payload_known_holds_the_linkage():
    """At rest without friction it stays; without knowing its load it falls."""
    robot = linkage(friction=False)
    rows = columns(Sweep(robot, samples=2, duration=0.1, step=STEP, q0=START, payload={
        'frame': 'tool', 'mass': 2.0, 'com': [0.1, 0.0, 0.2]}, controller={
            'kind': 'gravity_compensation', 'known_payload': {'grid': [0.0, 1.0]}}))
    carried = linkage(friction=False, payload_frame='tool').copy()
    carried.parameters.payload = Inertial(2.0, [0.1, 0.0, 0.2], np.zeros((3, 3)))
    start = robot.closed_configuration([START[name] for name in robot.joint_names],
                                       fixed=['crank'])
    for k, known in enumerate((robot, carried)):
        run = simulate(carried, start, [0.0], 0.1, step=STEP,
                       torque=lambda t, q, u, known=known: known.gravity_force(q))
        # `simulate` holds the torque of a function during each step.
        assert abs(rows['u.crank'][k] - run.u[-1, 0]) < 2e-2 * abs(run.u[-1, 0]) + 1e-9
    assert abs(rows['u.crank'][0] - rows['u.crank'][1]) > 0.1


def test_torques_beyond_effort_limits_are_events_where_they_are_those_of_actuators():
    events = []
    for actuated in (None, ('crank',), ('rocker',)):
        robot = linkage(actuated=actuated).copy()
        robot.limits = replace(robot.limits, effort=np.full(3, 0.1))
        rows = columns(Sweep(robot, samples=1, duration=0.01, step=STEP, q0=START,
                             controller='gravity_compensation'))
        assert rows['peak_torque.crank'][0] > 0.1
        events.append(rows['limits'][0])
    assert events == ['crank effort', 'crank effort', '']


def test_random_quaternions_are_uniform_rotations_of_unit_length():
    robot = case('free and ball joints').robot
    quaternion = [f'craft/q{x}' for x in 'xyzw']
    rows = columns(Sweep(robot, samples=200, duration=1e-3, step=1e-3,
                         q0={name: {'normal': [0.0, 1.0]} for name in quaternion}))
    ends = rows_of(rows, 'q', quaternion)
    assert rows['ok'].all()
    np.testing.assert_allclose(np.linalg.norm(ends, axis=1), 1.0, atol=1e-12)
    assert np.abs((ends**2).mean(axis=0) - 0.25).max() < 0.06
    assert not any(name.startswith('rms_error.craft/q') for name in rows)


def test_an_open_start_and_a_passed_singularity_are_rows_with_the_reason():
    robot = linkage(independent=('rocker',))
    q = case('closed loop').q
    u = -8.0
    q0 = dict(zip(robot.joint_names, q.tolist()))
    rows = columns(Sweep(robot, samples=2, duration=1.0, step=STEP, q0=q0,
                         u0={'rocker': {'grid': [0.0, u]}}))
    # `simulate` goes on in other speeds, sweeps have one choice.
    assert np.isfinite(simulate(robot, q, [u], 1.0, step=STEP).q).all()
    assert not rows['ok'][1] and np.isnan(rows['q.rocker'][1])
    assert 'the independent speeds rocker become ill-conditioned' in rows['error'][1]
    far = columns(Sweep(linkage(independent=('rocker',)), samples=2, duration=0.01,
                        step=STEP, q0={**START, 'rocker': {'grid': [-1.5, 1e-3]}}))
    assert far['ok'].tolist() == [True, False]
    assert far['error'][1].startswith('q0: ') and 'pin' in far['error'][1]


def jumping(t):
    """Return a position that jumps at half a second."""
    return np.where(t < 0.005, 0.1, 0.3)


def steady(t):
    """Return a position."""
    return 0.3 * np.sin(2.0 * t)


def driven(function):
    """Return an arm whose joint `fore` follows a function of time."""
    return Robot(case('time-dependent').robot.model,
                 constraints=[Prescribed('fore', function, name='drive')])


def test_functions_of_time_start_at_t0_and_must_not_jump(tmp_path):
    robot = driven(steady)
    sweep = Sweep(robot, samples=2, duration=0.01, step=STEP, t0=0.7, u0={'upper': 1.0})
    assert run_sweep(sweep, tmp_path / 'steady', workers=1).failed == 0
    table = read_table(tmp_path / 'steady')
    start = robot.closed_configuration(np.zeros(2), t=0.7)
    run = simulate(robot, start, [1.0], 0.01, step=STEP, t0=0.7)
    assert abs(table['u.upper'].to_pylist()[0] - run.u[-1, 0]) < 1e-11
    assert abs(table['q.fore'].to_pylist()[0] - steady(0.71)) < 1e-11
    with pytest.raises(ConstraintError, match=r'drive.*jumps'):
        run_sweep(Sweep(driven(jumping), samples=2, duration=0.01, step=STEP),
                  tmp_path / 'jump', workers=1)


def test_processes_compute_the_same_rows_and_a_table_knows_its_robot(tmp_path):
    def sweep(**options):
        return Sweep(linkage(**options), samples=6, duration=0.01, step=STEP, chunk=2,
                     q0=START, u0={'crank': {'uniform': [0.0, 1.0]}})
    run_sweep(sweep(), tmp_path / 'one', workers=1)
    run_sweep(sweep(), tmp_path / 'two', workers=2)
    assert read_table(tmp_path / 'one').equals(read_table(tmp_path / 'two'))
    heavy = linkage().copy()
    heavy.parameters.gravity = [0.0, 0.0, -20.0]
    heavier = Sweep(heavy, samples=6, duration=0.01, step=STEP)
    assert len({sweep().digest, sweep(friction=False).digest, heavier.digest,
                Sweep(linkage(), samples=6, duration=0.01, step=STEP).digest}) == 4
    assert columns(heavier)['u.crank'][0] != columns(Sweep(
        linkage(), samples=6, duration=0.01, step=STEP))['u.crank'][0]


@pytest.mark.parametrize(('given', 'words'), [
    ({'model': None}, 'model: a NoneType; expected a Model or a Robot'),
    ({'motion': Motion.from_points([0.0, 1.0], [[0.8, 0.0]] * 2,
                                   joint_names=('crank', 'x'))},
     r"motion: of the joints \['crank', 'x'\]; expected \['crank'\], or all"),
    ({'q0': {'elbow': 1.0}}, "q0: no joint 'elbow'; expected crank, coupler, rocker"),
    ({'u0': {'rocker': 1.0}}, "u0: no joint 'rocker'; expected crank"),
    ({'controller': {'kind': 'computed_torque', 'kp': [1.0, 2.0]}},
     'kp: 2 entries; expected 1'),
    ({'t0': 'now'}, "t0: 'now'; expected a finite number")])
def test_wrong_entries_are_refused_by_name(given, words):
    with pytest.raises(InputError, match=words):
        Sweep(**{'model': linkage(), 'samples': 1, 'q0': START, **given})


def test_robots_that_cannot_be_swept_are_refused_by_name(tmp_path):
    loaded = linkage(payload_frame='tool').copy()
    loaded.parameters.payload = Inertial(1.0, np.zeros(3), np.zeros((3, 3)))
    with pytest.raises(InputError,
                       match='model: a robot that carries a payload; expected one'):
        Sweep(loaded, samples=1)
    with pytest.raises(InputError,
                       match=r'computed_torque with ball joints.*expected gravity'):
        Sweep(case('free and ball joints').robot,
              samples=1, controller='computed_torque')
    with pytest.raises(InputError, match='functions of a module'):
        run_sweep(Sweep(driven(lambda t: 0.1 * t), samples=1), tmp_path / 'lambda')


def test_a_file_names_constraints_and_the_sweep_is_that_of_the_robot(tmp_path):
    values = {'samples': 3, 'duration': 0.02, 'step': STEP,
              'friction': {'uniform': [0.5, 2.0]},
              'q0': dict(zip(DRIVEN, (0.2, 0.3, -0.1, 0.5))), 'payload': {
                  'frame': 'tool', 'mass': {'uniform': [0.0, 40.0]}},
              'controller': 'gravity_compensation'}
    path = tmp_path / 'sweep.yaml'
    path.write_text(
        yaml.safe_dump({'urdf': str(URDF), 'constraints': str(LOOPS), **values}))
    read = columns(read_sweep(path))
    rows_of_robot = columns(Sweep(palletizer(), **values))
    assert read['ok'].all() and list(read) == list(rows_of_robot)
    for name in rows_of_robot:
        assert list(read[name]) == list(rows_of_robot[name])
    ends = rows_of(rows_of_robot, 'q', palletizer().joint_names)
    assert np.abs(palletizer().constraint_residual(ends)).max() < 1e-9


def test_factors_on_friction_leave_the_damping_of_drives():
    """It acts between motor and link alike, and belongs to neither."""
    builder = ModelBuilder('elastic', gravity=(0, 0, 0))
    builder.body('bar', joint='pivot', axis=(0, -1, 0),
                 inertial=rod(2.0, (0, 0, 0), (0.5, 0, 0)))
    robot = Robot(with_drives(builder.model(), {
        'pivot': Drive(40.0, damping=2.0, rotor_inertia=0.1)}))
    start = [0.0, 0.2]
    swept = Simulator(
        Sweep(robot, samples=1, duration=0.2, step=1e-3, q0=start, u0=[0.0, 0.0],
              integrator='rk4', friction={'pivot': 0.0, 'pivot_motor': 3.0}))
    rows = swept.columns(0)
    run = simulate(robot, start, [0.0, 0.0], 0.2, step=1e-3, integrator='rk4')
    assert abs(run.u[-1]).max() > 1e-2
    np.testing.assert_allclose([rows[f'q.{name}'][0] for name in robot.joint_names],
                               run.q[-1], atol=1e-12)


def test_trials_with_chosen_speeds_begin_with_the_velocity_of_their_motion():
    tree = Robot(linkage().model)
    t = np.array([0.0, 0.2])
    motion = Motion.from_points(t, [[0.1, 0.2, 0.3], [0.5, 0.1, 0.4]],
                                [[1.0, -2.0, 0.5], [0.0, 0.0, 0.0]],
                                joint_names=tree.joint_names)
    # The speeds are twice the joint rates.
    robot = Robot(tree.model, speeds=Speeds(lambda q, t: 2.0 * np.eye(3)),
                  actuated=tree.joint_names)
    rows = columns(Sweep(robot, samples=2, duration=0.01, step=STEP, motion=motion,
                         controller={'kind': 'computed_torque'}))
    np.testing.assert_allclose(rows_of(rows, 'q0', robot.joint_names)[0],
                               [0.1, 0.2, 0.3])
    np.testing.assert_allclose(rows_of(rows, 'u0', robot.speed_names)[0],
                               [2.0, -4.0, 1.0])
