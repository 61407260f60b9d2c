"""Agreement of definition, recursion, compiled code, energies; payload, mimics."""

from dataclasses import replace

from definition import Definition
import energies
from hypothesis import given, strategies as st
from kane_dynamics import Robot
from kane_dynamics.mechanics.definition import kane
from kane_dynamics.model.model import with_payload
from kane_dynamics.native.runtime.kernel import Argument, Kernel
from kane_dynamics.native.tracing.program import trace_program
from mechanisms import random_inertial, random_model, random_state
import numpy as np
import pytest
from strategies import robots_and_states

PUSH = np.array([[1.0, -2.0, 0.5, 0.3, 0.1, -0.7]])


def close(value, expected, size, tolerance=1e-11):
    """Assert agreement relative to the size of the terms."""
    np.testing.assert_allclose(value, expected, rtol=0.0, atol=tolerance * (1e-3 + size))


def reference(robot):
    """Return the reference formulation of a drawn robot."""
    return Definition(robot.model, wrench_frames=(robot.model.frames[-1].name,))


@given(robots_and_states(3))
def test_compiled_dynamics_are_the_definitions(drawn):
    robot, q, u, udot = drawn
    by_definition = reference(robot)
    size = np.abs(robot.torque_terms(q, u, udot)).max()
    M = by_definition.mass_matrix(q)
    for push in (None, PUSH):
        close(robot.inverse_dynamics(q, u, udot, wrench=push),
              by_definition.inverse_dynamics(q, u, udot, wrench=push), size)
        close(robot.forward_dynamics(q, u, udot, wrench=push),
              by_definition.forward_dynamics(q, u, udot, wrench=push),
              size * np.linalg.norm(np.linalg.inv(M), 2) * np.linalg.cond(M), 1e-14)
    close(robot.mass_matrix(q), M, np.abs(M).max())
    close(robot.bias_force(q, u), by_definition.bias_force(q, u), size)
    close(robot.gravity_force(q), by_definition.gravity_force(q), size)


@given(robots_and_states(3))
def test_compiled_frames_are_the_definitions(drawn):
    robot, q, u, udot = drawn
    by_definition = reference(robot)
    frame = robot.model.frames[-1].name
    for name, state in (('frame_pose', (q,)), ('jacobian', (q,)),
                        ('jacobian_rate', (q, u)),
                        ('frame_velocity', (q, u)),
                        ('frame_acceleration', (q, u, udot))):
        expected = getattr(by_definition, name)(frame, *state)
        close(getattr(robot, name)(frame, *state), expected,
              1.0 + np.abs(expected).max())


@given(robots_and_states(3))
def test_recursion_on_numbers_is_what_was_compiled(drawn):
    robot, q, u, udot = drawn
    equations = robot.equations
    parameters = robot.parameters.block
    size = np.abs(robot.torque_terms(q, u, udot)).max()
    close(equations.inverse_dynamics(q, u, udot, PUSH, parameters).astype(float),
          robot.inverse_dynamics(q, u, udot, wrench=PUSH), size)
    close(equations.mass_matrix(q, parameters).astype(float), robot.mass_matrix(q),
          np.abs(robot.mass_matrix(q)).max())


@given(robots_and_states(3))
def test_energy_formulation_gives_kanes_generalized_forces(drawn):
    robot, q, u, udot = drawn
    model = robot.model
    inertia_force = energies.generalized_inertia_force(model, q, u, udot)
    size = np.abs(robot.torque_terms(q, u, udot)).max()
    close(kane.generalized_inertia_force(model, q, u, udot), inertia_force, size)
    rigid = inertia_force + energies.conservative_force(model, q)
    close(robot.inverse_dynamics(q, u, udot) - robot.friction_force(u), -rigid, size)


@given(robots_and_states(2))
def test_energy_formulation_gives_energies_and_mass_matrix(drawn):
    robot, q, u = drawn
    M = energies.mass_matrix(robot.model, q)
    close(robot.mass_matrix(q), M, np.abs(M).max())
    close(robot.kinetic_energy(q, u), energies.kinetic_energy(robot.model, q, u),
          np.abs(M).max() * (u @ u))
    potential = energies.potential_energy(robot.model, q)
    close(robot.potential_energy(q), potential, 100.0 + abs(potential))


@given(robots_and_states(3, most=3))
def test_reference_formulation_accepts_traced_scalars(drawn):
    robot, q, u, udot = drawn
    arguments = [Argument(name, (robot.n,)) for name in ('q', 'u', 'udot')]

    def definition(q, u, udot, parameters):
        return kane.inverse_dynamics(robot.model, q, u, udot, gravity=parameters)
    inputs = [*((argument.name, argument.shape) for argument in arguments),
              ('parameters', (3,))]
    kernel = Kernel('definition',
                    lambda: trace_program('definition', definition, inputs), None,
                    arguments, robot.parameters.block, (robot.n,))
    size = np.abs(robot.torque_terms(q, u, udot)).max()
    close(kernel(q, u, udot), robot.inverse_dynamics(q, u, udot), size)


def freed(model):
    """Return the model with free mimic joints, and G and g of q_free = G q + g."""
    bodies = [replace(body, joint=replace(body.joint,
                                          coordinate=k, multiplier=1.0, offset=0.0))
              for k, body in enumerate(model.bodies)]
    G = np.zeros((len(bodies), model.n))
    g = np.zeros(len(bodies))
    for k, body in enumerate(model.bodies):
        G[k, body.joint.coordinate] = body.joint.multiplier
        g[k] = body.joint.offset
    names = tuple(body.joint.name for body in bodies)
    return replace(model, bodies=tuple(bodies), coordinate_names=names), G, g


@pytest.mark.parametrize('engine', [Definition, Robot])
@pytest.mark.parametrize('seed', range(5))
def test_mimics_are_the_projection_of_the_free_mechanism(engine, seed):
    model = random_model(seed, 3, mimics=3)
    free_model, G, g = freed(model)
    robot = engine(model)
    free = engine(free_model)
    q, u, udot = random_state(model, seed)
    Q = G @ q + g
    U = G @ u
    Udot = G @ udot
    tau = free.inverse_dynamics(Q, U, Udot)
    close(robot.inverse_dynamics(q, u, udot), G.T @ tau, np.abs(tau).max())
    M = free.mass_matrix(Q)
    close(robot.mass_matrix(q), G.T @ M @ G, np.abs(M).max())
    assert robot.kinetic_energy(q, u) == pytest.approx(free.kinetic_energy(Q, U),
                                                       rel=1e-12)
    assert robot.potential_energy(q) == pytest.approx(free.potential_energy(Q),
                                                      rel=1e-12)


@given(st.integers(0, 20), st.floats(0.0, 10.0))
def test_payload_and_gravity_as_parameters_are_those_of_the_model(seed, share):
    model = random_model(seed, 4, mimics=seed % 2)
    frame = model.frames[seed % len(model.frames)].name
    robot = Robot(model, payload_frame=frame)
    inertial = random_inertial(np.random.default_rng(seed))
    payload = replace(inertial, mass=share * inertial.mass,
                      inertia=share * inertial.inertia)
    gravity = np.array([share, -1.0, 3.0])
    robot.parameters.payload = payload
    robot.parameters.gravity = gravity
    loaded = Definition(with_payload(replace(model, gravity=gravity), frame, payload))
    q, u, udot = random_state(model, seed)
    tau = loaded.inverse_dynamics(q, u, udot)
    close(robot.inverse_dynamics(q, u, udot), tau, np.abs(tau).max())
    M = loaded.mass_matrix(q)
    close(robot.mass_matrix(q), M, np.abs(M).max())
    close(robot.kinetic_energy(q, u), loaded.kinetic_energy(q, u),
          np.abs(M).max() * (u @ u))


def test_friction_is_viscous_plus_smoothed_coulomb_at_the_joints_own_rate():
    model = random_model(0, 1, mimics=1)
    driving, mimic = [body.joint for body in model.bodies]
    rate = 0.04
    follow = mimic.multiplier * rate

    def held(joint, speed):
        return (joint.damping * speed + joint.friction
                * np.tanh(speed / joint.friction_speed) + joint.friction_offset)
    by_hand = held(driving, rate) + mimic.multiplier * held(mimic, follow)
    q = np.zeros(1)
    u = np.array([rate])
    for engine in (Definition, Robot):
        lost = (engine(model).bias_force(q, u)
                - engine(model, friction=False).bias_force(q, u))
        assert lost[0] == pytest.approx(by_hand, rel=1e-12)


def tilted(model, angle):
    """Return the model with axes, frames and offsets rotated by an angle, rad."""
    c = np.cos(angle)
    s = np.sin(angle)
    turn = np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
    return replace(model, bodies=tuple(
        replace(body, joint=replace(body.joint, axis=turn @ body.joint.axis,
                                    rotation=turn @ body.joint.rotation @ turn,
                                    offset=body.joint.offset + 0.5 * np.pi + angle))
        for body in model.bodies))


@pytest.mark.parametrize('angle', [1e-3, 1e-5, 1e-7, 1e-8, 1e-9, 1e-11, 1e-13, 0.0])
@pytest.mark.parametrize('seed', range(3))
def test_nearly_principal_axes_lose_no_digits(seed, angle):
    model = tilted(random_model(seed, 5, axes='principal'), angle)
    robot = Robot(model)
    by_definition = Definition(model)
    q, u, udot = random_state(model, seed)
    size = np.abs(robot.torque_terms(q, u, udot)).max()
    close(robot.inverse_dynamics(q, u, udot), by_definition.inverse_dynamics(q, u, udot),
          size, 1e-13)
    frame = model.frames[-1].name
    close(robot.frame_pose(frame, q), by_definition.frame_pose(frame, q), 1.0, 1e-13)
