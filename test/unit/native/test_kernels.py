"""Calls of a compiled robot: arguments, results, native entry points."""

import gc
from importlib import import_module
import pickle
import re
import sys
import threading
from types import SimpleNamespace
import weakref

from kane_dynamics import InputError, Robot
from kane_dynamics.native.backends.c99 import c_functions
from kane_dynamics.native.backends.c99_math import PRECISIONS
from kane_dynamics.native.backends.llvm_scalar import module_text
from kane_dynamics.native.machine_code.compiling import collect_automatically, gc_paused
from kane_dynamics.native.python_call import entry
from kane_dynamics.native.runtime.kernel import Argument, Kernel
from kane_dynamics.native.tracing.program import trace_program
from kane_dynamics.native.tracing.subroutine import Subroutines
from mechanisms import random_model, random_state
import numpy as np
import pytest
from same_numbers import assert_same_numbers

MODEL = random_model(3, 5)
STATE = random_state(MODEL, 0)


@pytest.fixture(scope='module')
def robot():
    """Return a random robot."""
    return Robot(MODEL)


@pytest.mark.parametrize('text', [
    lambda program: module_text(program, 'twice'),
    lambda program: c_functions(program, 'twice', {}, PRECISIONS['float64'], '')])
def test_two_subroutines_of_one_name_are_refused_rather_than_confused(text):
    def twice(x):
        doubled = Subroutines()('part', lambda y: 2.0 * y, x)
        return doubled + Subroutines()('part', lambda y: y * y, x)

    program = trace_program('twice', twice, [('x', (2,))])
    with pytest.raises(ValueError, match='two programs have this name'):
        text(program)


def test_native_entry_supports_this_interpreter():
    assert entry.supported()


@pytest.mark.parametrize('place', ['numpy._core.multiarray', 'numpy.core.multiarray'])
def test_native_entry_finds_the_functions_of_numpy_2_and_of_numpy_1(monkeypatch, place):
    core = '_core' if int(np.__version__[0]) > 1 else 'core'
    multiarray = import_module(f'numpy.{core}.multiarray')
    functions = SimpleNamespace(_ARRAY_API=multiarray._ARRAY_API)
    expected = entry.interpreter_words()
    for module in ('numpy._core.multiarray', 'numpy.core.multiarray'):
        monkeypatch.setitem(sys.modules, module, functions if module == place else None)
    assert entry.interpreter_words.__wrapped__() == expected


def test_native_entry_and_fallback_agree_bit_for_bit(robot):
    fast = robot.inverse_dynamics
    assert type(fast).__name__ == 'builtin_function_or_method'
    assert np.array_equal(fast(*STATE), Robot.inverse_dynamics(robot, *STATE))


@pytest.mark.parametrize('convert', [
    list, lambda x: x.astype(np.float32), lambda x: np.repeat(x, 2)[::2],
    lambda x: x.astype('>f8'), lambda x: x[::-1].copy()[::-1]])
def test_anything_convertible_is_converted(robot, convert):
    inputs = [convert(x) for x in STATE]
    expected = robot.inverse_dynamics(*[np.array(x, dtype=np.float64) for x in inputs])
    assert np.array_equal(robot.inverse_dynamics(*inputs), expected)


def test_integers_are_numbers(robot):
    ones = [1, 0, 2, 0, 1]
    assert np.array_equal(robot.inverse_dynamics(ones, ones, ones),
                          robot.inverse_dynamics(*3 * [np.array(ones, dtype=float)]))


def test_a_batch_is_its_states_one_by_one(robot):
    batch = np.random.default_rng(1).normal(size=(3, 17, 5))
    for name, count in (('inverse_dynamics', 3), ('forward_dynamics', 3),
                        ('mass_matrix', 1),
                        ('bias_force', 2), ('kinetic_energy', 2),
                        ('potential_energy', 1),
                        ('torque_terms', 3)):
        method = getattr(robot, name)
        rows = np.array([method(*[np.ascontiguousarray(x[k]) for x in batch[:count]])
                         for k in range(17)])
        assert_same_numbers(method(*batch[:count]), rows)


def test_an_empty_batch_gives_an_empty_result(robot):
    none = np.empty((0, 5))
    assert robot.inverse_dynamics(none, none, none).shape == (0, 5)


@pytest.mark.parametrize('arguments, words', [
    ((STATE[0][:3], STATE[1], STATE[2]), ['q', '(3,)', '(5,)']),
    ((STATE[0], STATE[1], np.zeros((2, 4))), ['udot', '(2, 4)', '(N, 5)']),
    ((STATE[0], 'abc', STATE[2]), ['u', 'dtype', '(5,)']),
    ((STATE[0], STATE[1], np.array([None] * 5)), ['udot', 'object']),
    ((STATE[0], STATE[1], STATE[2] + 0j), ['udot', 'complex']),
    ((STATE[0], STATE[1], [[1.0], [1.0, 2.0]]), ['udot', 'rectangular']),
    ((STATE[0], [0, 0, np.nan, 0, 0], STATE[2]), ['u[2]', "'joint2'", 'nan', 'finite']),
    ((STATE[0], STATE[1], [0, 0, 0, 0, np.inf]), ['udot[4]', "'joint4'", 'inf']),
    ((STATE[0], np.zeros((4, 5)), STATE[2]), ['single states or all batches', '(4, 5)']),
    ((np.zeros((3, 5)), np.zeros((4, 5)), np.zeros((3, 5))), ['one length', '(4, 5)']),
])
def test_a_bad_argument_is_named_with_what_is_expected(robot, arguments, words):
    with pytest.raises(InputError) as error:
        robot.inverse_dynamics(*arguments)
    for word in words:
        assert word in str(error.value)


@pytest.mark.parametrize('value', [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize('argument', range(3))
@pytest.mark.parametrize('place', range(5))
def test_non_finite_state_is_rejected(robot, value, argument, place):
    state = STATE.copy()
    state[argument, place] = value
    with pytest.raises(InputError, match=r': -?(nan|inf); expected'):
        robot.inverse_dynamics(*state)


def test_wrong_argument_counts_are_type_errors(robot):
    with pytest.raises(TypeError, match='udot'):
        robot.inverse_dynamics(STATE[0], STATE[1])
    with pytest.raises(TypeError):
        robot.inverse_dynamics(*STATE, *STATE)
    with pytest.raises(TypeError, match='colour'):
        robot.inverse_dynamics(*STATE, colour=1)


def test_out_is_written_to_and_returned(robot):
    out = np.zeros(5)
    assert robot.inverse_dynamics(*STATE, out=out) is out
    assert np.array_equal(out, robot.inverse_dynamics(*STATE))
    strided = np.zeros(10)[::2]
    assert np.array_equal(robot.inverse_dynamics(*STATE, out=strided), out)
    overlaid = STATE[2].copy()
    robot.inverse_dynamics(STATE[0], STATE[1], overlaid, out=overlaid)
    assert np.array_equal(overlaid, out)


@pytest.mark.parametrize('out', [np.zeros(4), np.zeros(5, dtype=np.float32), [0.0] * 5,
                                 np.broadcast_to(0.0, 5)])
def test_an_out_that_cannot_take_the_result_is_refused(robot, out):
    with pytest.raises(InputError, match=re.escape('(5,)')):
        robot.inverse_dynamics(*STATE, out=out)


def test_energies_of_single_states_are_floats(robot):
    assert type(robot.kinetic_energy(STATE[0], STATE[1])) is float
    assert type(robot.potential_energy(list(STATE[0]))) is float


def test_gravity_changes_without_compiling(robot):
    other_robot = Robot(MODEL)
    other_robot.inverse_dynamics(*STATE)
    address = other_robot.kernels.kernel('inverse_dynamics').address
    other_robot.parameters.gravity = (1.0, 2.0, 3.0)
    assert other_robot.kernels.kernel('inverse_dynamics').address == address
    moon = Robot(random_model(3, 5).__class__(**{
        **{f: getattr(MODEL, f) for f in MODEL.__dataclass_fields__},
        'gravity': (1, 2, 3)}))
    np.testing.assert_array_equal(other_robot.inverse_dynamics(*STATE),
                                  moon.inverse_dynamics(*STATE))


@pytest.mark.parametrize('value', [None, (1, 2), 'down', (0, 0, np.nan)])
def test_bad_gravity_is_refused_and_the_old_one_stays(robot, value):
    gravity_before = robot.parameters.gravity
    with pytest.raises(InputError, match='gravity'):
        robot.parameters.gravity = value
    assert np.array_equal(robot.parameters.gravity, gravity_before)


def test_a_payload_without_its_frame_is_refused(robot):
    with pytest.raises(InputError, match='payload_frame'):
        robot.parameters.payload = None


@pytest.mark.parametrize('options',
                         [{'payload_frame': 'nowhere'}, {'wrench_frames': ['nowhere']},
                          {'wrench_frames': 'frame1'}])
def test_an_unknown_frame_is_named_with_the_valid_ones(options):
    with pytest.raises(InputError, match='frame'):
        Robot(MODEL, **options)
    with pytest.raises(InputError, match=r"'nowhere'; expected one of .*frame0"):
        Robot(MODEL).frame_pose('nowhere', STATE[0])


def test_a_wrench_needs_a_declared_frame(robot):
    with pytest.raises(InputError, match='wrench_frames'):
        robot.inverse_dynamics(*STATE, wrench=np.zeros((1, 6)))


def test_a_robot_survives_pickling():
    robot = Robot(MODEL, payload_frame='frame4', friction=False)
    robot.parameters.gravity = (0.0, 1.0, 2.0)
    robot.parameters.payload = MODEL.bodies[0].inertial
    copy = pickle.loads(pickle.dumps(robot))
    assert np.array_equal(copy.inverse_dynamics(*STATE), robot.inverse_dynamics(*STATE))


def test_a_robot_and_its_code_are_freed():
    robot = Robot(MODEL)
    robot.inverse_dynamics(*STATE)
    ghost = weakref.ref(robot)
    del robot
    gc.collect()
    assert ghost() is None


def test_calls_from_many_threads_do_not_mix(robot):
    states = random_state(MODEL, 5, 3 * 4).reshape(4, 3, 5)
    expected = [robot.inverse_dynamics(*s) for s in states]
    wrong = []

    def work(k):
        for _ in range(2000):
            if not np.array_equal(robot.inverse_dynamics(*states[k]), expected[k]):
                wrong.append(k)
    threads = [threading.Thread(target=work, args=(k,)) for k in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong


def test_fallback_alone_gives_the_same_results(monkeypatch):
    monkeypatch.setattr(entry, 'supported', lambda: False)
    robot = Robot(MODEL)
    assert type(robot.inverse_dynamics).__name__ == 'method'
    assert np.array_equal(robot.inverse_dynamics(*STATE),
                          Robot(MODEL).inverse_dynamics(*STATE))
    with pytest.raises(InputError, match='nan'):
        robot.inverse_dynamics(STATE[0], STATE[1] * np.nan, STATE[2])


def test_every_kernel_documents_itself(robot):
    assert 'inverse' in robot.inverse_mass_matrix.__doc__
    assert 'Parameters' in Robot.inverse_dynamics.__doc__


def test_referenced_result_is_never_reused(robot):
    states = random_state(MODEL, 8, 3 * 20).reshape(20, 3, 5)
    results = [robot.inverse_dynamics(*state) for state in states]
    view = robot.inverse_dynamics(*states[0])[1:]
    weak = weakref.ref(robot.inverse_dynamics(*states[1]))
    for state, tau in zip(states, results):
        assert np.array_equal(tau, Robot.inverse_dynamics(robot, *state))
    assert np.array_equal(view, results[0][1:])
    assert weak() is None or np.array_equal(weak(), results[1])


# numpy 2.5 deprecates these assignments; as long as it has them, arrays change under
# their owner.
ASSIGNED = pytest.mark.filterwarnings(
    'ignore:Setting the (shape|dtype):DeprecationWarning')


@ASSIGNED
@pytest.mark.parametrize('alter', [
    lambda x: setattr(x, 'shape', (1, 5)), lambda x: setattr(x, 'dtype', np.int64),
    lambda x: x.setflags(write=False), lambda x: setattr(x, 'shape', (5, 1, 1))])
def test_modified_result_array_is_not_reused(alter):
    robot = Robot(MODEL)
    expected = Robot.inverse_dynamics(robot, *STATE)
    for _ in range(6):
        tau = robot.inverse_dynamics(*STATE)
        assert tau.shape == (5,) and tau.dtype == np.float64 and tau.flags.writeable
        assert np.array_equal(tau, expected)
        alter(tau)
        del tau


@ASSIGNED
def test_reshaped_matrix_is_not_reused():
    robot = Robot(MODEL)
    for _ in range(6):
        M = robot.mass_matrix(STATE[0])
        assert M.shape == (5, 5)
        M.shape = (1, 25)
        del M


def test_discarded_result_has_correct_reference_counts(robot):
    many = [robot.inverse_dynamics(*STATE) for _ in range(3)]
    for _ in range(5):
        with pytest.raises(InputError, match='not finite'):
            robot.inverse_dynamics(STATE[0], STATE[1], np.full(5, 1e308))
    assert all(np.array_equal(tau, many[0]) for tau in many)
    assert np.array_equal(robot.inverse_dynamics(*STATE), many[0])


def test_native_entry_takes_matrices_as_they_are():
    def fallback(*values):
        raise InputError('not native')
    kernel = Kernel('product', lambda: trace_program(
        'product', lambda A, x, _: A @ x,
        [('A', (2, 3)), ('x', (3,)), ('parameters', (0,))]), None,
                    [Argument('A', (2, 3)), Argument('x', (3,))], np.zeros(0), (2,))
    native = kernel.entry('', fallback)
    A = np.arange(6.0).reshape(2, 3)
    x = np.array([1.0, 10.0, 100.0])
    np.testing.assert_array_equal(native(A, x), A @ x)
    for wrong in (A.ravel(), A.T, A.reshape(3, 2), A[None], A.astype(np.float32),
                  np.asfortranarray(A), np.where(A == 2.0, np.nan, A), A.tolist()):
        with pytest.raises(InputError, match='not native'):
            native(wrong, x)
        if np.shape(wrong) != (2, 3):
            with pytest.raises(InputError, match=r'A: shape|states or all batches'):
                kernel(wrong, x)


def test_results_are_freed_with_their_entry():
    robot = Robot(MODEL)
    # No name may keep the last result alive.
    ghosts = [weakref.ref(tau) for tau in
              [robot.inverse_dynamics(*STATE) for _ in range(4)]]
    del robot
    gc.collect()
    assert [ghost() for ghost in ghosts] == [None] * 4


@pytest.mark.parametrize('enabled', [True, False])
def test_garbage_collection_pauses_during_compilation_and_is_restored(enabled):
    was = gc.isenabled()
    (gc.enable if enabled else gc.disable)()
    try:
        with pytest.raises(ZeroDivisionError), gc_paused():
            with gc_paused():
                assert not gc.isenabled()
            assert not gc.isenabled()
            raise ZeroDivisionError
        assert gc.isenabled() == enabled
    finally:
        (gc.enable if was else gc.disable)()


@pytest.mark.parametrize('before', [True, False])
@pytest.mark.parametrize('stated', [True, False])
def test_a_state_of_the_collector_that_is_stated_in_a_pause_holds_after_it(
        before, stated):
    was = gc.isenabled()
    collect_automatically(before)
    try:
        with gc_paused():
            collect_automatically(stated)
            assert not gc.isenabled()
        assert gc.isenabled() == stated
    finally:
        collect_automatically(was)


def scaled(factor):
    """Return the program of a product."""
    return lambda: trace_program('product', lambda x, _: factor * x,
                                 [('x', (2,)), ('p', ())])


def other_sum(factor):
    """Return a program of the same name and shapes as that of `scaled`."""
    return lambda: trace_program('product', lambda x, _: factor + x,
                                 [('x', (2,)), ('p', ())])


@pytest.mark.parametrize(('program', 'expected'), [
    (scaled(2.0), [4.0, 6.0]), (scaled(3.0), [6.0, 9.0]), (other_sum(2.0), [4.0, 5.0])])
def test_kernels_of_one_name_and_key_have_their_own_programs(program, expected):
    arguments = [Argument('x', (2,))]
    none = np.zeros(())
    x = np.array([2.0, 3.0])
    for _ in range(2):  # the second one is from the cache
        kernel = Kernel('product', program, 'a key of several programs', arguments, none,
                        (2,))
        assert np.array_equal(kernel(x), expected)
        assert np.array_equal(kernel(np.stack([x, x])), [expected, expected])


def test_kernels_of_one_program_and_key_have_their_own_shapes():
    def program(n):
        return lambda: trace_program('copied', lambda x, _: 1.0 * x,
                                     [('x', (n[0],)), ('p', ())])
    for n in (2, 3):
        kernel = Kernel('copied', program([n]), 'a key of two shapes',
                        [Argument('x', (n,))], np.zeros(()), (n,))
        assert np.array_equal(kernel(np.arange(n)), np.arange(n))


def same_calls(robot):
    """Return calls of native entry points, and the same ones by the checked methods."""
    frames = ('frame1', 'frame4')
    q, u, udot = STATE
    calls = []
    for name, arguments in (('inverse_dynamics', STATE), ('mass_matrix', (q,)),
                            ('kinetic_energy', (q, u)),
                            ('inverse_dynamics_derivatives', STATE),
                            ('forward_dynamics_derivatives', STATE),
                            ('jacobian', ('frame4', q)), ('frame_pose', ('frame4', q)),
                            ('jacobian', (frames, q)),
                            ('frame_acceleration', (frames, q, u, udot)),
                            ('joint_reaction', ('joint2', q, u, udot))):
        calls.append((name, arguments))
    return calls


@pytest.mark.parametrize('as_given', [lambda x: x, np.ndarray.tolist, list,
                                      lambda x: tuple(map(float, x)),
                                      lambda x: [*x[:-1], int(x[-1])]])
def test_lists_and_tuples_give_the_results_of_the_checked_methods(robot, as_given):
    for name, arguments in same_calls(robot):
        values = []
        for value in arguments:
            if isinstance(value, np.ndarray):
                value = as_given(value)
            values.append(value)
        expected = getattr(Robot, name)(robot, *values)
        for _ in range(3):
            result = getattr(robot, name)(*values)
            assert type(result) is type(expected)
            for own, right in zip(np.atleast_1d(result), np.atleast_1d(expected),
                                  strict=True):
                np.testing.assert_array_equal(own, right)


@pytest.mark.parametrize('count', [1, 3, 8, 9, 100])
def test_small_batches_are_their_states_one_by_one(robot, count):
    states = np.random.default_rng(count).uniform(-1.0, 1.0, (3, count, 5))
    for _ in range(2):  # the first batch compiles
        for name, arguments in (('inverse_dynamics', states),
                                ('mass_matrix', states[:1]),
                                ('kinetic_energy', states[:2])):
            batch = getattr(robot, name)(*arguments)
            assert type(batch) is np.ndarray and batch.flags.owndata
            for k, row in enumerate(batch):
                single = getattr(robot, name)(*(x[k] for x in arguments))
                np.testing.assert_allclose(row, single, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize('spoil', [
    lambda q, u, x: (q[:3], u, x), lambda q, u, x: (q[0], u, x),
    lambda q, u, x: (q, np.where(u == u[1, 1], np.nan, u), x),
    lambda q, u, x: (q, u, x[:, :4]), lambda q, u, x: (q[None], u, x)])
def test_a_small_batch_with_a_fault_raises_the_error_of_the_checked_method(robot, spoil):
    states = np.random.default_rng(0).uniform(-1.0, 1.0, (3, 4, 5))
    robot.inverse_dynamics(*states)
    arguments = spoil(*states)
    with pytest.raises(InputError) as expected:
        Robot.inverse_dynamics(robot, *arguments)
    with pytest.raises(InputError) as raised:
        robot.inverse_dynamics(*arguments)
    assert str(raised.value) == str(expected.value)


@pytest.mark.parametrize('state', [[True] * 5, [1e400] + [0.0] * 4, [10**400] + [0] * 4,
                                   ['1.0'] * 5, [0.0] * 4, [[0.0]] * 5, [None] * 5, []])
def test_lists_of_anything_else_raise_the_error_of_the_checked_method(robot, state):
    with pytest.raises((InputError, OverflowError)) as expected:
        Robot.mass_matrix(robot, state)
    with pytest.raises(type(expected.value)) as raised:
        robot.mass_matrix(state)
    assert str(raised.value) == str(expected.value)


@pytest.mark.parametrize('frame', [None, 3, 'nowhere', ('frame1', 'nowhere'), (),
                                   ([],), ('frame1', 2)])
def test_frames_that_are_no_names_are_refused(robot, frame):
    robot.jacobian('frame1', STATE[0])
    with pytest.raises(InputError, match='frame'):
        robot.jacobian(frame, STATE[0])


def test_several_frames_are_the_single_ones(robot):
    q, u, udot = STATE
    frames = ('frame1', 'frame4', 'frame1')
    for name, arguments in (('jacobian', (q,)), ('frame_pose', (q,)),
                            ('frame_velocity', (q, u)), ('jacobian_rate', (q, u)),
                            ('frame_acceleration', (q, u, udot))):
        method = getattr(robot, name)
        for given in (frames, list(frames)):
            together = method(given, *arguments)
            for frame, own in zip(frames, together, strict=True):
                np.testing.assert_allclose(own, method(frame, *arguments), atol=1e-14)
    in_frame = robot.jacobian(frames, q, axes='frame')
    np.testing.assert_array_equal(in_frame[1], robot.jacobian('frame4', q, axes='frame'))


def test_parts_of_a_result_are_never_shared_between_calls(robot):
    states = random_state(MODEL, 8, 3 * 20).reshape(20, 3, 5)
    results = [robot.inverse_dynamics_derivatives(*state) for state in states]
    for state, parts in zip(states, results):
        for own, right in zip(parts, Robot.inverse_dynamics_derivatives(robot, *state),
                              strict=True):
            np.testing.assert_array_equal(own, right)
    before = sys.getrefcount(results[0][1])
    for _ in range(5):
        with pytest.raises(InputError, match='not finite'):
            robot.inverse_dynamics_derivatives(STATE[0], np.full(5, 1e200), STATE[2])
    after = sys.getrefcount(results[0][1])
    assert after == before
