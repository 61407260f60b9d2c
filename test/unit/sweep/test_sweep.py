"""Sweeps: rows depend on seed and index, match a reference, are safe."""

from functools import cache
import json
import multiprocessing
import os
import sys

from kane_dynamics import disc, InputError, ModelBuilder, ModelWarning, Motion, Robot
from kane_dynamics.errors import SweepError
from kane_dynamics.mechanics.integrators import INTEGRATORS
from kane_dynamics.mechanics.integrators.rosenbrock import ImplicitStep
from kane_dynamics.mechanics.integrators.runge_kutta import runge_kutta_4
from kane_dynamics.model.inertial import Inertial
from kane_dynamics.model.model import with_payload
from kane_dynamics.native.runtime import threads
from kane_dynamics.sweep import read_table, run_sweep, Sweep, workers
from kane_dynamics.sweep.sampling import drawn, of_joints
from kane_dynamics.sweep.simulator import Simulator
from kane_dynamics.sweep.table import SweepTable
from mechanisms import random_model, with_friction_times
import numpy as np
import pytest

MODEL = random_model(11, 3, mimics=1)
JOINTS = MODEL.joint_names
PAYLOAD = {'frame': 'frame2', 'mass': {'uniform': [0.0, 3.0]},
           'com': [0.0, {'normal': [0.1, 0.02]}, 0.3],
           'gyration': {'loguniform': [0.01, 0.1]}}
KINDS = ('computed_torque', 'gravity_compensation', 'none')


@cache
def motion():
    """Return a desired motion."""
    points = np.cumsum(np.random.default_rng(1).normal(size=(3, 3)) * 0.1, axis=0)
    return Motion.from_points([0.0, 0.02, 0.05], points, joint_names=JOINTS)


def sweep(**changes):
    """Return a sweep with random and grid values for all parameters."""
    return Sweep(MODEL, **{
        'samples': 30, 'seed': 7, 'duration': 0.04, 'step': 2e-3, 'payload': PAYLOAD,
        'q0': {'each': {'uniform': [-0.5, 0.5]}},
        'u0': {JOINTS[1]: {'normal': [0.0, 0.3]}}, 'friction': {'uniform': [0.5, 2.0]},
        'motion': motion(), 'chunk': 30, 'controller': {
            'kind': {'choice': list(KINDS)}, 'kp': {'loguniform': [50.0, 500.0]},
            'kd': [10.0, {'uniform': [10.0, 30.0]}, 20.0],
            'known_payload': {'grid': [0.0, 1.0]}},
        **changes})


def columns(given):
    """Return all rows of a sweep by column."""
    simulator = Simulator(given)
    chunks = [simulator.columns(chunk) for chunk in range(given.chunks)]
    return {
        name: np.concatenate([np.array(chunk[name], dtype=object) for chunk in chunks])
        for name in chunks[0]}


def same(a, b):
    """Return whether two sets of columns are equal bit for bit."""
    assert list(a) == list(b)
    return all((a[name] == b[name]).all() for name in a)


def reference(given, row):
    """Return a trial's outcomes, simulated in Python with payload as model."""
    draws = drawn(given, [row])
    values = {name: x[0] for name, x in draws.items()}
    at = {name: of_joints(draws, name, JOINTS)[0]
          for name in ('q0', 'u0', 'friction', 'kp', 'kd')}
    mass = values['payload.mass']
    second = values['payload.mass'] * values['payload.gyration']**2
    com = [values[f'payload.com_{x}'] for x in 'xyz']
    load = Inertial(mass, com, second * np.eye(3))
    factor = at['friction'][0]
    loaded = with_payload(MODEL, 'frame2', load)
    plant = Robot(with_friction_times(factor, loaded))
    nominal = Robot(loaded if values['known_payload'] else MODEL)
    kind = KINDS[int(values['controller'])]
    n = MODEL.n

    def law(q, u, wanted):
        if kind == 'none':
            return np.zeros(n)
        if kind == 'gravity_compensation':
            return nominal.gravity_force(q)
        q_d, u_d, udot_d = np.split(wanted, 3)
        udot = udot_d + at['kd'] * (u_d - u) + at['kp'] * (q_d - q)
        return (nominal.inverse_dynamics(q, u, udot) - nominal.friction_force(u)
                + nominal.friction_force(u_d))

    # The state: q, u, the work of the torques, the squared errors of tracking.
    def rates(x, wanted):
        q = x[:n]
        u = x[n:2 * n]
        tau = law(q, u, wanted)
        error = wanted[:n] - q
        return np.concatenate([u, plant.forward_dynamics(q, u, tau),
                               [(tau - plant.friction_force(u)) @ u], error**2])
    x = np.concatenate([at['q0'], at['u0'], np.zeros(n + 1)])
    peak = np.zeros(n)
    energies = []

    def energy(x):
        return plant.kinetic_energy(x[:n], x[n:2 * n]) + plant.potential_energy(x[:n])
    for k in range(given.steps):
        # What is wanted at the begin, in the middle and at the end of the step.
        moments = [np.concatenate(given.motion.sample((k + part) * given.step))
                   for part in (0.0, 0.5, 1.0)]
        energies.append(energy(x))
        peak = np.maximum(peak, np.abs(law(x[:n], x[n:2 * n], moments[0])))
        if given.integrator == 'rk4':
            x = runge_kutta_4(rates, x, moments, given.step)
        else:
            x = implicit(plant, law, x, moments, given.step)
    energies.append(energy(x))
    return {'q': x[:n], 'u': x[n:2 * n], 'peak_torque': peak,
            'rms_error': np.sqrt(x[2 * n + 1:] / given.duration),
            'energy_drift': energies[-1] - energies[0] - x[2 * n]}, energies


def implicit(plant, law, x, moments, h):
    """Return the state of a trial after one implicit step."""
    method = ImplicitStep(plant.equations)
    n = plant.n
    block = plant.parameters.block
    q, u, sums = np.split(x, [n, 2 * n])

    def stage(*arguments):
        return method.stage(*arguments[:-2], None, block)

    def running(q, u, wanted):
        return np.array([(law(q, u, wanted) - plant.friction_force(u)) @ u,
                         *(wanted[:n] - q)**2])
    *state_after, _ = method.step(stage, q, u, lambda q, u, k: law(q, u, moments[k]), h,
                                  ())
    both = running(q, u, moments[0]) + running(*state_after, moments[2])
    return np.concatenate([*state_after, sums + 0.5 * h * both])


@pytest.mark.parametrize('integrator', INTEGRATORS)
def test_row_is_the_simulation_with_its_payload_friction_start_and_controller(
        integrator):
    trials = sweep(integrator=integrator)
    rows = columns(trials)
    assert rows['ok'].all() and rows['index'].tolist() == list(range(30))
    pairs = list(zip(rows['controller'], rows['known_payload']))
    assert len(set(pairs)) == 6
    for row in map(pairs.index, sorted(set(pairs) - {('none', 1.0)})):
        expected, energies = reference(trials, row)
        for name in ('q', 'u', 'peak_torque', 'rms_error'):
            got = np.array([rows[f'{name}.{joint}'][row] for joint in JOINTS])
            np.testing.assert_allclose(got, expected[name], rtol=1e-9, atol=1e-10)
        assert abs(rows['energy_drift'][row] - expected['energy_drift']) < 1e-10 * max(
            map(abs, energies))


def test_row_depends_only_on_seed_and_index(monkeypatch):
    monkeypatch.setenv(threads.VARIABLE, '1')
    whole = columns(sweep())
    assert same(columns(sweep(chunk=7)), whole)
    assert same({name: x[:10] for name, x in whole.items()}, columns(sweep(samples=10)))
    monkeypatch.setenv(threads.VARIABLE, '3')
    monkeypatch.setattr(threads, 'THREAD_WORK', 1e-12)
    assert same(columns(sweep()), whole)
    other_rows = columns(sweep(seed=8))
    assert not (other_rows['payload.mass'] == whole['payload.mass']).any()


def test_draws_follow_their_distributions():
    many = sweep(samples=4000, chunk=4000)
    values = drawn(many, range(4000))
    mass, com, k = (values[f'payload.{x}'] for x in ('mass', 'com_y', 'gyration'))
    assert mass.min() >= 0.0 and mass.max() <= 3.0 and abs(mass.mean() - 1.5) < 0.05
    assert abs(com.mean() - 0.1) < 2e-3 and abs(com.std() - 0.02) < 1e-3
    assert abs(np.log10(k).mean() + 1.5) < 0.02
    assert k.min() > 0.00999
    assert k.max() < 0.10001
    assert np.abs(np.bincount(values['controller'].astype(int)) - 4000 / 3).max() < 150
    starts = of_joints(values, 'q0', JOINTS)
    assert np.abs(np.corrcoef([*starts.T, mass, com]) - np.eye(5)).max() < 0.06
    np.testing.assert_array_equal(of_joints(values, 'u0', JOINTS)[0, ::2],
                                  motion().sample(0.0)[1][::2])


def test_all_grid_combinations_occur_equally_often():
    values = drawn(sweep(samples=24, friction={'grid': [1.0, 2.0, 3.0]}), range(24))
    pairs = list(zip(values['friction'].tolist(), values['known_payload'].tolist()))
    assert {pairs.count(pair) for pair in pairs} == {4} and len(set(pairs)) == 6


def test_diverged_trial_has_an_error_and_does_not_affect_others():
    calm, wild = (columns(sweep(controller={'kind': 'computed_torque', 'kd': [
        kd, {'uniform': [10.0, 30.0]}, 20.0]})) for kd in (10.0, {'grid': [10.0, 1e9]}))
    lost = wild[f'kd.{JOINTS[0]}'] > 10.0
    assert lost.sum() == 15 and (wild['ok'] == ~lost).all()
    assert all('diverged (non-finite state) before 0.0' in text
               for text in wild['error'][lost])
    assert np.isnan(wild['energy_drift'][lost].astype(float)).all()
    assert same({name: x[~lost] for name, x in wild.items()},
                {name: x[~lost] for name, x in calm.items()})


def test_exceeded_limits_are_reported():
    still = sweep(
        samples=1, chunk=1, controller='none', motion=None, payload=None, duration=2e-3,
        u0=None, q0=[joint.limits.upper + 0.1 for joint in MODEL.coordinate_joints])
    row = Simulator(still).columns(0)
    assert row['limits'] == ['; '.join(f'{joint} upper' for joint in JOINTS)]
    assert row['limit_events'].tolist() == [3]
    rows = columns(sweep())
    effort = Robot(MODEL).limits.effort
    for joint, limit in zip(JOINTS, effort):
        exceeded = [f'{joint} effort' in text.split('; ') for text in rows['limits']]
        assert exceeded == (rows[f'peak_torque.{joint}'] > limit).tolist()
        assert any(exceeded) and not all(exceeded)


def parts(folder):
    """Return the part files in order."""
    return sorted(folder.glob('part-*.parquet'))


def test_run_computes_missing_and_damaged_parts_only(tmp_path):
    trials = sweep(chunk=7)
    folder = tmp_path / 'table'
    done = run_sweep(trials, folder, workers=1)
    assert (done.found, done.made, done.failed) == (0, 30, 0)
    whole = read_table(folder)
    files = [part.read_bytes() for part in parts(folder)]
    assert whole['index'].to_pylist() == list(range(30)) and len(files) == 5
    first, second, third, fourth, _ = parts(folder)
    first.unlink()
    second.write_bytes(files[1][:len(files[1]) // 2])
    middle = files[2].index(np.float64(whole['payload.mass'][15].as_py()).tobytes())
    third.write_bytes(files[2][:middle] + b'\0' + files[2][middle + 1:])
    os.replace(fourth, folder / f'.{fourth.name}.partial')
    done = run_sweep(trials, folder, workers=1)
    assert (done.found, done.made) == (2, 28)
    assert read_table(folder).equals(whole)
    assert [part.read_bytes() for part in parts(folder)] == files
    assert not list(folder.glob('.*'))
    assert run_sweep(trials, folder, workers=1).made == 0


def test_part_of_another_chunk_is_computed_again(tmp_path):
    trials = sweep(chunk=10)
    run_sweep(trials, tmp_path, workers=1)
    first, second, _ = parts(tmp_path)
    second.write_bytes(first.read_bytes())
    assert run_sweep(trials, tmp_path, workers=1).made == 10
    assert read_table(tmp_path)['index'].to_pylist() == list(range(30))


@pytest.mark.parametrize('change, word', [
    ({'seed': 8}, 'seed'), ({'step': 1e-3}, 'step'),
    ({'integrator': 'implicit'}, 'integrator'), ({'friction': 1.0}, 'friction'),
    ({'chunk': 8}, 'chunk'), ({'payload': {**PAYLOAD, 'mass': 1.0}}, 'payload.mass')])
def test_a_folder_of_another_sweep_is_refused_by_name(tmp_path, change, word):
    mine = sweep(samples=2, chunk=1)
    with SweepTable(mine, tmp_path).opened():
        pass
    with pytest.raises(InputError, match=f'differ in {word}[,;]') as caught:
        run_sweep(sweep(**{'samples': 2, 'chunk': 1, **change}), tmp_path, workers=1)
    assert mine.digest[:12] in str(caught.value)


def test_folder_with_other_content_is_rejected_and_unchanged(tmp_path):
    (tmp_path / 'thesis.tex').write_text('...')
    with pytest.raises(InputError,
                       match=r": holds 'thesis\.tex' and no sweep; expected"):
        run_sweep(sweep(), tmp_path, workers=1)
    with pytest.raises(InputError, match='expected the folder of a sweep'):
        read_table(tmp_path)


def test_second_writer_of_a_folder_is_rejected(tmp_path):
    with (SweepTable(sweep(), tmp_path).opened(),
          pytest.raises(SweepError, match='another process is writing')):
        run_sweep(sweep(), tmp_path, workers=1)


def test_outcomes_of_failed_trials_are_null(tmp_path):
    trials = sweep(samples=2, chunk=2, controller={
        'kind': 'computed_torque', 'kp': 100.0, 'kd': {'grid': [20.0, 1e9]}})
    assert run_sweep(trials, tmp_path, workers=1).failed == 1
    good, bad = read_table(tmp_path).to_pylist()
    outcomes = []
    for name in good:
        if name.partition('.')[0] in ('q', 'u', 'peak_torque', 'rms_error',
                                      'energy_drift', 'limit_events', 'limits'):
            outcomes.append(name)
    assert len(outcomes) == 15 and good['ok'] and good['error'] is None and not bad['ok']
    assert all(good[name] is not None and bad[name] is None for name in outcomes)


def kill_first(work, chunk):
    """Kill this worker, as the system does when memory runs out."""
    os.kill(os.getpid(), 9)


def test_workers_that_die_repeatedly_are_an_error(monkeypatch, tmp_path):
    monkeypatch.setattr(workers, 'compute', kill_first)
    monkeypatch.setattr(workers, 'MOST_DEATHS', 1)
    with pytest.raises(SweepError, match='workers: 1 died before finishing'):
        run_sweep(sweep(chunk=15), tmp_path, workers=2)
    assert not parts(tmp_path) and not multiprocessing.active_children()


@pytest.mark.parametrize('change, words', [
    ({'samples': 0}, 'samples: 0; expected an integer from 1'),
    ({'seed': -1}, 'seed: -1; expected'),
    ({'duration': 0.0011}, 'expected a whole number of steps'),
    ({'integrator': 'euler'}, "integrator: 'euler'; expected one of rk4, implicit"),
    ({'friction': {'uniform': [2, 1]}},
     r'friction: uniform: \[2.0, 1.0\]; expected \[low, high'),
    ({'friction': {'normal': [1, 1]}},
     'friction: normal, which includes negative values; exp'),
    ({'friction': -1.0}, 'friction: -1.0; expected a finite number >= 0'),
    ({'q0': {'elbow': 1.0}}, "q0: no joint 'elbow'; expected joint0"),
    ({'q0': [0.0]}, 'q0: 1 entries; expected 3, in the order joint0'),
    ({'q0': {'uniform': [0, 1], 'normal': [0, 1]}},
     'q0: .*; expected a number, or a mapping'),
    ({'q0': float('nan')}, 'q0: nan; expected a finite number'),
    ({'payload': {'mass': 1.0}}, 'expected frame and mass'),
    ({'payload': {'frame': 'hand', 'mass': 1.0}},
     "no frame 'hand'; expected one of base"),
    ({'payload': {**PAYLOAD, 'com': 0.1}}, 'payload.com: 0.1; expected three values'),
    ({'payload': {**PAYLOAD, 'weight': 1}},
     "payload: unknown key 'weight'; expected one of frame"),
    ({'payload': {**PAYLOAD, 'mass': {'loguniform': [0, 1]}}}, '0 < low <= high'),
    ({'controller': 'pid'}, "controller: 'pid'; expected one of computed_torque"),
    ({'controller': {'kind': {'uniform': [0, 1]}}}, 'expected one of computed_torque'),
    ({'controller': {'kind': 'none', 'ki': 1}}, "controller: unknown key 'ki'"),
    ({'controller': {'kp': 100.0}}, 'kp, which none with a payload does not use'),
    ({'payload': None},
     'known_payload, which .* without a payload does not use; expected no'),
    ({'friction': {'grid': [1, 2, 3, 4]}},
     'samples: 30 for 8 combinations of the grids; expected a multiple of 8'),
    ({'motion': Motion.from_points([0.0], [[0.0]], joint_names=['x'])},
     "motion: joints \\['x'\\]; expected"),
])
def test_invalid_description_is_rejected_by_name(change, words):
    with pytest.raises(InputError, match=words):
        sweep(**change)


def test_a_worker_of_another_version_is_refused(monkeypatch, tmp_path):
    from kane_dynamics.sweep import simulator
    work = simulator.task(sweep())
    monkeypatch.setattr('kane_dynamics.sweep.description.package_version', lambda: '99')
    with pytest.raises(SweepError, match='runs kane_dynamics 99'):
        simulator.compute(work, 0)


def test_missing_package_is_named_with_its_extra(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, 'pyarrow', None)
    with pytest.raises(InputError,
                       match=r"'pyarrow' is not installed.*'kane_dynamics\[sweep\]'"):
        run_sweep(sweep(), tmp_path / 'table', workers=1)
    assert not (tmp_path / 'table').exists()


def test_folder_contains_the_description_of_its_rows(tmp_path):
    trials = sweep()
    with SweepTable(trials, tmp_path).opened() as finished:
        assert finished == set()
    report = json.loads((tmp_path / '_sweep.json').read_text())
    assert report['digest'] == trials.digest and report['seed'] == 7
    assert report['values']['friction'] == ['uniform', 0.5, 2.0]


def test_the_first_chunk_is_short_and_every_trial_is_in_one_chunk(tmp_path):
    long = sweep(samples=90, chunk=40)
    assert [len(long.rows(k)) for k in range(long.chunks)] == [32, 40, 18]
    assert [i for k in range(long.chunks) for i in long.rows(k)] == list(range(90))
    for samples, sizes in ((20, [20]), (32, [32]), (72, [32, 40])):
        few = sweep(samples=samples, chunk=40)
        assert [len(few.rows(k)) for k in range(few.chunks)] == sizes
    short = sweep(samples=30, chunk=10)
    assert [len(short.rows(k)) for k in range(short.chunks)] == [10, 10, 10]


def test_a_sweep_chooses_the_integrator_of_simulate(tmp_path):
    b = ModelBuilder('rotor')
    b.body('rotor', axis=(0, 0, 1), inertial=disc(0.1, 0.05), damping=5.0)
    robot = Robot(b.model())
    chosen = Sweep(robot, 2, duration=0.1, step=1e-3, u0=1.0)
    with pytest.warns(ModelWarning,
                      match=r"integrator 'implicit' is used: a step of 0\.001 s"):
        run_sweep(chosen, tmp_path / 'chosen', workers=1)
    trials = Sweep(robot, 2, duration=0.1, step=1e-3, u0=1.0, integrator='implicit')
    run_sweep(trials, tmp_path / 'given', workers=1)
    for quantity in ('q.rotor', 'u.rotor'):
        np.testing.assert_array_equal(*(read_table(tmp_path / name)[quantity].to_numpy()
                                        for name in ('chosen', 'given')))
    with pytest.warns(ModelWarning, match='too long'):
        run_sweep(Sweep(robot, 2, duration=0.1, step=1e-3, u0=1.0, integrator='rk4'),
                  tmp_path / 'rk4', workers=1)
    assert Simulator(Sweep(robot, 2, duration=0.1, step=1e-6,
                           u0=1.0)).integrator == 'rk4'
