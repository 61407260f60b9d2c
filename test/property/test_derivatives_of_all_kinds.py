"""Derivatives for every kind of robot, against hyper-dual numbers of Kane's."""

from functools import cache

from examples.flexible_four_bar import flexible_four_bar
from hyperdual_derivatives import slopes_of_definition
from kane_dynamics import (ball, ConstraintError, FlexibleLink, Inertial, InputError,
                           ModelBuilder, Prescribed, Robot, rod, Speeds)
from kane_dynamics.mechanics.algebra.jet import moving, rates
from kane_dynamics.native.tracing.program import evaluate
from kane_dynamics.native.tracing.subroutine import inlined
from kane_dynamics.robot.derivative_kernels import Derivative, PARAMETERS
from kane_dynamics.robot.kernel_set import FRAME_QUANTITIES
from kinds_of_mechanism import case, ELASTIC, PAIRS
from linkages import at_angle, four_bar, sleigh
from mechanisms import random_model
import numpy as np
import pytest
from random_loops import random_loops

T = 0.4  # s
PAYLOAD = Inertial(1.2, (0.1, -0.05, 0.2), np.diag([0.02, 0.03, 0.025]))


@cache
def robot_of(kind):
    """Return a robot of a kind, with payload and wrench if a tree or in its speeds."""
    model = random_model(5, 4, branching=0.0, prismatic=0.2)
    tip = {'wrench_frames': (model.frames[-1].name,),
           'payload_frame': model.frames[-1].name}
    if kind == 'tree':
        return Robot(model, **tip)
    if kind == 'chosen speeds':
        return Robot(model, **tip, speeds=Speeds(
            lambda q, t: np.diag([2.0 + np.sin(x + t) for x in q]),
            lambda q, t: np.array([np.cos(t) * abs(x) for x in q])))
    if kind == 'time-dependent':
        return Robot(model,
                     constraints=[Prescribed('joint1', lambda t: 0.3 * np.sin(2.0 * t))])
    if kind == 'flexible':
        b = ModelBuilder('flexible arm')
        b.beam('arm', 'world',
               FlexibleLink(0.8, 1.5, (400.0, 600.0), (1, 1), damping=0.01),
               axis=(0, 1, 0))
        b.body('hand', 'arm/tip', axis=(0, 0, 1),
               inertial=rod(0.5, (0, 0, 0), (0.1, 0.05, 0)))
        return Robot(b.model())
    if kind == 'free body':
        b = ModelBuilder('free arm')
        b.body('base', kind='floating', inertial=ball(3.0, 0.2))
        b.body('arm', 'base', axis=(0, 1, 0),
               inertial=rod(0.5, (0, 0, 0), (0.4, 0.05, 0)))
        return Robot(b.model())
    return {'closed loop': lambda: four_bar('crank'), 'nonholonomic': sleigh,
            'flexible loop': flexible_four_bar}[kind]()


KINDS = ('tree', 'chosen speeds', 'time-dependent', 'flexible', 'free body',
         'closed loop', 'nonholonomic', 'flexible loop')


def state_of(kind, seed=0):
    """Return q, with loops closed, and u, udot."""
    robot = robot_of(kind)
    rng = np.random.default_rng(seed)
    rows = []
    for name in robot.speed_names:
        rows.append(0.03 if 'mode' in name else 1.0)
    small = np.array(rows)
    u, udot = rng.uniform(-1.0, 1.0, (2, robot.n)) * small
    if kind == 'closed loop':
        return at_angle(0.7 + 0.3 * seed), u, udot
    q = rng.uniform(-0.8, 0.8, robot.n_q)
    if kind == 'flexible loop':
        q = robot.closed_configuration((0.8 + 0.1 * seed, 0.0, 0.01, -0.02, -1.5),
                                       fixed=robot.speed_names)
    elif robot.equations.in_joint_rates:
        q = q * small
    return (robot.closed_configuration(q, t=T) if kind == 'time-dependent'
            else q), u, udot


def assert_close(value, expected, relative=1e-11):
    """Assert that two arrays agree to a share of the largest entry."""
    size = 1e-2 + np.abs(expected).max(initial=0.0)
    np.testing.assert_allclose(value, expected, rtol=0.0, atol=relative * size)


def expected_slopes(robot, state, t=T):
    subject = robot.model if robot.equations.in_joint_rates else robot.mechanism
    return slopes_of_definition(subject, *state, t)


@pytest.mark.parametrize('kind', KINDS)
def test_inverse_dynamics_derivatives_are_the_definitions(kind):
    robot = robot_of(kind)
    state = state_of(kind)
    expected = expected_slopes(robot, state)
    for one, reference in zip(robot.inverse_dynamics_derivatives(*state, t=T), expected):
        assert_close(one, reference)
    if robot.equations.timed:
        assert_close(robot.derivative('inverse_dynamics', *state, by='t', t=T),
                     expected[3][:, 0])


@pytest.mark.parametrize('kind', KINDS)
def test_forward_dynamics_derivatives_are_the_definitions(kind):
    robot = robot_of(kind)
    q, u, udot = state_of(kind, 1)
    by_q, by_u, M, _ = expected_slopes(robot, (q, u, udot))
    tau = robot.inverse_dynamics(q, u, udot, t=T)
    derivatives = robot.forward_dynamics_derivatives(q, u, tau, t=T)
    for one, counterpart in zip(derivatives, (-by_q, -by_u, np.eye(robot.n))):
        assert_close(M @ one, counterpart, 1e-15 * np.linalg.cond(M) + 1e-10)


@pytest.mark.parametrize('seed', range(8))
def test_derivatives_of_random_mechanisms_with_loops_are_the_definitions(seed):
    loops = random_loops(seed)
    robot = Robot(loops.model, constraints=loops.constraints, configuration=loops.q0)
    q = robot.closed_configuration(loops.q0)
    rng = np.random.default_rng(seed)
    u, udot = rng.uniform(-1.0, 1.0, (2, robot.n))
    program = robot.kernels.program('inverse_dynamics_derivatives')
    value = evaluate(program, [q, u, udot, robot.parameters.block])
    assert_close(value, np.hstack(slopes_of_definition(robot.mechanism, q, u, udot)[:3]),
                 1e-10)


def assert_products_are_those_of_dual_numbers(robot, q, u, udot, t):
    """Require jvp and vjp of all quantities by all inputs; dual numbers are traced."""
    rng = np.random.default_rng(3)
    state = {'q': q, 'u': u, 'udot': udot, 'tau': udot, 't': np.array(t),
             'parameters': robot.parameters.block,
             'wrench': np.ones_like(robot.kernels.no_wrench)}
    quantities = [(name, '')
                  for name in robot.kernels.names if not name.endswith('_derivatives')]
    quantities += [(name, robot.frame_names[-1]) for name in FRAME_QUANTITIES]
    quantities.append(('joint_reaction', robot.model.bodies[-1].joint.name))
    for name, at in quantities:
        shapes = robot.kernels.differentiable(name)
        by = tuple(shapes)
        program = robot.kernels.program(name, at)
        arguments = [state[key] for key, _ in program.inputs]
        tangents = {key: rng.normal(size=shape) for key, shape in shapes.items()}
        # Gravity and payload are parts of the block of parameters.
        of_parameters = np.zeros_like(robot.parameters.block)
        for key in tangents.keys() & PARAMETERS.keys():
            of_parameters[PARAMETERS[key]] = tangents[key]
        changes = tangents | {'parameters': of_parameters}
        numbers = []
        for value, (key, _) in zip(arguments, program.inputs):
            numbers.extend(np.ravel(moving(value, changes[key])))
        expected = rates(inlined(program, numbers)).reshape(program.shape)
        jvp = robot.kernels.program(name, at, Derivative('jvp', by))
        assert_close(evaluate(jvp, [*tangents.values(), *arguments]),
                     expected.astype(float))
        w = rng.normal(size=program.shape)
        vjp = robot.kernels.program(name, at, Derivative('vjp', by))
        gradient = evaluate(vjp, [w, *arguments])
        along = np.concatenate([np.ravel(tangent) for tangent in tangents.values()])
        assert gradient @ along == pytest.approx(np.sum(w * expected), abs=1e-10 * (
            np.linalg.norm(gradient) * np.linalg.norm(along) + 1e-2))


@pytest.mark.parametrize('kind', KINDS)
def test_every_quantity_has_a_vjp_and_a_jvp_by_all_of_its_inputs(kind):
    assert_products_are_those_of_dual_numbers(robot_of(kind), *state_of(kind, 2), T)


@pytest.mark.slow
@pytest.mark.parametrize('kinds', [*PAIRS, (ELASTIC,)], ids=' and '.join)
def test_every_quantity_of_two_kinds_has_a_vjp_and_a_jvp_by_all_of_its_inputs(kinds):
    one = case(*kinds)
    assert_products_are_those_of_dual_numbers(one.robot, one.q, one.u, one.udot,
                                              one.time)


@pytest.mark.parametrize('kind', ['tree', 'chosen speeds'])
def test_derivatives_with_respect_to_wrench_and_parameters(kind):
    robot = robot_of(kind).copy()
    q, u, udot = state_of(kind)
    robot.parameters.payload = PAYLOAD
    push = np.linspace(-1.0, 2.0, 6)[None]
    state = {'q': q, 'u': u, 'udot': udot}
    by = robot.derivative('inverse_dynamics', *state.values(), wrench=push, t=T,
                          by=('wrench', 'gravity', 'payload'))
    assert [x.shape for x in by] == [(4, 1, 6), (4, 3), (4, 10)]
    # The torque is linear in each of them.
    none = np.zeros_like(push)
    t = {'t': T}
    tau = robot.inverse_dynamics(*state.values(), **t)
    assert_close(by[0][:, 0] @ push[0],
                 robot.inverse_dynamics(*state.values(), wrench=push, **t) - tau)
    assert_close(by[0][:, 0] @ push[0], -robot.external_force(q, wrench=push, **t))
    changed = robot.copy()
    changed.parameters.gravity = none[0, :3]
    assert_close(by[1] @ robot.parameters.gravity,
                 tau - changed.inverse_dynamics(*state.values(), **t))
    changed = robot.copy()
    changed.parameters.payload = None
    assert_close(by[2] @ robot.parameters.block[3:13],
                 tau - changed.inverse_dynamics(*state.values(), **t))
    # With a wrench, the matrices differ by the slope of its generalized force.
    matrices = robot.inverse_dynamics_derivatives(*state.values(), wrench=push, **t)
    for one, changed in zip(matrices,
                            robot.derivative('inverse_dynamics', *state.values(),
                                             wrench=push, **t)):
        assert_close(one, changed)
    forward = robot.forward_dynamics(q, u, tau, wrench=push, **t)
    by_q, by_u, M = robot.inverse_dynamics_derivatives(q, u, forward, wrench=push, **t)
    derivatives = robot.forward_dynamics_derivatives(q, u, tau, wrench=push, **t)
    for one, changed in zip(derivatives, (-by_q, -by_u, np.eye(robot.n))):
        assert_close(M @ one, changed, 1e-9)


@pytest.mark.parametrize('kind', ['tree', 'closed loop', 'time-dependent'])
def test_a_batch_of_derivatives_gives_those_of_its_states(kind):
    robot = robot_of(kind)
    count = 5
    t = np.full(5, T)
    states = []
    for x in zip(*(state_of(kind, k) for k in range(count))):
        states.append(np.array(x))
    w = np.random.default_rng(0).normal(size=(count, robot.n))
    gradients = robot.vjp('inverse_dynamics', w, *states, t=t)
    matrices = robot.derivative('inverse_dynamics', *states, t=t)
    changes = robot.jvp('inverse_dynamics', {'u': w}, *states, t=t)
    for k in range(count):
        at_k = [x[k] for x in states]
        for one, batch in zip(robot.vjp('inverse_dynamics', w[k], *at_k, t=T),
                              gradients):
            assert_close(batch[k], one, 1e-13)
        for one, batch in zip(robot.derivative('inverse_dynamics', *at_k, t=T),
                              matrices):
            assert_close(batch[k], one, 1e-13)
        assert_close(changes[k], matrices[1][k] @ w[k], 1e-13)


def test_the_slope_along_an_admissible_motion_is_that_of_the_closed_loop():
    robot = four_bar('crank')
    h = 1e-4
    u = np.array([1.3])
    udot = np.array([0.2])
    along = (robot.derivative('inverse_dynamics', at_angle(0.7), u, udot, by='q')
             @ robot.derivative('joint_rates', at_angle(0.7), u, by='u'))
    torque_after, torque_before = (robot.inverse_dynamics(at_angle(0.7 + s * h), u, udot)
                                   for s in (1.0, -1.0))
    np.testing.assert_allclose(along[0], (torque_after - torque_before) / (2.0 * h),
                               rtol=1e-6)


def test_quantities_of_frames_and_joints_have_derivatives():
    robot = robot_of('tree')
    q, u, udot = state_of('tree')
    tip = robot.model.frames[-1].name
    pose_by_q = robot.derivative(f'frame_pose:{tip}', q, by='q')
    assert_close(pose_by_q[:3, 3], robot.jacobian(tip, q)[:3])
    assert_close(robot.jvp(f'jacobian:{tip}', {'q': u}, q),
                 robot.jacobian_rate(tip, q, u))
    assert_close(robot.vjp(f'frame_velocity:{tip}', np.ones(6), q, u, by='u'),
                 np.ones(6) @ robot.jacobian(tip, q))
    joint = robot.joint_names[0]
    reaction = robot.derivative(f'joint_reaction:{joint}', q, u, udot, by='udot')
    assert_close(reaction @ udot, robot.joint_reaction(joint, q, u, udot)
                 - robot.joint_reaction(joint, q, u, np.zeros(4)))


def test_second_derivatives_are_those_of_the_first():
    robot = robot_of('closed loop')
    q, u, udot = state_of('closed loop')
    name = 'inverse_dynamics_derivatives'
    h = 1e-5
    w = np.zeros(robot.kernels.kernel(name).shape)
    w[0, 1] = 1.0  # dtau/dq_1
    by_q, by_u, _ = robot.vjp(name, w, q, u, udot)
    for k, step in enumerate(h * np.eye(3)):
        slopes = [robot.inverse_dynamics_derivatives(q + s * step, u, udot)[0][0, 1]
                  for s in (1.0, -1.0)]
        assert by_q[k] == pytest.approx((slopes[0] - slopes[1]) / (2.0 * h), rel=1e-6)
    # tau is quadratic in u, so the slope of dtau/dq_1 in u is twice its part in u^2 per
    # u.
    fast, still = (robot.inverse_dynamics_derivatives(q, x * u, 0.0 * u)[0][0, 1]
                   for x in (1.0, 0.0))
    assert_close(by_u * u, 2.0 * (fast - still))


@pytest.mark.parametrize('call, message', [
    (lambda r, s: r.vjp('inverse_dynamic', [1.0], *s), "no kernel 'inverse_dynamic'"),
    (lambda r, s: r.vjp('inverse_dynamics', [1.0], *s[:2]),
     '2 arguments; expected 3: q, u, udot'),
    (lambda r, s: r.vjp('inverse_dynamics', [1.0, 2.0], *s), 'cotangent: shape (2,)'),
    (lambda r, s: r.vjp('inverse_dynamics', [1.0], *s, by='tau'), "by: 'tau'; expected"),
    (lambda r, s: r.vjp('inverse_dynamics', [1.0], *s, by='t'),
     'some of q, u, udot, gravity'),
    (lambda r, s: r.derivative('inverse_dynamics', *s, by=('q', 'q')), 'each once'),
    (lambda r, s: r.derivative('inverse_dynamics', *s, by=()), 'by: none'),
    (lambda r, s: r.derivative('frame_pose:nowhere', s[0]), 'nowhere'),
    (lambda r, s: r.jvp('inverse_dynamics', [1.0], *s), 'tangents: a list'),
    (lambda r, s: r.jvp('inverse_dynamics', {'q': [1.0]}, *s), 'dq: shape (1,)'),
    (lambda r, s: r.vjp('mass_matrix', [[1.0]], s[0], wrench=np.zeros((1, 6))),
     'wrench: given'),
    (lambda r, s: r.derivative(3, *s), 'name: a int')])
def test_a_wrong_call_is_refused_by_name(call, message):
    with pytest.raises(InputError) as error:
        call(robot_of('closed loop'), state_of('closed loop'))
    assert message in str(error.value)


def test_a_fully_driven_mechanism_has_derivatives_by_time_and_empty_matrices():
    b = ModelBuilder('driven')
    b.body('arm', axis=(0, 1, 0), inertial=rod(1.0, (0, 0, 0), (0, 0, 1)))
    robot = Robot(b.model(), constraints=[Prescribed('arm', np.sin)])
    none = np.zeros(0)
    q = robot.closed_configuration([0.0], t=T)
    for matrices in (robot.inverse_dynamics_derivatives(q, none, none, t=T),
                     robot.forward_dynamics_derivatives(q, none, none, t=T)):
        assert [x.shape for x in matrices] == [(0, 1), (0, 0), (0, 0)]
    np.testing.assert_allclose(robot.derivative('joint_rates', q, none, by='t', t=T),
                               [-np.sin(T)], rtol=1e-13)


def test_a_derivative_at_an_open_loop_is_refused():
    robot = robot_of('closed loop')
    q, u, udot = state_of('closed loop')
    with pytest.raises(ConstraintError, match="constraint 'pin/z': its residual"):
        robot.derivative('inverse_dynamics', q + 0.1, u, udot)
    with pytest.raises(ConstraintError, match="constraint 'pin/z': its residual"):
        robot.inverse_dynamics_derivatives(q + 0.1, u, udot)
