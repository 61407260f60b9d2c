"""Functions for PyTorch: values, gradients, transforms, batches, bad input."""

import copy
import pickle
import sys
from threading import Thread

from framework_states import arm, driven, fr3, QUANTITIES, states, value_and_gradients
from kane_dynamics import ConstraintError, InputError, load_urdf, Robot
from kane_dynamics.robot.frameworks.batch_function import row
from kinds_of_mechanism import case
from linkages import at_angle
import numpy as np
import pytest
from same_numbers import assert_same_numbers

torch = pytest.importorskip('torch')
# What torch emits of itself where forward mode is used first.
pytestmark = pytest.mark.filterwarnings('ignore:.torch.jit.script:DeprecationWarning')


def tensors(*arrays, grad=False):
    """Return tensors of arrays."""
    return [torch.tensor(x, dtype=torch.float64, requires_grad=grad) for x in arrays]


def arm_arguments(*batch, grad=False):
    """Return q, u, udot, wrench and payload of the arm; one payload for all."""
    rng = np.random.default_rng(1)
    return tensors(*rng.normal(size=(3, *batch, 2)), rng.normal(size=(*batch, 1, 6)),
                   0.1 * rng.normal(size=10), grad=grad)


def arm_function():
    """Return inverse dynamics of the arm with the payload as an argument."""
    return arm().torch('inverse_dynamics', parameters=['payload'])


@pytest.mark.parametrize('kind, name', QUANTITIES)
def test_values_and_gradients_are_the_robots(kind, name):
    function = case(kind).robot.torch(name)
    arguments = states(kind, function.names)
    inputs = tensors(*arguments.values(), grad=True)
    result = function(*inputs)
    cotangent = np.random.default_rng(4).normal(size=tuple(result.shape))
    value, gradients = value_and_gradients(kind, name, cotangent, arguments)
    assert_same_numbers(result.detach().numpy(), value)
    for key, gradient in zip(
            arguments, torch.autograd.grad(result, inputs, torch.tensor(cotangent))):
        np.testing.assert_allclose(gradient.numpy(), gradients[key],
                                   rtol=1e-12, atol=1e-12, err_msg=key)


def test_gradients_of_seven_axes_are_the_finite_differences():
    function = fr3().torch('inverse_dynamics')
    rng = np.random.default_rng(2)
    state = rng.normal(size=(3, 4, 7))
    direction = rng.normal(size=(3, 4, 7))
    h = 1e-6
    inputs = tensors(*state, grad=True)
    gradients = torch.autograd.grad(function(*inputs).square().sum(), inputs)

    def cost(shift):
        return np.square(fr3().inverse_dynamics(*(state + shift * direction))).sum()
    slope = sum((x.numpy() * dx).sum() for x, dx in zip(gradients, direction))
    expected = (cost(h) - cost(-h)) / (2 * h)
    assert abs(slope / expected - 1.0) < 1e-6


def test_gradcheck_passes_for_both_orders_and_modes_with_wrench_and_payload():
    function = arm_function()
    inputs = arm_arguments(2, grad=True)
    assert torch.autograd.gradcheck(function, inputs, check_forward_ad=True,
                                    check_batched_grad=True,
                                    check_batched_forward_grad=True)
    assert torch.autograd.gradgradcheck(function, inputs, check_batched_grad=True)


@pytest.mark.parametrize('kind, name', [('closed loop', 'forward_dynamics'),
                                        ('flexible', 'inverse_dynamics')])
def test_gradcheck_passes_for_loops_and_beams(kind, name):
    function = case(kind).robot.torch(name)
    inputs = tensors(*states(kind, function.names, 1).values(), grad=True)
    assert torch.autograd.gradcheck(function, inputs, rtol=1e-5)
    assert torch.autograd.gradgradcheck(function, inputs, rtol=1e-5)


def test_transforms_agree_with_batches_and_with_each_other():
    function = arm_function()
    *state, payload = arm_arguments(3)
    shared = (0, 0, 0, 0, None)
    mapped = torch.func.vmap(function, in_dims=shared)(*state, payload)
    torch.testing.assert_close(mapped, function(*state, payload), rtol=0, atol=0)
    twice = torch.func.vmap(
        torch.func.vmap(function, in_dims=shared), in_dims=(None, 1, 0, 0, 0))(
            state[0], state[1].expand(2, 3, 2).movedim(0, 1), state[2].expand(2, 3, 2),
            state[3].expand(2, 3, 1, 6), payload.expand(2, 10))
    torch.testing.assert_close(twice, mapped.expand(2, 3, 2), rtol=0, atol=0)
    rows = torch.func.vmap(torch.func.jacrev(function, argnums=(0, 4)), in_dims=shared)(
        *state, payload)
    columns = torch.func.vmap(
        torch.func.jacfwd(function, argnums=(0, 4)), in_dims=shared)(
            *state, payload)
    torch.testing.assert_close(rows, columns)
    M = torch.func.jacrev(function, argnums=2)(*(x[0] for x in state), payload)
    robot = arm().copy()
    robot.parameters.block[3:] = payload.numpy()
    np.testing.assert_allclose(M.numpy(), robot.mass_matrix(state[0][0].numpy()),
                               atol=1e-12)


@pytest.mark.parametrize('backend', ['eager', 'aot_eager'])
def test_torch_compile_sees_one_operator_with_its_gradient(backend):
    function = arm_function()
    graphs = []
    inputs = arm_arguments(4, grad=True)

    def cost(*given):
        return function(*given).square().sum()
    expected = cost(*inputs)
    gradients = torch.autograd.grad(expected, inputs)

    def kept(graph, example):
        graphs.append(graph)
        return torch._dynamo.lookup_backend(backend)(graph, example)
    torch._dynamo.reset()
    compiled = torch.compile(cost, fullgraph=True, backend=kept)
    result = compiled(*inputs)
    torch.testing.assert_close(result, expected)
    torch.testing.assert_close(torch.autograd.grad(result, inputs), gradients)
    names = [str(node.target) for node in graphs[0].graph.nodes]
    assert len([name for name in names if 'kane_dynamics' in name]) == 1


def test_a_graph_of_another_process_finds_no_function_and_one_of_this_its_derivatives():
    function = arm_function()
    second = arm_function()
    handle = function._operation.handle
    assert handle != second._operation.handle
    inputs = arm_arguments(4)
    names = [a.name for a in function._operation.function.arguments]
    ones = torch.ones(4, function._operation.function.shape[0], dtype=torch.float64)
    late = torch.ops.kane_dynamics.evaluate_6(f'{handle} -> vjp {" ".join(names)}', ones,
                                              *inputs)
    expected = torch.func.vjp(function, *inputs)[1](ones)
    for part, gradient in zip(function._operation.vjp(*names).function.parts(late),
                              expected):
        torch.testing.assert_close(part.sum_to_size(gradient.shape), gradient)
    with pytest.raises(InputError, match=r'robot\.torch returned in this process'):
        torch.ops.kane_dynamics.evaluate_5(f'{handle}0 -> vjp q', *inputs)


def test_the_operator_meets_the_rules_of_torch():
    function = arm_function()
    done = torch.library.opcheck(torch.ops.kane_dynamics.evaluate_5.default, (
        function._operation.handle, *arm_arguments(3, grad=True)))
    assert set(done.values()) == {'SUCCESS'}


def test_batch_axes_broadcast_and_gradients_are_summed():
    function = fr3().torch('inverse_dynamics', parameters='gravity')
    rng = np.random.default_rng(0)
    q, u, udot, gravity = tensors(rng.normal(size=(2, 3, 7)), rng.normal(size=(3, 7)),
                                  rng.normal(size=(2, 1, 7)), [0.0, 0.0, -9.81],
                                  grad=True)
    result = function(q, u, udot, gravity=gravity)
    assert result.shape == (2, 3, 7)
    full = [x.detach().expand(2, 3, 7).reshape(6, 7).requires_grad_()
            for x in (q, u, udot)]
    flat = fr3().inverse_dynamics(*(x.detach().numpy() for x in full))
    np.testing.assert_allclose(result.detach().numpy().reshape(6, 7), flat, rtol=1e-12)
    result.square().sum().backward()
    function(*full, gravity.detach()).square().sum().backward()
    torch.testing.assert_close(q.grad, full[0].grad.view(2, 3, 7))
    torch.testing.assert_close(u.grad, full[1].grad.view(2, 3, 7).sum(0))
    torch.testing.assert_close(udot.grad,
                               full[2].grad.view(2, 3, 7).sum(1, keepdim=True))
    assert gravity.grad.shape == (3,)


@pytest.mark.parametrize('name', ['bias_force', 'joint_rates'])
def test_one_time_serves_all_states(name):
    mechanism = case('time-dependent')
    function = mechanism.robot.torch(name)
    q, t = tensors(mechanism.q, mechanism.time)
    u = torch.randn(5, mechanism.robot.n, dtype=torch.float64)
    expected = np.stack([getattr(mechanism.robot, name)(mechanism.q, x.numpy(),
                                                        t=mechanism.time) for x in u])
    for time in (t, t[None], t.expand(5)):
        np.testing.assert_allclose(function(q, u, time).numpy(), expected,
                                   rtol=1e-12, atol=1e-12)
    gradients = []
    for time in (t.clone(), t.repeat(5)):
        time.requires_grad_()
        result = function(q, u, time)
        gradients.append(torch.autograd.grad(result.sum(), time)[0].sum())
    torch.testing.assert_close(*gradients)


def test_a_number_of_one_state_is_a_number():
    function = fr3().torch('potential_energy')
    q = torch.zeros(7, dtype=torch.float64)
    assert function(q).shape == ()
    assert function(q).item() == pytest.approx(fr3().potential_energy(q.numpy()))
    q.requires_grad_()
    np.testing.assert_allclose(torch.autograd.grad(function(q), q)[0].numpy(),
                               fr3().derivative('potential_energy', np.zeros(7), by='q'))


def test_one_state_no_states_and_views_of_memory_are_states():
    function = fr3().torch('inverse_dynamics')
    wide = torch.randn(7, 10, dtype=torch.float64)
    views = [wide.T[::2], wide.T[:1].expand(5, 7), wide.flip(1).T[:5]]
    assert not any(x.is_contiguous() for x in views)
    expected = fr3().inverse_dynamics(*(np.ascontiguousarray(x) for x in views))
    assert_same_numbers(function(*views).numpy(), expected)
    assert_same_numbers(function(*(x[2] for x in views)).numpy(), expected[2])
    nothing = torch.zeros(0, 7, dtype=torch.float64, requires_grad=True)
    result = function(nothing, nothing, nothing)
    assert result.shape == (0, 7)
    result.sum().backward()
    assert nothing.grad.shape == (0, 7)


def test_a_mechanism_without_degrees_of_freedom_has_functions():
    q = torch.tensor(np.tile(at_angle(0.7), (3, 1)), requires_grad=True)
    none = q.new_zeros(3, 0)
    t = q.new_zeros(3)
    assert driven().torch('inverse_dynamics')(q, none, none, t).shape == (3, 0)
    rates = driven().torch('joint_rates')(q, none, t)
    np.testing.assert_allclose(rates.detach()[0, 0], 0.1)
    assert torch.autograd.grad(rates.sum(), q)[0].shape == (3, 3)


def test_float64_tensors_are_read_where_they_are():
    inputs = torch.randn(5, 7, dtype=torch.float64)
    argument = fr3().torch('inverse_dynamics').function.arguments[0]
    assert np.shares_memory(row(argument, inputs.numpy(), (5,)), inputs.numpy())


def test_float32_is_computed_in_double_and_rounded():
    function = fr3().torch('inverse_dynamics')
    single = torch.randn(3, 5, 7)
    inputs = [x.requires_grad_() for x in single]
    result = function(*inputs)
    double = [x.detach().double().requires_grad_() for x in single]
    expected = function(*double)
    assert result.dtype == torch.float32
    torch.testing.assert_close(result, expected.float(), rtol=0, atol=0)
    result.sum().backward()
    expected.sum().backward()
    torch.testing.assert_close(inputs[0].grad, double[0].grad.float(), rtol=0, atol=0)
    mixed = function(inputs[0], *double[1:])
    assert mixed.dtype == torch.float64
    mixed.sum().backward()
    assert inputs[0].grad.dtype == torch.float32


def test_only_what_requires_gradients_has_them():
    function = arm_function()
    inputs = arm_arguments(3)
    assert not function(*inputs).requires_grad
    inputs[4].requires_grad_()
    function(*inputs).sum().backward()
    assert [x.grad is None for x in inputs] == [True] * 4 + [False]
    with torch.no_grad():
        assert not function(*inputs).requires_grad


def test_the_payload_is_that_of_the_time_when_the_function_was_made():
    robot = arm().copy()
    q = torch.tensor([[0.4, -0.8]], dtype=torch.float64)
    function = robot.torch('gravity_force')
    torque_before = robot.gravity_force(q.numpy())
    robot.parameters.payload = None
    assert np.abs(robot.gravity_force(q.numpy()) - torque_before).max() > 0.1
    for call in (function, pickle.loads(pickle.dumps(function)),
                 copy.deepcopy(function)):
        np.testing.assert_allclose(call(q).numpy(), torque_before, rtol=1e-12)


def test_threads_share_a_function():
    function = fr3().torch('bias_force')
    results = {}
    q, u = torch.randn(2, 8, 50, 7, dtype=torch.float64)

    def work(k):
        leaf = q[k].clone().requires_grad_()
        for _ in range(5):
            results[k], = torch.autograd.grad(function(leaf, u[k]).square().sum(), leaf)
    threads = [Thread(target=work, args=(k,)) for k in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    leaf = q.clone().requires_grad_()
    expected, = torch.autograd.grad(function(leaf, u).square().sum(), leaf)
    torch.testing.assert_close(torch.stack([results[k] for k in range(8)]), expected)


class Torques(torch.utils.data.Dataset):
    """States whose torques a worker process computes."""

    def __init__(self):
        self.function = fr3().torch('gravity_force')
        self.q = torch.randn(6, 7, dtype=torch.float64)

    def __len__(self):
        return len(self.q)

    def __getitem__(self, k):
        return self.q[k], self.function(self.q[k])


@pytest.mark.filterwarnings(
    'ignore:This process .* is multi-threaded:DeprecationWarning')
def test_workers_of_a_data_loader_evaluate():
    data = Torques()
    data[0]  # compiled before the fork
    for q, tau in torch.utils.data.DataLoader(data, batch_size=3, num_workers=1,
                                              multiprocessing_context='fork'):
        np.testing.assert_allclose(tau.numpy(), fr3().gravity_force(q.numpy()),
                                   rtol=1e-12)


def test_a_number_that_is_not_finite_is_named_and_one_in_a_cotangent_passes():
    function = fr3().torch('inverse_dynamics')
    state = list(torch.zeros(3, 2, 3, 7, dtype=torch.float64))
    state[1][1, 2, 3] = torch.inf
    with pytest.raises(InputError,
                       match=r"u\[1, 2, 3\] \(joint 'fr3_joint4'\): inf; expected a"):
        function(*state)
    with pytest.raises(InputError, match=r'u\[0, 3\]'):
        torch.func.vmap(function)(*(x[1, 2:] for x in state))
    q = torch.zeros(2, 7, dtype=torch.float64, requires_grad=True)
    result = function(q, q, q)
    gradient, = torch.autograd.grad(result, q,
                                    torch.tensor([[1.0] * 7, [torch.nan] * 7]).double())
    assert gradient[0].isfinite().all() and gradient[1].isnan().any()


def test_an_open_loop_is_the_robots_error():
    robot = case('closed loop').robot
    function = robot.torch('inverse_dynamics')
    inputs = states('closed loop', function.names)
    inputs['q'][1, 1] += 0.3
    with pytest.raises(ConstraintError, match='residual'):
        function(*tensors(*inputs.values()))


@pytest.mark.parametrize('change, message', [
    (lambda q: q.numpy(), 'q: a ndarray; expected a torch.Tensor'),
    (lambda q: None, 'q: a NoneType; expected a torch.Tensor'),
    (lambda q: q.to('meta'), 'q: a tensor on meta; expected one on the CPU'),
    (lambda q: q.int(),
     'q: torch.int32, torch.strided; expected a dense tensor of float64'),
    (lambda q: q.half(), 'q: torch.float16'),
    (lambda q: q.to_sparse(), 'torch.sparse_coo'),
    (lambda q: q[:, :1], r'q: shape \(3, 1\); expected \(2,\), with batch axes'),
    (lambda q: q[0, 0], r'q: shape \(\); expected \(2,\)'),
    (lambda q: q[:2],
     r'arguments q \(2, 2\), u \(3, 2\).*expected batch axes that broadcast')])
def test_a_wrong_argument_is_named(change, message):
    inputs = arm_arguments(3)
    with pytest.raises(InputError, match=message):
        arm_function()(change(inputs[0]), *inputs[1:])


def test_wrong_names_and_counts_are_refused():
    function = arm_function()
    inputs = arm_arguments(3)
    expected = 'expected q, u, udot, wrench, payload, each once'
    for arguments, named in ((inputs[:4], {}), ([*inputs, inputs[0]], {}),
                             (inputs, {'q': inputs[0]}),
                             (inputs[:4], {'payloads': inputs[4]})):
        with pytest.raises(InputError, match=expected):
            function(*arguments, **named)
    for name, options, message in (
            ('inverse_dynamic', {}, "no kernel 'inverse_dynamic'"),
            ('frame_pose:top', {}, 'top'),
            (3, {}, 'name: a int'),
            ('friction_force', {'parameters': ['payload']},
             ("parameters: 'payload'; "
              'expected for friction_force of this robot some of none')),
            ('gravity_force', {'parameters': ['payload'] * 2}, 'each once')):
        with pytest.raises(InputError, match=message):
            arm().torch(name, **options)


def test_an_order_of_too_many_arguments_is_refused():
    function = arm_function().function
    with pytest.raises(InputError,
                       match='inverse_dynamics: a derivative with 40 arguments, '
                       'cotangents and tangents; expected at most 30'):
        for _ in range(3):
            function = function.jvp([a.name for a in function.arguments])


def test_a_graph_without_its_function_says_so():
    function = arm_function()
    inputs = arm_arguments(1)
    handle = function._operation.handle
    del function
    with pytest.raises(InputError,
                       match=r'expected one that robot\.torch returned in this'):
        torch.ops.kane_dynamics.evaluate_5(handle, *inputs)


def test_without_torch_the_error_names_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, 'torch', None)
    monkeypatch.delitem(sys.modules, 'kane_dynamics.robot.frameworks.torch_function',
                        raising=False)
    with pytest.raises(InputError,
                       match=r'robot.torch: .*pip install .kane_dynamics\[torch\]'):
        Robot(load_urdf('urdf/two_link.urdf')).torch('gravity_force')


def test_gradients_by_constants_are_the_regressor_and_the_laws_of_friction():
    robot = fr3()
    names = ['inertial_parameters', 'damping', 'friction']
    function = robot.torch('inverse_dynamics', parameters=names)
    q, u, udot = np.random.default_rng(3).uniform(-1.0, 1.0, (3, robot.n))
    joints = robot.model.coordinate_joints
    constants = (robot.inertial_parameters, [joint.damping for joint in joints],
                 [joint.friction for joint in joints])
    gradients = torch.func.jacrev(function, argnums=(3, 4, 5))(
        *tensors(q, u, udot, *constants))
    speeds = np.array([joint.friction_speed for joint in joints])
    for got, expected in zip(gradients, (robot.regressor(q, u, udot), np.diag(u),
                                         np.diag(np.tanh(u / speeds)))):
        np.testing.assert_allclose(got, expected, atol=1e-12)
