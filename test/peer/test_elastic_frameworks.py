"""Elastic joints in batches, regressor, exported C and CasADi: the kernels' values."""

from functools import cache
import subprocess

from kane_dynamics import (Drive, ElasticFeedforward, load_urdf, Robot, StiffnessCurve,
                           with_drives)
from kane_dynamics._util.resources import resource_path
import numpy as np
from numpy.testing import assert_allclose
import pytest


@cache
def elastic_arm():
    """Return the two-link arm with a damped drive and a curve, and a state."""
    model = load_urdf(resource_path('urdf', 'two_link.urdf'))
    first, second = model.joint_names
    drives = {
        first: Drive(800.0, damping=2.0, rotor_inertia=0.2, friction={'damping': 0.3}),
        second: Drive(StiffnessCurve([0.01, 0.03], [2.0, 12.0]), rotor_inertia=0.1)}
    state = np.random.default_rng(7).normal(size=(3, 4))
    state[0, 2:] = state[0, :2] + 0.02 * state[0, 2:]
    return Robot(with_drives(model, drives)), state


def test_batches_are_those_of_single_states():
    robot, _ = elastic_arm()
    states = 0.1 * np.random.default_rng(1).normal(size=(3, 50, 4))
    for name in ('inverse_dynamics', 'forward_dynamics'):
        quantity = getattr(robot, name)
        batch = quantity(*states)
        for k in range(0, 50, 7):
            single = quantity(*states[:, k])
            assert_allclose(batch[k], single,
                            rtol=1e-9, atol=1e-9 * np.abs(single).max())


def test_the_regressor_gives_the_torque_of_the_bodies():
    robot, state = elastic_arm()
    inertia, coriolis, gravity, _, _ = robot.torque_terms(*state)
    rotors = [body.joint.armature for body in robot.model.bodies[2:]]
    expected = inertia + coriolis + gravity
    expected[2:] -= rotors * state[2, 2:]
    assert_allclose(robot.regressor(*state) @ robot.inertial_parameters, expected,
                    rtol=0, atol=1e-11)


def test_casadi_evaluates_and_differentiates_the_torque():
    casadi = pytest.importorskip('casadi')
    robot, state = elastic_arm()
    function = robot.casadi('inverse_dynamics')
    assert_allclose(function(*state).full()[:, 0], robot.inverse_dynamics(*state),
                    rtol=1e-12)
    q = casadi.MX.sym('q', 4)
    slope = casadi.Function('slope', [q], [casadi.jacobian(function(q, *state[1:]), q)])
    expected = robot.inverse_dynamics_derivatives(*state)[0]
    assert_allclose(slope(state[0]).full(), expected, rtol=0,
                    atol=1e-11 * np.abs(expected).max())


@pytest.mark.slow
def test_jax_evaluates_and_differentiates_the_torque():
    jax = pytest.importorskip('jax')
    jax.config.update('jax_enable_x64', True)
    robot, state = elastic_arm()
    function = robot.jax('inverse_dynamics')
    assert_allclose(function(*state), robot.inverse_dynamics(*state), rtol=1e-12)
    expected = robot.inverse_dynamics_derivatives(*state)[0]
    assert_allclose(jax.jacfwd(function)(*state), expected, rtol=0,
                    atol=1e-11 * np.abs(expected).max())


@pytest.mark.slow
def test_torch_evaluates_and_differentiates_the_torque():
    torch = pytest.importorskip('torch')
    robot, state = elastic_arm()
    function = robot.torch('inverse_dynamics')
    q, u, udot = (torch.tensor(x) for x in state)
    assert_allclose(function(q, u, udot), robot.inverse_dynamics(*state), rtol=1e-12)
    slope = torch.autograd.functional.jacobian(lambda x: function(x, u, udot), q)
    expected = robot.inverse_dynamics_derivatives(*state)[0]
    assert_allclose(slope, expected, rtol=0, atol=1e-11 * np.abs(expected).max())


def test_exported_c_passes_its_self_test(tmp_path):
    """With the feedforward of the undamped arm, as a kernel of its own."""
    robot, _ = elastic_arm()
    undamped = Robot(robot.model, friction=False)
    feedforward = ElasticFeedforward(undamped)
    undamped.export_c(tmp_path / 'arm.c', ['inverse_dynamics', 'forward_dynamics',
                                           feedforward.kernel])
    main = tmp_path / 'main.c'
    main.write_text('#include "arm.h"\nint main(void) { return arm_self_test(); }\n')
    program = tmp_path / 'program'
    subprocess.run(['gcc', '-O1', str(main), str(tmp_path / 'arm.c'), '-o', str(program),
                    '-lm'], check=True)
    subprocess.run([str(program)], check=True)
