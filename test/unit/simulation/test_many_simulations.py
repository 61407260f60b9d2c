"""Promises of many initial states at once: the numbers of one, refusals."""

from dataclasses import replace
import re

from kane_dynamics import ComputedTorque, InputError, Motion, Robot, simulate, Trajectory
from kane_dynamics.native.backends import llvm_simd
from kane_dynamics.native.runtime import loops, threads
from kane_dynamics.simulation import limit_events, simulate as simulation, stepping
from kane_dynamics.simulation.simulate import compile_simulation
from kinds_of_mechanism import case, KINDS
from linkages import four_bar
from mechanisms import random_model
import numpy as np
import pytest

MODEL = random_model(11, 4, mimics=1)
W = llvm_simd.width()
N = 2 * W + 3
STEPS = 40
ARRAYS = ('q', 'u', 'udot', 'tau', 'energy')
rng = np.random.default_rng(4)
Q0, U0 = rng.uniform(-1.0, 1.0, (2, N, 4))


@pytest.fixture(scope='module')
def robot():
    """Return a robot with limits, springs and friction."""
    return Robot(MODEL)


def law(robot):
    """Return computed torque on some motion."""
    motion = Motion.from_points([0.0, 0.02, 0.04],
                                np.cumsum(rng.normal(size=(3, 4)), axis=0),
                                joint_names=robot.joint_names)
    return ComputedTorque(robot, motion, 300.0, 30.0)


TORQUES = {
    'none': lambda robot: None,
    'constant': lambda robot: rng.normal(size=4),
    'one table for all': lambda robot: rng.normal(size=(STEPS, 4)),
    'a table each': lambda robot: rng.normal(size=(N, STEPS, 4)),
    'a longer table each': lambda robot: rng.normal(size=(N, STEPS + 5, 4)),
    'computed torque': law,
}


@pytest.mark.parametrize('kind', TORQUES)
def test_each_of_many_simulations_is_the_one_alone(robot, kind):
    torque = TORQUES[kind](robot)
    many = simulate(robot, Q0, U0, STEPS * 1e-3, torque=torque, sample=3e-3)
    assert many.q.shape == (N, STEPS // 3 + 2, 4)
    assert many.energy.shape == (N, STEPS // 3 + 2, 2)
    for k in range(N):
        row_torque = torque[k] if np.ndim(torque) == 3 else torque
        alone = simulate(robot, Q0[k], U0[k], STEPS * 1e-3,
                         torque=row_torque, sample=3e-3)
        among = many.state(k)
        np.testing.assert_array_equal(among.t, alone.t)
        for name in ARRAYS:
            expected = getattr(alone, name)
            np.testing.assert_allclose(getattr(among, name), expected, rtol=0.0,
                                       atol=1e-11 * np.abs(expected).max())
        assert ([(e.t, e.joint, e.limit, e.state) for e in among.limit_events]
                == [(e.t, e.joint, e.limit, None) for e in alone.limit_events])


def test_a_simulation_does_not_depend_on_the_others_or_on_threads(robot, monkeypatch):
    monkeypatch.setenv(threads.VARIABLE, '1')
    torque = rng.normal(size=(N, STEPS, 4))
    whole = simulate(robot, Q0, U0, STEPS * 1e-3, torque=torque)
    part = simulate(robot, Q0[5:W + 6], U0[5:W + 6], STEPS * 1e-3,
                    torque=torque[5:W + 6])
    monkeypatch.setenv(threads.VARIABLE, '3')
    monkeypatch.setattr(threads, 'THREAD_WORK', 1e-12)
    threaded = simulate(robot, Q0, U0, STEPS * 1e-3, torque=torque)
    for name in ARRAYS:
        np.testing.assert_array_equal(getattr(part, name), getattr(whole, name)[5:W + 6])
        np.testing.assert_array_equal(getattr(threaded, name), getattr(whole, name))
    assert threaded.limit_events == whole.limit_events


@pytest.mark.parametrize('steps', [1, 3, 7, 1000])
def test_a_simulation_in_chunks_equals_one_at_once(robot, monkeypatch, steps):
    expected = simulate(robot, Q0, U0, STEPS * 1e-3, torque=law(robot))
    torque = rng.normal(size=(N, STEPS, 4))
    expected = simulate(robot, Q0, U0, STEPS * 1e-3, torque=torque)
    monkeypatch.setattr(stepping, 'CHUNK_BYTES', steps * N * 8 * 8)
    run = simulate(robot, Q0, U0, STEPS * 1e-3, torque=torque)
    for name in ARRAYS:
        np.testing.assert_array_equal(getattr(run, name), getattr(expected, name))
    assert run.limit_events == expected.limit_events


def test_every_passing_of_a_limit_is_an_event_as_in_one_simulation(robot):
    fast = 6.0 * U0
    many = simulate(robot, Q0, fast, 1.5)
    kinds = {event.limit for event in many.limit_events}
    assert kinds == {'lower', 'upper', 'velocity'} and len(many.limit_events) > 5 * N
    for k in range(N):
        alone = simulate(robot, Q0[k], fast[k], 1.5).limit_events
        among_many = many.state(k).limit_events
        assert len(among_many) == len(alone)
        for event, expected in zip(among_many, alone):
            assert (event.t, event.joint, event.limit) == (
                expected.t, expected.joint, expected.limit)
    event = next(e for e in many.limit_events if e.state == 2)
    assert str(event).startswith('simulation 2: at ')
    assert [e.t for e in many.limit_events] == sorted(e.t for e in many.limit_events)


def test_too_many_events_are_refused_not_dropped(robot, monkeypatch):
    monkeypatch.setattr(limit_events, 'MOST_EVENTS', 10)
    with pytest.raises(InputError, match='limit events: more than 10 by'):
        simulate(robot, Q0, 6.0 * U0, 1.5)


def test_progress_is_reported_and_can_end_many_simulations(robot):
    reported = []
    simulate(robot, Q0, U0, 1.0, progress=reported.append)
    assert reported == sorted(reported)
    assert reported[-1] == pytest.approx(1.0)
    assert len(reported) > 1
    run = simulate(robot, Q0, U0, 100.0, progress=lambda t: False)
    assert 0.0 < run.t[-1] < 10.0 and run.q.shape == (N, len(run.t), 4)
    alone = simulate(robot, Q0[1], U0[1], run.t[-1])
    np.testing.assert_allclose(run.q[1, -1], alone.q[-1], atol=1e-9)


@pytest.mark.parametrize('kind', KINDS)
def test_no_initial_states_are_simulated_with_every_kind_of_mechanism(kind):
    robot = case(kind).robot
    none = simulate(robot, np.zeros((0, robot.n_q)), np.zeros((0, robot.n)), 0.01)
    rows = len(robot.constraint_names)
    joints = len(robot.joint_names)
    assert none.q.shape == (0, 11, robot.n_q)
    assert none.u.shape == none.udot.shape == none.tau.shape == (0, 11, robot.n)
    assert none.constraint_forces.shape == none.constraint_residual.shape == (0, 11,
                                                                              rows)
    assert none.stop_forces.shape == (0, 11, joints)


def test_no_and_one_initial_state_are_many_too(robot):
    none = simulate(robot, Q0[:0], U0[:0], 0.01)
    assert none.q.shape == (0, 11, 4) and none.energy.shape == (0, 11, 2)
    one = simulate(robot, Q0[:1], U0[:1], 0.01)
    assert one.q.shape == (1, 11, 4)


def test_without_a_sample_time_rows_get_fewer_as_states_get_more(robot, monkeypatch):
    monkeypatch.setattr(simulation, 'MOST_SAMPLES', 12 * N)
    run = simulate(robot, Q0, U0, 0.1)
    assert 2 < len(run.t) <= 12


@pytest.mark.parametrize('change, words', [
    ({'u0': U0[0]}, ['q0', f'({N}, 4)', 'u0', '(4,)', '(N, 4)']),
    ({'u0': U0[:-1]}, [f'({N - 1}, 4)']),
    ({'q0': np.where(np.arange(N)[:, None] == 3, np.nan, Q0)},
     ['q0[3, 0]', "'joint0'", 'nan']),
    ({'torque': lambda t, q, u: q}, ['a function', f'{N} initial states']),
    ({'torque': np.zeros((N - 1, 100, 4))},
     [f'({N - 1}, 100, 4)', f'each of the {N} states']),
    ({'torque': np.zeros((N, 99, 4))}, ['torque: 99 rows', '100']),
    ({'torque': np.zeros((N, 100, 3))}, ['torque', '(100, 4)']),
    ({'torque': np.full((N, 100, 4), np.nan)}, ['torque[0, 0, 0]', 'nan']),
    ({'duration': 1e3, 'sample': 1e-3},
     [f'for each of {N} initial states', 'at most 1000000 together', 'fewer states']),
])
def test_bad_requests_are_refused_in_words(robot, change, words):
    with pytest.raises(InputError) as error:
        simulate(robot, **{'q0': Q0, 'u0': U0, 'duration': 0.1, **change})
    for word in words:
        assert word in str(error.value)


def test_the_simulation_that_diverges_is_named(robot):
    wild = U0.copy()
    wild[W + 1] = 1e200
    with pytest.raises(InputError,
                       match=rf'simulation {W + 1}: the state diverged .* at'):
        simulate(robot, Q0, wild, 0.1)


def test_files_keep_every_number_and_pictures_need_one_motion(robot, tmp_path):
    run = simulate(robot, Q0, 6.0 * U0, 0.5)
    run.save_npz(tmp_path / 'run.npz')
    back = Trajectory.load_npz(tmp_path / 'run.npz')
    for name in ('t', *ARRAYS):
        np.testing.assert_array_equal(getattr(back, name), getattr(run, name))
    assert back.limit_events == run.limit_events
    for what in ('save_csv', 'plot'):
        with pytest.raises(InputError,
                           match=rf'{what}: trajectory of \d+ motions.*state\(k\)'):
            getattr(run, what)(tmp_path / 'x')
    run.state(-1).save_csv(tmp_path / 'last.csv')
    assert run.state(-1).limit_events == run.state(N - 1).limit_events
    for trajectory, k in ((run, N), (run.state(0), 0)):
        with pytest.raises(InputError, match=re.escape(f'state: {k}, of ')):
            trajectory.state(k)


def test_after_compile_simulation_a_single_simulation_compiles_nothing(monkeypatch):
    robot = Robot(random_model(22, 2))
    for shared in (loops._repeat, loops._run_job):
        shared.cache_clear()  # what other tests have compiled for all robots
    compile_simulation(robot)

    def refuse(*_, **__):
        raise AssertionError('compiled in a call')
    monkeypatch.setattr('kane_dynamics.native.machine_code.llvm.Code', refuse)
    motion = Motion.from_points([0.0, 0.1], [[0.0, 0.0], [0.1, 0.1]],
                                joint_names=robot.joint_names)
    for torque in (None, ComputedTorque(robot, motion, 1.0, 1.0)):
        simulate(robot, [0.1, 0.2], [0.0, 0.0], 0.01, torque=torque)


def test_events_of_initial_states_and_errors_have_the_time_of_the_simulation():
    robot = Robot(random_model(4, 2))
    robot.limits = replace(robot.limits, upper=np.array([-0.5, np.inf]))
    run = simulate(robot, [0.1, 0.2], [0.0, 0.0], 0.01, t0=2.5)
    assert [event.t for event in run.limit_events] == [2.5]
    with pytest.raises(InputError, match=r'diverged .* at 2\.[5-9]\d* s'):
        simulate(robot, [0.1, 0.2], [1e9, -1e9], 1.0, t0=2.5, step=0.05)


def test_joints_of_a_loop_follow_a_motion_of_all_joints():
    """Columns of a motion, which numpy stores one after the other, are read as rows."""
    robot = four_bar('table', 'crank', turntable=True)
    driving = [robot.joint_names.index(name) for name in ('table', 'crank')]
    q = robot.closed_configuration(np.full(4, 0.3))
    times = np.linspace(0.0, 0.2, 21)
    rows = [q]
    for t in times[1:]:
        near = rows[-1].copy()
        near[driving] = q[driving] + 10.0 * t * t * np.array([0.5, 0.6])
        rows.append(
            robot.closed_configuration(near, fixed=('table', 'crank'), start=rows[-1]))
    motion = Motion.from_points(times, rows, joint_names=robot.joint_names)
    law = ComputedTorque(robot, motion, 100.0, 20.0, followed=('table', 'crank'))
    for starts in (q, np.array([q, q])):
        run = simulate(robot, starts, 0.0 * starts[..., :2], 0.2, torque=law)
        error = run.q[..., driving] - motion.sample(run.t)[0][:, driving]
        assert np.abs(error).max() < 1e-6
