"""Functions for JAX: values, derivatives, transforms, machine code, bad input."""

import copy
from functools import cache
import pickle
import subprocess
import sys
from threading import Thread

from framework_states import arm, driven, fr3, QUANTITIES, states, value_and_gradients
from kane_dynamics import CompileError, ConstraintError, InputError, load_urdf, Robot
from kane_dynamics._util.resources import resource_path
from kinds_of_mechanism import case
from linkages import at_angle
import numpy as np
import pytest
from same_numbers import assert_same_numbers

jax = pytest.importorskip('jax')
jnp = jax.numpy
WAYS = [pytest.param(True, id='machine code'), pytest.param(False, id='python')]
ways = pytest.mark.parametrize('compiled', WAYS)


@pytest.fixture(autouse=True)
def _double():
    """Use float64 in every test that does not say otherwise, in all threads."""
    x64_before = jax.config.jax_enable_x64
    jax.config.update('jax_enable_x64', True)
    yield
    jax.config.update('jax_enable_x64', x64_before)


def arm_arguments(*batch):
    """Return q, u, udot, wrench and payload of the arm; one payload for all."""
    rng = np.random.default_rng(1)
    return [jnp.asarray(x)
            for x in (*rng.normal(size=(3, *batch, 2)),
                      rng.normal(size=(*batch, 1, 6)), 0.1 * rng.normal(size=10))]


@cache
def arm_function(compiled=True):
    """Return inverse dynamics of the arm with the payload as an argument."""
    return arm().jax('inverse_dynamics', parameters=['payload'], compiled=compiled)


@pytest.mark.parametrize('kind, name, compiled', [
    *((*quantity, True) for quantity in QUANTITIES), ('tree', 'kinetic_energy', False),
    ('closed loop', 'inverse_dynamics', False)])
def test_values_and_gradients_under_jit_are_the_robots(kind, name, compiled):
    function = case(kind).robot.jax(name, compiled=compiled)
    inputs = states(kind, function.names)
    result = function(*inputs.values())
    cotangent = np.random.default_rng(4).normal(size=result.shape)
    value, gradients = value_and_gradients(kind, name, cotangent, inputs)
    assert_same_numbers(result, value)

    @jax.jit
    def both(*arguments):
        primal, back = jax.vjp(function, *arguments)
        return primal, back(cotangent)
    primal, backs = both(*inputs.values())
    assert_same_numbers(primal, value)
    for key, back in zip(inputs, backs):
        np.testing.assert_allclose(back, gradients[key],
                                   rtol=1e-12, atol=1e-12, err_msg=key)


def test_gradients_of_seven_axes_are_the_finite_differences():
    function = fr3().jax('inverse_dynamics')
    rng = np.random.default_rng(2)
    state = rng.normal(size=(3, 4, 7))
    direction = rng.normal(size=(3, 4, 7))
    h = 1e-6
    gradients = jax.jit(jax.grad(lambda *x: (function(*x)**2).sum(), argnums=(0, 1, 2)))(
        *state)

    def cost(shift):
        return np.square(fr3().inverse_dynamics(*(state + shift * direction))).sum()
    slope = sum((x * dx).sum() for x, dx in zip(gradients, direction))
    expected = (cost(h) - cost(-h)) / (2 * h)
    assert abs(slope / expected - 1.0) < 1e-6


@pytest.mark.parametrize('kind, name', [
    ('tree', 'inverse_dynamics'), ('closed loop', 'forward_dynamics'),
    ('flexible', 'inverse_dynamics')])
def test_both_modes_agree_with_finite_differences(kind, name):
    from jax.test_util import check_grads
    function = case(kind).robot.jax(name)
    inputs = states(kind, function.names, 1)
    check_grads(jax.jit(function), tuple(inputs.values()), 1,
                eps=1e-6, rtol=1e-5, atol=1e-5)


@ways
def test_transforms_agree_with_each_other(compiled):
    function = arm_function(compiled)
    arguments = arm_arguments(3)
    axes = (0, 0, 0, 0, None)
    expected = function(*arguments)
    for call in (jax.jit(function), jax.vmap(function, axes),
                 jax.jit(jax.vmap(function, axes))):
        np.testing.assert_array_equal(call(*arguments), expected)
    every = (0, 4)
    rows = jax.jit(jax.vmap(jax.jacrev(function, every), axes))(*arguments)
    columns = jax.jit(jax.vmap(jax.jacfwd(function, every), axes))(*arguments)
    for a, b in zip(rows, columns):
        np.testing.assert_allclose(a, b, rtol=1e-12, atol=1e-12)

    def cost(*given):
        return (function(*given)**2).sum()
    first, *others = (jax.jit(outer(inner(cost, 4), 0))(*arguments) for outer, inner in (
        (jax.jacfwd, jax.jacrev), (jax.jacrev, jax.jacfwd), (jax.jacrev, jax.jacrev)))
    for transformed in others:
        np.testing.assert_allclose(first, transformed, rtol=1e-10, atol=1e-10)


def test_nested_maps_and_loops_of_jax_apply():
    function = arm_function()
    q, u, udot, wrench, payload = arm_arguments(3)
    expected = function(q, u, udot, wrench, payload)
    # The inner map runs over states and wrenches, the outer one over udot and payloads.
    inner = jax.vmap(function, (0, 0, None, 0, None))
    outer = jax.vmap(inner, (None, None, 0, None, 0))
    nested = outer(q, u, udot[:2], wrench, jnp.tile(payload, (2, 1)))
    np.testing.assert_array_equal(nested[1, 1], expected[1])
    scanned = jax.lax.map(lambda x: function(*x, payload), (q, u, udot, wrench))
    np.testing.assert_array_equal(scanned, expected)

    def cost(*x):
        return (function(*x)**2).sum()
    again = jax.jit(jax.grad(jax.checkpoint(cost)))(q, u, udot, wrench, payload)
    once = jax.jit(jax.grad(cost))(q, u, udot, wrench, payload)
    np.testing.assert_allclose(again, once, rtol=1e-12)


@ways
def test_batch_axes_broadcast_and_gradients_are_summed(compiled):
    function = fr3().jax('inverse_dynamics', parameters='gravity', compiled=compiled)
    rng = np.random.default_rng(0)
    inputs = (rng.normal(size=(2, 3, 7)), rng.normal(size=(3, 7)),
              rng.normal(size=(2, 1, 7)), np.array([0.0, 0.0, -9.81]))
    full = [np.broadcast_to(x, (2, 3, 7)).reshape(6, 7) for x in inputs[:3]]

    def cost(*arguments):
        return (function(*arguments)**2).sum()
    every = (0, 1, 2, 3)
    np.testing.assert_allclose(jax.jit(function)(*inputs).reshape(6, 7),
                               fr3().inverse_dynamics(*full), rtol=1e-12)
    result = jax.jit(jax.grad(cost, every))(*inputs)
    flat = jax.jit(jax.grad(cost, every))(*full, inputs[3])
    for k, x in enumerate((flat[0].reshape(2, 3, 7), flat[1].reshape(2, 3, 7).sum(0),
                           flat[2].reshape(2, 3, 7).sum(1, keepdims=True), flat[3])):
        np.testing.assert_allclose(result[k], x, rtol=1e-10, atol=1e-10)


@ways
@pytest.mark.parametrize('name', ['bias_force', 'joint_rates'])
def test_one_time_serves_all_states(name, compiled):
    mechanism = case('time-dependent')
    function = mechanism.robot.jax(name, compiled=compiled)
    u = np.random.default_rng(0).normal(size=(5, mechanism.robot.n))
    expected = np.stack(
        [getattr(mechanism.robot, name)(mechanism.q, x, t=mechanism.time) for x in u])
    for time in (np.array(mechanism.time), np.full(5, mechanism.time)):
        for call in (function, jax.jit(function)):
            np.testing.assert_allclose(call(mechanism.q, u, time), expected,
                                       rtol=1e-12, atol=1e-12)


@ways
def test_a_number_of_one_state_is_a_number(compiled):
    function = fr3().jax('potential_energy', compiled=compiled)
    for call in (function, jax.jit(function)):
        assert call(np.zeros(7)).shape == ()
        np.testing.assert_allclose(call(np.zeros(7)),
                                   fr3().potential_energy(np.zeros(7)))


@ways
def test_one_state_and_no_states_are_states(compiled):
    function = fr3().jax('inverse_dynamics', compiled=compiled)
    state = np.random.default_rng(0).normal(size=(3, 7))
    np.testing.assert_allclose(jax.jit(function)(*state), fr3().inverse_dynamics(*state),
                               rtol=1e-12)
    nothing = jnp.zeros((0, 7))
    for call in (function, jax.jit(function)):
        assert call(nothing, nothing, nothing).shape == (0, 7)


@ways
def test_a_mechanism_without_degrees_of_freedom_has_functions(compiled):
    q = np.tile(at_angle(0.7), (3, 1))
    none = np.zeros((3, 0))
    t = np.zeros(3)
    torques = jax.jit(driven().jax('inverse_dynamics', compiled=compiled))
    assert torques(q, none, none, t).shape == (3, 0)
    rates = jax.jit(driven().jax('joint_rates', compiled=compiled))(q, none, t)
    np.testing.assert_allclose(rates[:, 0], 0.1)


def test_a_large_batch_is_shared_by_threads():
    function = fr3().jax('inverse_dynamics', compiled=True)
    state = np.random.default_rng(0).normal(size=(3, 20_001, 7))
    assert_same_numbers(jax.jit(function)(*state), fr3().inverse_dynamics(*state))


@ways
def test_float32_is_computed_in_double_and_rounded(compiled):
    function = arm_function(compiled)
    inputs = [x.astype(np.float32) for x in arm_arguments(5)]
    expected = function(*(x.astype(np.float64) for x in inputs))
    for call in (function, jax.jit(function)):
        result = call(*inputs)
        assert result.dtype == np.float32
        np.testing.assert_array_equal(result, expected.astype(np.float32))
    assert function(inputs[0], *arm_arguments(5)[1:]).dtype == np.float64
    jax.config.update('jax_enable_x64', False)
    result = jax.jit(arm().jax('gravity_force', compiled=compiled))(np.ones((4, 2)))
    assert result.dtype == np.float32
    np.testing.assert_allclose(result, arm().gravity_force(np.ones((4, 2))), rtol=1e-6)


@ways
def test_non_finite_arguments_are_named_or_give_nan_under_jit(compiled):
    function = arm_function(compiled)
    q, *others = arm_arguments(3)
    expected = function(q, *others)
    for bad, text in ((jnp.nan,
                       r"q\[1, 0\] \(joint 'joint1'\): nan; expected a finite number"),
                      (1e13, 'at most 1e')):
        wrong = q.at[1, 0].set(bad)
        with pytest.raises(InputError, match=text):
            function(wrong, *others)
        for dtype in (np.float64, np.float32):
            result = jax.jit(function)(*(x.astype(dtype) for x in (wrong, *others)))
            assert np.isnan(result[1]).all()
            np.testing.assert_allclose(result[::2], expected[::2], rtol=1e-4)
    gradient = jax.jit(jax.grad(lambda *x: function(*x).sum()))(wrong, *others)
    assert np.isnan(gradient[1]).all() and np.isfinite(gradient[::2]).all()


@ways
def test_an_open_loop_is_the_robots_error_or_nan_under_jit(compiled):
    function = case('closed loop').robot.jax('inverse_dynamics', compiled=compiled)
    inputs = states('closed loop', function.names)
    inputs['q'][1, 1] += 0.3
    with pytest.raises(ConstraintError, match='residual'):
        function(*inputs.values())
    result = jax.jit(function)(*inputs.values())
    assert np.isnan(result[1]).all() and np.isfinite(result[::2]).all()
    gradient = jax.jit(jax.grad(lambda *x: function(*x).sum()))(*inputs.values())
    assert np.isnan(gradient[1]).all() and np.isfinite(gradient[::2]).all()


@ways
def test_the_payload_is_that_of_the_time_when_the_function_was_made(compiled):
    robot = arm().copy()
    q = np.array([[0.4, -0.8]])
    function = robot.jax('gravity_force', compiled=compiled)
    torque_before = robot.gravity_force(q)
    robot.parameters.payload = None
    later = robot.jax('gravity_force', compiled=compiled)
    for call in (function, pickle.loads(pickle.dumps(function)),
                 copy.deepcopy(function)):
        assert call.compiled == compiled
        np.testing.assert_allclose(jax.jit(call)(q), torque_before, rtol=1e-12)
    np.testing.assert_allclose(jax.jit(later)(q), robot.gravity_force(q), rtol=1e-12)
    assert np.abs(robot.gravity_force(q) - torque_before).max() > 0.1


def test_threads_share_a_function():
    function = fr3().jax('bias_force')
    results = {}
    q, u = np.random.default_rng(0).normal(size=(2, 8, 50, 7))

    def work(k):
        for _ in range(5):
            results[k] = jax.jit(function)(q[k], u[k])
    threads = [Thread(target=work, args=(k,)) for k in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    np.testing.assert_array_equal([results[k] for k in range(8)], function(q, u))


PROGRAM = """
import jax, numpy as np, sys
from kane_dynamics import load_urdf, Robot
jax.config.update('jax_enable_x64', True)
jax.config.update('jax_compilation_cache_dir', sys.argv[1])
jax.config.update('jax_persistent_cache_min_compile_time_secs', 0)
jax.config.update('jax_persistent_cache_min_entry_size_bytes', -1)
robot = Robot(load_urdf('urdf/two_link.urdf'))
names = sys.argv[2:]
for name in names:  # in another order, so at other addresses
    state = np.ones((3 if name == 'inverse_dynamics' else 2, 4, 2))
    function = jax.jit(robot.jax(name))
    np.testing.assert_allclose(function(*state), getattr(robot, name)(*state),
                               rtol=1e-12, atol=1e-12, err_msg=name)
"""


def test_programs_in_the_cache_of_jax_call_the_right_machine_code(tmp_path):
    for names in (('bias_force', 'inverse_dynamics'),
                  ('inverse_dynamics', 'bias_force')):
        subprocess.run([sys.executable, '-c', PROGRAM, str(tmp_path), *names],
                       check=True, timeout=100)
    assert list(tmp_path.iterdir())


@pytest.mark.parametrize('change, message', [
    (lambda q: None, 'q: a NoneType; expected an array'),
    (lambda q: 'q', 'q: a str; expected an array'),
    (lambda q: q.astype(int), 'q: dtype int64; expected float32 or float64'),
    (lambda q: q + 1j, 'q: dtype complex128'),
    (lambda q: q[:, :1], r'q: shape \(3, 1\); expected \(2,\), with batch axes'),
    (lambda q: q[:2],
     r'arguments q \(2, 2\), u \(3, 2\).*expected batch axes that broadcast')])
def test_a_wrong_argument_is_named_under_jit_too(change, message):
    q, *others = arm_arguments(3)

    def under_jit(q, *others):
        return jax.jit(lambda *rest: arm_function()(q, *rest))(*others)
    for call in (arm_function(), under_jit):
        with pytest.raises(InputError, match=message):
            call(change(q), *others)


def test_wrong_names_and_counts_are_refused():
    arguments = arm_arguments(3)
    with pytest.raises(InputError,
                       match='expected q, u, udot, wrench, payload, each once'):
        arm_function()(*arguments[:4])
    for name, options, message in (
            ('inverse_dynamic', {}, "no kernel 'inverse_dynamic'"),
            ('frame_pose:top', {}, 'top'),
            ('friction_force', {'parameters': ['payload']},
             "parameters: 'payload'; expected")):
        with pytest.raises(InputError, match=message):
            arm().jax(name, **options)


def test_another_interface_of_xla_is_refused_or_python_is_called(monkeypatch, caplog):
    from kane_dynamics.robot.frameworks import xla_target
    monkeypatch.setattr(xla_target, 'interface', lambda: (1, 0))
    with pytest.raises(CompileError,
                       match='XLA foreign functions: version 1; expected 0'):
        arm().jax('gravity_force', compiled=True)
    assert arm().jax('gravity_force').compiled is False
    assert 'call Python for gravity_force, which is slower' in caplog.text


@pytest.mark.parametrize('kind, name', QUANTITIES)
def test_operations_and_their_gradients_are_the_robots(kind, name):
    function = case(kind).robot.jax(name, operations=True)
    inputs = states(kind, function.names)
    result = function(*inputs.values())
    cotangent = np.random.default_rng(4).normal(size=result.shape)
    value, gradients = value_and_gradients(kind, name, cotangent, inputs)
    assert_same_numbers(result, value)

    _, pull = jax.vjp(function, *map(jnp.asarray, inputs.values()))
    for key, gradient in zip(inputs, pull(cotangent)):
        assert_same_numbers(gradient, gradients[key])


def test_operations_take_parameters_batches_and_float32():
    function = arm().jax('inverse_dynamics', parameters=['payload'], operations=True)
    arguments = arm_arguments(4, 3)
    expected = arm_function()(*arguments)
    assert_same_numbers(function(*arguments), expected)
    *states_, payload = arguments
    mapped = jax.vmap(function, (0, 0, 0, 0, None))(*states_, payload)
    assert_same_numbers(mapped, expected)
    single = function(*(x.astype(jnp.float32) for x in arguments))
    assert single.dtype == jnp.float32
    np.testing.assert_allclose(single, expected, rtol=0, atol=1e-5 * abs(expected).max())
    with pytest.raises(InputError, match='compiled: True with operations=True'):
        arm().jax('inverse_dynamics', compiled=True, operations=True)


def test_operations_compile_for_other_devices_and_are_exported():
    function = fr3().jax('gravity_force', operations=True)
    q = jnp.asarray(np.random.default_rng(0).normal(size=7))
    entries = jax.jit(function.entries)
    assert 'stablehlo' in entries.trace(q).lower(lowering_platforms=('cuda',)).as_text()
    exported = jax.export.export(entries)(q)
    assert_same_numbers(np.array(exported.call(q)), fr3().gravity_force(np.asarray(q)))


def test_another_device_is_refused():
    function = jax.jit(fr3().jax('gravity_force'))
    with pytest.raises(InputError,
                       match=r'gravity_force: compiled for .*cuda.*; expected'):
        function.trace(jnp.zeros(7)).lower(lowering_platforms=('cuda',))


def test_without_jax_the_error_names_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, 'jax', None)
    monkeypatch.delitem(sys.modules, 'kane_dynamics.robot.frameworks.jax_function',
                        raising=False)
    with pytest.raises(InputError,
                       match=r'robot.jax: .*pip install .kane_dynamics\[jax\]'):
        Robot(load_urdf('urdf/two_link.urdf')).jax('gravity_force')


def test_jax_export_is_refused_with_its_reason():
    """Machine code of this process cannot be in a file; the page on JAX says so."""
    from jax import export
    robot = Robot(load_urdf(resource_path('urdf', 'two_link.urdf')))
    function = jax.jit(robot.jax('inverse_dynamics'))
    row = jax.ShapeDtypeStruct((2,), np.float64)
    with pytest.raises(ValueError,
                       match='custom calls whose targets have no compatibility'):
        export.export(function)(row, row, row)


def test_gradients_by_constants_are_the_regressor_and_the_laws_of_friction():
    robot = arm()
    names = ['inertial_parameters', 'damping', 'friction']
    function = robot.jax('inverse_dynamics', parameters=names)
    q, u, udot = np.random.default_rng(3).uniform(-1.0, 1.0, (3, robot.n))
    joints = robot.model.coordinate_joints
    values = [robot.inertial_parameters, np.array([joint.damping for joint in joints]),
              np.array([joint.friction for joint in joints])]
    given = [q, u, udot, np.zeros((len(robot.options['wrench_frames']), 6)), *values]
    gradients = jax.jacrev(function, argnums=(4, 5, 6))(*map(jnp.array, given))
    speeds = np.array([joint.friction_speed for joint in joints])
    for got, expected in zip(gradients, (robot.regressor(q, u, udot), np.diag(u),
                                         np.diag(np.tanh(u / speeds)))):
        np.testing.assert_allclose(got, expected, atol=1e-12)
