"""Functions for CasADi: values, derivatives of both orders, batches, optimal control."""

from functools import cache
import sys

from framework_states import arm, driven
from kane_dynamics import (ConstraintError, InputError, load_urdf, ModelBuilder, Robot,
                           rod, Speeds)
from linkages import at_angle, four_bar
import numpy as np
import pytest

casadi = pytest.importorskip('casadi')
MOST = 20.0  # N m


@cache
def driven_linkage():
    """Return a four-bar on a turntable whose crank moves in a given way."""
    return driven(turntable=True)


@cache
def branching():
    """Return a pendulum whose speed has an infinite slope in a branch not taken."""
    b = ModelBuilder('pendulum')
    b.body('bar', axis=(0, 1, 0), inertial=rod(2.0, (0, 0, 0), (0, 0, -0.8)))
    return Robot(b.model(), speeds=Speeds(lambda q, t: np.array([[1.0 + np.where(
        q[0] < 0.0, np.exp(q[0]) + np.arctan(q[0]), np.log(1.0 + q[0]))]])))


def state_of(robot):
    """Return a closed configuration of a robot, speeds and their rates."""
    rng = np.random.default_rng(3)
    q = {four_bar(): at_angle(0.7), driven_linkage(): np.r_[0.3, at_angle(0.7)],
         branching(): np.array([-1.0])}.get(robot)
    return (rng.normal(size=robot.n_q) if q is None else q,
            rng.normal(size=robot.n), rng.normal(size=robot.n))


def arguments_of(robot, function):
    """Return the arguments of a function, in its order, by name."""
    q, u, rates = state_of(robot)
    arguments = {'q': q, 'u': u, 'udot': rates, 'tau': rates, 't': 0.0,
                 'wrench': np.array([[1.0, -2.0, 3.0, 0.4, 0.5, -0.6]])}
    return {name: arguments[name] for name in function.name_in()}


def hessian(function):
    """Return the second derivative of a weighted result by all arguments."""
    shapes = [function.size_in(k) for k in range(function.n_in())]
    ends = np.cumsum([0, *(rows * columns for rows, columns in shapes)]).tolist()
    z = casadi.MX.sym('z', ends[-1])
    parts = [casadi.reshape(part, *shape)
             for part, shape in zip(casadi.vertsplit(z, ends), shapes)]
    y = casadi.vec(function(*parts))
    weights = casadi.DM(np.linspace(0.7, -1.3, y.numel()))
    return casadi.Function('hessian', [z],
                           [casadi.hessian(casadi.dot(weights, y), z)[0]])


@pytest.mark.parametrize('robot, name', [
    (arm, 'inverse_dynamics'), (arm, 'forward_dynamics'), (arm, 'mass_matrix'),
    (arm, 'frame_pose:tip'), (arm, 'jacobian:tip'), (arm, 'kinetic_energy'),
    (four_bar, 'inverse_dynamics'), (four_bar, 'forward_dynamics'),
    (driven_linkage, 'inverse_dynamics'),
    (branching, 'inverse_dynamics')])
def test_values_and_jacobians_are_the_robots(robot, name):
    robot = robot()
    function = robot.casadi(name)
    assert function.class_name() == 'SXFunction'
    inputs = arguments_of(robot, function)
    state = [x for key, x in inputs.items() if key not in ('wrench', 't')]
    loads = {key: inputs[key] for key in ('wrench', 't') if key in inputs}
    quantity, _, frame = name.partition(':')
    value = np.asarray(
        getattr(robot, quantity)(*([frame] if frame else []), *state, **loads))
    values = np.array(function(*inputs.values())).reshape(value.shape)
    np.testing.assert_allclose(values, value, rtol=1e-12, atol=1e-12)
    slopes = robot.derivative(name, *state, by=tuple(inputs), **loads)
    results = function.jacobian()(*inputs.values(), 0)
    results = results if isinstance(results, tuple) else (results,)
    for key, slope, result in zip(inputs, slopes, results, strict=True):
        # CasADi numbers the entries of matrices column by column.
        by_entry = np.array(slope).reshape(value.size, *np.shape(inputs[key]))
        columns = np.array([row.ravel(order='F') for row in by_entry])
        rows = np.arange(value.size).reshape(value.shape).ravel(order='F')
        np.testing.assert_allclose(np.array(result), columns[rows], rtol=1e-9, atol=1e-9,
                                   err_msg=key)


def test_a_batch_by_map_has_the_values_and_derivatives_of_its_states():
    robot = Robot(load_urdf('urdf/two_link.urdf'))
    function = robot.casadi('inverse_dynamics')
    q, u, udot = np.random.default_rng(5).normal(size=(3, 4, 2))
    expected = robot.inverse_dynamics(q, u, udot)
    for parallelization in ('serial', 'thread'):
        threads = (2,) if parallelization == 'thread' else ()
        batch = function.map(4, parallelization, *threads)
        values = np.array(batch(q.T, u.T, udot.T)).T
        np.testing.assert_allclose(values, expected, rtol=1e-12, atol=1e-12)
    slopes = robot.inverse_dynamics_derivatives(q, u, udot)
    jacobians = function.map(4).jacobian()(q.T, u.T, udot.T, 0)
    # A state moves no torque of another: its block is on the diagonal.
    for jacobian, blocks in zip(jacobians, slopes):
        for k, block in enumerate(blocks):
            place = slice(2 * k, 2 * k + 2)
            np.testing.assert_allclose(np.array(jacobian)[place, place], block,
                                       rtol=1e-9, atol=1e-9)
    everything = np.concatenate([q.ravel(), u.ravel(), udot.ravel()])
    assert np.isfinite(np.array(hessian(function.map(4))(everything))).all()


def swing(robot):
    """Return an optimal swing of two links in limits: arguments, torques, solution."""
    steps = 20
    h = 0.05
    dynamics = robot.casadi('inverse_dynamics')
    problem = casadi.Opti()
    q = problem.variable(2, steps + 1)
    u = problem.variable(2, steps + 1)
    udot = problem.variable(2, steps)
    tau = casadi.horzcat(*(dynamics(q[:, k], u[:, k], udot[:, k]) for k in range(steps)))
    problem.subject_to(u[:, 1:] == u[:, :-1] + h * udot)
    problem.subject_to(q[:, 1:] == q[:, :-1] + h * u[:, 1:])
    problem.subject_to(q[:, 0] == 0.0)
    problem.subject_to(q[:, -1] == np.array([0.8, -0.5]))
    problem.subject_to(casadi.vec(u[:, [0, -1]]) == 0.0)
    problem.subject_to(problem.bounded(-MOST, casadi.vec(tau), MOST))
    problem.minimize(casadi.sumsqr(tau))
    problem.solver('ipopt', {'print_time': False, 'ipopt.print_level': 0,
                             'ipopt.sb': 'yes', 'ipopt.tol': 1e-9})
    solution = problem.solve()
    assert solution.stats()['success'] and solution.stats()['iter_count'] < 50
    arguments = [solution.value(x).T.copy() for x in (q[:, :-1], u[:, :-1], udot)]
    return arguments, solution.value(tau).T, solution.value(problem.f)


def test_ipopt_swings_two_links_within_their_torques():
    robot = Robot(load_urdf('urdf/two_link.urdf'))
    arguments, expected, _ = swing(robot)
    np.testing.assert_allclose(robot.inverse_dynamics(*arguments), expected, rtol=1e-12,
                               atol=1e-9)
    largest = np.abs(expected).max()
    assert 0.99 * MOST < largest < MOST * (1.0 + 1e-6)  # the limit acts


def test_parameters_are_arguments_or_keep_their_values():
    robot = arm().copy()
    fixed = robot.casadi('gravity_force')
    free = robot.casadi('gravity_force', parameters=['payload', 'gravity'])
    assert free.name_in() == ['q', 'gravity', 'payload']
    q = np.array([0.4, -0.8])
    torque_before = robot.gravity_force(q)
    robot.parameters.payload = None
    robot.parameters.gravity = (0.5, 1.0, -3.0)
    np.testing.assert_allclose(np.array(fixed(q)).ravel(), torque_before, rtol=1e-12)
    np.testing.assert_allclose(np.array(free(q, [0.5, 1.0, -3.0], np.zeros(10))).ravel(),
                               robot.gravity_force(q), rtol=1e-12)
    slope = free.jacobian()(q, [0.5, 1.0, -3.0], np.zeros(10), 0)[2]
    np.testing.assert_allclose(np.array(slope),
                               robot.derivative('gravity_force', q, by='payload'),
                               rtol=1e-9, atol=1e-9)


def test_nan_and_open_loops_give_nan():
    function = four_bar().casadi('inverse_dynamics')
    q, u, udot = state_of(four_bar())
    assert np.isnan(np.array(function(q + [0.0, 0.3, 0.0], u, udot))).any()
    with pytest.raises(ConstraintError, match='residual'):
        four_bar().inverse_dynamics(q + [0.0, 0.3, 0.0], u, udot)
    simple = arm().casadi('gravity_force')
    assert np.isnan(np.array(simple([np.nan, 0.0]))).any()


@pytest.mark.parametrize('name, options, message', [
    ('inverse_dynamic', {},
     "no kernel 'inverse_dynamic' for this robot; expected one of"),
    ('frame_pose:top', {}, 'top'),
    (3, {}, 'name: a int; expected the name of a quantity'),
    ('gravity_force', {'parameters': ['q']},
     ("parameters: 'q'; expected for "
      'gravity_force of this robot some of gravity, payload')),
    ('frame_pose:tip', {'parameters': 'gravity'},
     "parameters: 'gravity'; expected for frame_pose of this robot some of none")])
def test_wrong_names_are_refused_with_the_valid_ones(name, options, message):
    with pytest.raises(InputError, match=message):
        arm().casadi(name, **options)


def test_casadi_refuses_an_unknown_argument_and_a_wrong_shape():
    function = arm().casadi('gravity_force')
    with pytest.raises(RuntimeError, match='gravity_force'):
        function(np.zeros(3))
    with pytest.raises(RuntimeError, match='qdot'):
        function(qdot=np.zeros(2))


def test_without_casadi_the_error_names_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, 'casadi', None)
    with pytest.raises(InputError,
                       match=r'robot.casadi: .*pip install .kane_dynamics\[casadi\]'):
        arm().casadi('gravity_force')
