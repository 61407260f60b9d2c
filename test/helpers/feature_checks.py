"""
Checks of features on `kinds_of_mechanism`, each by an independent formulation.

A check takes a case and fails unless the robot's result is that of Kane's definition, of
the energies, or of a derivative of one of these.
"""

import ctypes
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
import pickle
import subprocess
from tempfile import TemporaryDirectory

import energies
from kane_dynamics import (box, CollisionDetector, ComputedTorque, Controller,
                           fill_trajectory, Inertial, MomentumObserver, Motion,
                           natural_vibration, QuasiStatic, Robot, simulate, stiffened)
from kane_dynamics.analysis.power_balance import power_balance
from kane_dynamics.control.controller import Mode
from kane_dynamics.feasibility import demand, fastest, time_optimal
from kane_dynamics.identification import PayloadEstimator
from kane_dynamics.identification.payload.payload_rows import PayloadRegressor
from kane_dynamics.loop_tracking.driven_mechanism import mechanism_motion
from kane_dynamics.mechanics.ball_joints import (balls, coordinate_rates,
                                                 moved as joints_moved)
from kane_dynamics.mechanics.definition import kane, kinematics, nonholonomic
from kane_dynamics.mechanics.integrators import INTEGRATORS
from kane_dynamics.mechanics.recursive.regressor import parameters_of
from kane_dynamics.model.model import Body, Joint, with_payload
from kane_dynamics.optimal_control import TrajectoryOptimizer
from kane_dynamics.robot.frameworks.batch_function import batch_function
from kane_dynamics.robot.verification import without_rotors
from kane_dynamics.sweep import Sweep
from kane_dynamics.sweep.simulator import Simulator
from mechanisms import with_friction_times, with_inertia_in
import numpy as np
from same_numbers import assert_same_numbers

TOLERANCE = 1e-11
CLOSED = 1e-9  # through derivatives of positions
TOOL = 'tool'


def assert_close(value, expected, tolerance=TOLERANCE):
    """Fail unless two results agree, relative to the largest entry."""
    value = np.asarray(value, dtype=float)
    expected = np.asarray(expected, dtype=float)
    assert value.shape == expected.shape, (value.shape, expected.shape)
    size = max(1.0, np.abs(expected).max(initial=0.0))
    np.testing.assert_allclose(value, expected, rtol=0.0, atol=tolerance * size)


def slope(function, h=4e-3):
    """Return a derivative at 0 of a function of one number, to 8th order in h."""
    weights = {1: 4 / 5, 2: -1 / 5, 3: 4 / 105, 4: -1 / 280}
    return sum(w / h * (function(k * h) - function(-k * h)) for k, w in weights.items())


def along(case, function):
    """Return the time derivative of a function of q and t along the motion."""
    return slope(lambda s: function(case.q + s * case.q_rate, case.time + s))


def moved(case, q, t):
    """Return T of the definition at another configuration and time."""
    parts = nonholonomic.reduction(case.mechanism, q, t)
    dependent = nonholonomic.dependent_places(case.mechanism)
    return parts.W[:, case.mechanism.free] + parts.W[:, dependent] @ parts.A


def inverse(case, u=None, udot=None, **forces):
    """Return inverse dynamics by Kane's definition."""
    return nonholonomic.inverse_dynamics(
        case.mechanism, case.q, case.u if u is None else u,
        case.udot if udot is None else udot, case.time, **forces)


def reduced(case, force):
    """Return a joint force by the independent speeds."""
    return case.T.T @ force


def inverse_dynamics(case):
    push = np.linspace(-1.0, 1.0, 6)
    tau = case.robot.inverse_dynamics(case.q, case.u, case.udot,
                                      wrench=push[None], **case.t)
    assert_close(tau, inverse(case, wrenches={TOOL: (push[:3], push[3:])}))


def forward_dynamics(case):
    tau = inverse(case)
    M = nonholonomic.mass_matrix(case.mechanism, case.q, case.time)
    udot = case.robot.forward_dynamics(case.q, case.u, tau, **case.t)
    assert_close(udot, case.udot, TOLERANCE * max(1.0, np.linalg.cond(M) * 1e-3))


def mass_matrix(case):
    M = nonholonomic.mass_matrix(case.mechanism, case.q, case.time)
    assert_close(case.robot.mass_matrix(case.q, **case.t), M)
    assert_close(case.robot.inverse_mass_matrix(case.q, **case.t) @ M, np.eye(len(M)))


def bias(case):
    assert_close(case.robot.bias_force(case.q, case.u, **case.t),
                 inverse(case, udot=0.0 * case.u))


def gravity(case):
    force = kane.gravity_force(case.robot.model, case.q)
    assert_close(case.robot.gravity_force(case.q, **case.t), reduced(case, force))


def friction_of_joints(case):
    """Return the friction of the joints by the definition, (n_q,)."""
    model = case.robot.model
    qdot, _ = case.joint_motion
    return (kane.generalized_active_force(model, case.q, qdot, friction=False)
            - kane.generalized_active_force(model, case.q, qdot))


def friction(case):
    force = reduced(case, friction_of_joints(case))
    arguments = (case.u,) if case.name in ('tree', 'flexible') else (case.u, case.q)
    assert_close(case.robot.friction_force(*arguments, **case.t), force)


def brackets_of(model):
    """Return the Lie brackets of the joints' motions, (n, n, n): ball joints e x e."""
    brackets = np.zeros((model.n,) * 3)
    for body in model.balls:
        r = model.bodies[body].joint.coordinate
        brackets[r:r + 3, r:r + 3, r:r + 3] = [np.cross(e, np.eye(3)) for e in np.eye(3)]
    return brackets


def coriolis(case):
    C = case.robot.coriolis_matrix(case.q, case.u, **case.t)
    model = case.robot.model
    qdot, _ = case.joint_motion

    def M(q, t):
        return kane.mass_matrix(model, q)

    def reduced_M(q, t):
        return nonholonomic.mass_matrix(case.mechanism, q, t)
    assert_close(C + C.T, along(case, reduced_M), CLOSED)
    n = model.n
    by_q = np.array(
        [slope(lambda s, k=k: M(joints_moved(model, case.q, s * np.eye(n)[k]), 0.0))
         for k in range(n)])
    # Koszul's formula: brackets of the joints' motions, which are those of angular
    # velocities.
    brackets = np.einsum('kjl,li->kji', brackets_of(model), M(case.q, 0.0))
    christoffel = 0.5 * (np.einsum('kij,k->ij', by_q, qdot)
                         + np.einsum('jik,k->ij', by_q, qdot)
                         - np.einsum('ijk,k->ij', by_q, qdot)
                         + np.einsum('kji,k->ij', brackets, qdot)
                         - np.einsum('jik,k->ij', brackets, qdot)
                         + np.einsum('ikj,k->ij', brackets, qdot))
    T_rate = along(case, partial(moved, case))
    assert_close(C, case.T.T @ (christoffel @ case.T + M(case.q, 0.0) @ T_rate), CLOSED)
    if not case.t:  # C u is the force of the speeds
        at_rest = inverse(case, 0.0 * case.u, 0.0 * case.u)
        force = inverse(case, udot=0.0 * case.u, friction=False) - inverse(
            case, 0.0 * case.u, 0.0 * case.u, friction=False)
        assert_close(C @ case.u, force + 0.0 * at_rest)


@cache
def torque_slopes(case):
    """Return the derivatives of the definition's torque by q and by u."""
    by_q = [slope(lambda s, e=e: nonholonomic.inverse_dynamics(
        case.mechanism, case.q + s * e, case.u, case.udot, case.time))
        for e in np.eye(case.robot.n_q)]
    by_u = [slope(lambda s, e=e: inverse(case, case.u + s * e))
            for e in np.eye(case.robot.n)]
    return np.array(by_q).T, np.array(by_u).T


def inverse_derivatives(case):
    tau_q, tau_u, M = case.robot.inverse_dynamics_derivatives(
        case.q, case.u, case.udot, **case.t)
    by_q, by_u = torque_slopes(case)
    assert_close(tau_q, by_q, CLOSED)
    assert_close(tau_u, by_u, CLOSED)
    assert_close(M, nonholonomic.mass_matrix(case.mechanism, case.q, case.time))


def forward_derivatives(case):
    tau = inverse(case)
    udot_q, udot_u, W = case.robot.forward_dynamics_derivatives(
        case.q, case.u, tau, **case.t)
    by_q, by_u = torque_slopes(case)
    M = nonholonomic.mass_matrix(case.mechanism, case.q, case.time)
    assert_close(-M @ udot_q, by_q, CLOSED)
    assert_close(-M @ udot_u, by_u, CLOSED)
    assert_close(W @ M, np.eye(len(M)), CLOSED)


def partials(case, q, t):
    """Return the Jacobian of the tool by the definition."""
    return kane.partial_velocities(case.robot.model, q, TOOL) @ moved(case, q, t)


def jacobian(case):
    assert_close(case.robot.jacobian(TOOL, case.q, **case.t),
                 partials(case, case.q, case.time))
    assert_close(case.robot.jacobian_rate(TOOL, case.q, case.u, **case.t),
                 along(case, partial(partials, case)), CLOSED)


def frames(case):
    robot = case.robot
    qdot, qddot = case.joint_motion
    J = kane.partial_velocities(robot.model, case.q, TOOL)
    assert_close(robot.frame_velocity(TOOL, case.q, case.u, **case.t), J @ qdot)
    J_rate = slope(
        lambda s: kane.partial_velocities(robot.model, case.q + s * case.q_rate, TOOL))
    assert_close(robot.frame_acceleration(TOOL, case.q, case.u, case.udot, **case.t),
                 J @ qddot + J_rate @ qdot, CLOSED)


def kinetic_and_potential_energy(case):
    model = case.robot.model
    qdot, _ = case.joint_motion
    assert_close(case.robot.kinetic_energy(case.q, case.u, **case.t),
                 energies.kinetic_energy(model, case.q, qdot))
    assert_close(case.robot.potential_energy(case.q),
                 energies.potential_energy(model, case.q))


def on_free_base(model):
    """Return the model on a base of six massless joints, the last coordinates."""
    names = []
    bodies = []
    for k, kind in enumerate(['prismatic'] * 3 + ['revolute'] * 3):
        joint = Joint(f'base/{k}', kind, np.eye(3)[k % 3], coordinate=model.n + k)
        bodies.append(Body(joint.name, k - 1, joint, Inertial()))
        names.append(joint.name)
    for body in model.bodies:
        bodies.append(replace(body, parent=body.parent + 6))
    return replace(model, bodies=tuple(bodies), frames=(),
                   balls=tuple(ball + 6 for ball in model.balls),
                   coordinate_names=(*model.coordinate_names, *names))


def momentum(model, q, qdot):
    """Return the centroidal momentum by the definition, from M on a free base."""
    M = kane.mass_matrix(on_free_base(model), np.concatenate([q, np.zeros(6)]))
    wrench = M[-6:, :-6] @ qdot
    # The block of the base is m (c x) below the mass.
    mass = M[-6, -6]
    c = np.array([M[-1, -5], M[-3, -4], M[-2, -6]]) / mass
    return c, np.concatenate([wrench[:3], wrench[3:] - np.cross(c, wrench[:3])])


def centroidal(case):
    robot = case.robot
    model = robot.model
    qdot, qddot = case.joint_motion
    center, expected = momentum(model, case.q, qdot)
    assert_close(robot.center_of_mass(case.q, **case.t), center)
    assert_close(robot.centroidal_momentum(case.q, case.u, **case.t), expected)
    at_rest = robot.centroidal_momentum(case.q, 0.0 * case.u, **case.t)
    A = robot.centroidal_momentum_matrix(case.q, **case.t)
    assert_close(A @ case.u + at_rest, expected)

    def at_time(s):
        return momentum(model, case.q + s * case.q_rate, qdot + s * qddot)[1]
    rate = slope(at_time)
    assert_close(robot.centroidal_momentum_rate(case.q, case.u, case.udot, **case.t),
                 rate, CLOSED)


def rigid(case):
    """Return the torque of inertia and weight without rotors, by the definition."""
    model = case.robot.model
    qdot, qddot = case.joint_motion
    force = kane.generalized_inertia_force(without_rotors(model), case.q, qdot, qddot)
    return reduced(case, kane.gravity_force(model, case.q) - force)


def sources(case):
    robot = case.robot
    push = np.linspace(-1.0, 1.0, 6)
    terms = robot.torque_terms(case.q, case.u, case.udot, **case.t)
    model = robot.model
    qdot, qddot = case.joint_motion
    still = kane.generalized_active_force(model, case.q, 0.0 * qdot, friction=False)
    weight = kane.gravity_force(model, case.q)
    M = nonholonomic.mass_matrix(case.mechanism, case.q, case.time)
    inertia = reduced(case, -kane.generalized_inertia_force(model, case.q, qdot, qddot))
    expected = [M @ case.udot, inertia - M @ case.udot, reduced(case, weight),
                reduced(case, friction_of_joints(case)), reduced(case, -still - weight)]
    assert_close(terms, expected)
    assert_close(robot.external_force(case.q, wrench=push[None], **case.t),
                 reduced(case, kane.partial_velocities(model, case.q, TOOL).T @ push))


def by_body(case):
    """Compare each row with the definition's torque where only this body has inertia."""
    model = case.robot.model
    qdot, qddot = case.joint_motion

    def torque(*bodies):
        return reduced(case, kane.inverse_dynamics(with_inertia_in(model, bodies),
                                                   case.q, qdot, qddot))
    every = range(len(model.bodies))
    torques = case.robot.body_torques(case.q, case.u, case.udot, **case.t)
    assert_close(torques, [torque(k) for k in every])
    assert_close(torques.sum(axis=0), torque(*every))


def regressor(case):
    Y = case.robot.regressor(case.q, case.u, case.udot, **case.t)
    assert_close(Y @ case.robot.inertial_parameters, rigid(case))


def constants(case):
    """Compare torques with constants as arguments with those of another model."""
    robot = case.robot
    model = robot.model
    names = ['inertial_parameters', 'damping', 'friction']
    function = batch_function(robot, 'inverse_dynamics', '', names)
    joints = model.coordinate_joints
    values = [robot.inertial_parameters * 1.25,
              np.array([1.5 * joint.damping for joint in joints]),
              np.array([joint.friction + 0.1 for joint in joints])]
    bodies = []
    for body in model.bodies:
        joint = body.joint
        changed = replace(joint, damping=1.5 * joint.damping,
                          friction=joint.friction + 0.1)
        inertial = Inertial.from_pseudo_inertia(1.25 * body.inertial.pseudo_inertia)
        bodies.append(replace(body, joint=changed, inertial=inertial))
    heavier = Robot(replace(model, bodies=tuple(bodies)), **robot.options)
    by_name = {'q': case.q, 'u': case.u, 'udot': case.udot, 'wrench': np.zeros((1, 6)),
               't': np.array(case.time), **dict(zip(names, values))}
    arguments = [by_name[argument.name] for argument in function.arguments]
    assert_close(function(arguments),
                 heavier.inverse_dynamics(case.q, case.u, case.udot, **case.t))


def joint_reactions(case):
    """
    Compare reactions with the torque that reaches each link, and with Newton's law.

    Joints that follow a motion have an actuator of their own; joints on beams carry its
    moments.
    """
    robot = case.robot
    model = case.robot.model
    qdot, qddot = case.joint_motion
    tau = inverse(case)
    reactions = robot.joint_reactions(case.q, case.u, case.udot, **case.t)
    still = replace(model, gravity=np.zeros(3))
    passive = friction_of_joints(case) - kane.generalized_active_force(
        still, case.q, 0.0 * qdot, friction=False)
    rows = case.mechanism.rows(case.mechanism.state(case.q, case.time))
    J = np.array(rows.J, dtype=float).reshape(-1, model.n)
    driven = [k for k, owner in enumerate(case.mechanism.owners)
              if owner.startswith('drive')]
    forces = robot.constraint_forces(case.q, case.u, tau,
                                     **case.t) if len(J) else np.zeros(0)
    applied = robot.joint_torques(tau, case.q, **case.t) + J[driven].T @ forces[driven]
    for k, body in enumerate(model.bodies):
        if body.joint.deflection is None:
            j = body.joint.coordinate
            axis = kinematics.configurations(model, case.q)[k].axis
            part = (reactions[k][3:] if body.joint.kind == 'revolute'
                    else reactions[k][:3])
            assert_close(part @ axis,
                         applied[j] - passive[j] - body.joint.armature * qddot[j],
                         CLOSED)
    if 'closed loop' not in case.name:
        last = model.bodies[-1].inertial

        def speed(q, v):
            return v @ kinematics.configurations(model, q)[-1].partial_velocity
        acceleration = slope(lambda s: speed(case.q + s * case.q_rate, qdot + s * qddot))
        assert_close(reactions[-1][:3], last.mass * (acceleration - model.gravity),
                     CLOSED)


def constraint_forces(case):
    """Constraint forces and joint torques are the tree's inverse dynamics."""
    robot = case.robot
    qdot, qddot = case.joint_motion
    tau = inverse(case)
    forces = robot.constraint_forces(case.q, case.u, tau, **case.t)
    rows = case.mechanism.rows(case.mechanism.state(case.q, case.time))
    J = np.array(rows.J, dtype=float).reshape(-1, robot.model.n)
    needed = kane.inverse_dynamics(robot.model, case.q, qdot, qddot)
    assert_close(robot.joint_torques(tau, case.q, **case.t) + J.T @ forces, needed,
                 CLOSED)


def workspace(case):
    place = case.robot.bind()
    place.q[:] = case.q
    place.u[:] = case.u
    place.udot[:] = case.udot
    if case.t:
        place.t[...] = case.time
    assert_close(place.inverse_dynamics(), inverse(case))


def batches(case):
    q = np.tile(case.q, (5, 1))
    u = np.tile(case.u, (5, 1))
    udot = np.tile(case.udot, (5, 1))
    udot *= np.arange(5.0)[:, None]
    assert_close(case.robot.inverse_dynamics(q, u, udot, **case.t)[3],
                 inverse(case, udot=udot[3]))


def pickling(case):
    again = pickle.loads(pickle.dumps(case.robot))
    assert_close(again.inverse_dynamics(case.q, case.u, case.udot, **case.t),
                 inverse(case))


def reference_step(case, h):
    """Return q after one classical Runge-Kutta step of the definition without torque."""
    def rates(q, u, t):
        M = nonholonomic.mass_matrix(case.mechanism, q, t)
        held = nonholonomic.inverse_dynamics(case.mechanism, q, u, 0.0 * u, t)
        speeds = nonholonomic.joint_motion(case.mechanism, q, u, 0.0 * u, t)[0]
        return coordinate_rates(case.robot.model, q, speeds), -np.linalg.solve(M, held)
    y = (case.q, case.u)
    t = case.time
    k1 = rates(*y, t)
    k2 = rates(*(a + 0.5 * h * b for a, b in zip(y, k1)), t + 0.5 * h)
    k3 = rates(*(a + 0.5 * h * b for a, b in zip(y, k2)), t + 0.5 * h)
    k4 = rates(*(a + h * b for a, b in zip(y, k3)), t + h)
    return [a + h / 6.0 * (w + 2.0 * x + 2.0 * y + z)
            for a, w, x, y, z in zip(y, k1, k2, k3, k4)]


def simulation(case, integrator='rk4', step=1e-4, tolerance=CLOSED):
    run = simulate(case.robot, case.q, case.u, step, step=step, t0=case.time,
                   integrator=integrator)
    q, u = reference_step(case, step)
    assert_close(run.q[-1], q, tolerance)
    assert_close(run.u[-1], u, tolerance)
    assert run.drift < 1e-9


def operations_of_jax(case):
    import jax
    arguments = {'q': case.q, 'u': case.u, 'udot': case.udot, 't': np.array(case.time),
                 'wrench': np.zeros_like(case.robot.kernels.no_wrench)}
    function = case.robot.jax('inverse_dynamics', operations=True)
    with jax.enable_x64(True):
        batch = [np.array([arguments[name]] * 2) for name in function.names]
        torque = np.asarray(function(*batch))
    assert_close(torque[0], inverse(case))
    assert_same_numbers(torque[1], torque[0])


def stopped(case):
    """Compare the fastest joint's impact with the inelastic one by the definition."""
    robot = case.robot.copy()
    h = 1e-7
    M = nonholonomic.mass_matrix(case.mechanism, case.q, case.time)
    T = np.array([coordinate_rates(robot.model, case.q, column)
                  for column in case.T.T]).T
    joints = [k for k, name in enumerate(robot.coordinate_names)
              if not ('/q' in name or 'mode' in name or np.abs(T[k]).max() < 1e-3)]
    joint = max(joints, key=lambda k: abs(case.q_rate[k]))
    row = T[joint]
    into = case.q_rate[joint]
    along = np.linalg.solve(M, row)
    bounds = {'lower': np.full(robot.n_q, -np.inf), 'upper': np.full(robot.n_q, np.inf)}
    bounds['upper' if into > 0.0 else 'lower'][joint] = case.q[joint] + 0.1 * h * into
    robot.limits = replace(robot.limits, **bounds)
    for integrator in INTEGRATORS:
        run = simulate(robot, case.q, case.u, 2 * h, step=h, t0=case.time, stops=True,
                       integrator=integrator)
        assert_close(run.u[-1], case.u - along * into / (row @ along), 1e-4)
        assert_close(run.q[-1, joint], case.q[joint] + 0.1 * h * into)
        assert [event.joint for event in run.stop_events] == [
            robot.coordinate_names[joint]]
        if not case.t:
            assert_close(run.stop_events[0].loss, 0.5 * into**2 / (row @ along), 1e-4)


def slid_exactly(case):
    """Compare accelerations of sliding joints with the smooth law's difference."""
    robot = case.robot
    run = simulate(robot, case.q, case.u, 2e-3, step=1e-3, t0=case.time, sticking=True)
    for k in range(len(run.t)):
        at = {'t': run.t[k]} if case.t else {}
        rates = np.array(
            robot.equations.joint_speeds(run.q[k], run.u[k], at.get('t', 0.0)),
            dtype=float)
        difference = np.zeros(robot.model.n)
        for body in robot.model.bodies:
            joint = body.joint
            v = rates[body.joint.coordinate]
            if joint.friction:
                assert abs(v) > 1e-3 and not run.sticking[k, joint.coordinate]
                smooth = np.tanh(v / joint.friction_speed)
                difference[joint.coordinate] += joint.friction * (smooth - np.sign(v))
        force = robot.generalized_force(difference, run.q[k], **at)
        expected = robot.forward_dynamics(run.q[k], run.u[k], force, **at)
        assert_close(run.udot[k], expected, 1e-9)


def implicit(case):
    simulation(case, 'implicit', 1e-6)


def rest_motion(case):
    """Return a motion of the joints that follow, at rest at the case's configuration."""
    names = case.robot.speed_names if case.t and case.robot.constraint_names else (
        case.robot.joint_names)
    position = dict(zip(case.robot.coordinate_names, case.q))
    q = [position.get(name, 0.0) for name in names]
    return Motion.from_points([0.0, 1.0], [q, q], joint_names=names)


def computed_torque(case):
    run = simulate(case.robot, case.q, case.u, 1e-5, step=1e-5, t0=case.time,
                   torque=ComputedTorque(case.robot, rest_motion(case), kp=10.0, kd=5.0))
    assert_close(run.tau[0], inverse(case, udot=-5.0 * case.u, friction=False))


def controller(case):
    motion = rest_motion(case)
    at_rest = 0.0 * case.u
    for mode, expected in ((Mode.INVERSE_DYNAMICS, inverse(case, at_rest, at_rest)),
                           (Mode.COMPUTED_TORQUE,
                            inverse(case, udot=-5.0 * case.u, friction=False))):
        law = Controller(case.robot, mode=mode, kp=10.0, kd=5.0)
        assert_close(case.T.T @ law.command(case.time, case.q, case.u, motion).tau,
                     expected)
    if not case.robot.constraint_names:
        motion = Motion.from_points([0.0, 1.0],
                                    [motion.positions[0], motion.positions[0] + 0.3],
                                    joint_names=motion.joint_names)
        command = Controller(case.robot).command(0.3, case.q, case.u, motion)
        assert_close(command.tau,
                     kane.inverse_dynamics(case.robot.model, *motion.sample(0.3)))


def observed(case, force):
    """
    Return time and estimate of an observer with this force beside the actuators'.

    The arm is at rest, held by the definition's torque; what follows a function of time
    moves.
    """
    watch = MomentumObserver(case.robot, gain=60.0)
    if case.t:
        run = simulate(case.robot, case.q, case.u, 0.3,
                       step=2.5e-4, t0=case.time, torque=force, sample=2.5e-4)
        return [(t, watch.update(t, q, u, 0.0 * u))
                for t, q, u in zip(run.t, run.q, run.u)]
    at_rest = 0.0 * case.u
    held = inverse(case, at_rest, at_rest)
    return [(t, watch.update(t, case.q, at_rest, held - force))
            for t in 0.05 * np.arange(7.0)]


def observer(case):
    force = np.linspace(1.0, 2.0, case.robot.n)
    samples = observed(case, force)
    reached = 1.0 if case.t else -np.expm1(-60.0 * samples[-1][0])
    assert_close(samples[-1][1], reached * force, 1e-3 if case.t else CLOSED)


def collision(case):
    force = np.zeros(case.robot.n)
    force[-1] = 2.0
    for acting, joint in ((0.0 * force, None), (force, case.robot.speed_names[-1])):
        detector = CollisionDetector(case.robot.speed_names, 1.0)
        for t, estimate in observed(case, acting):
            detector.update(t, estimate)
        assert detector.joint == joint
        assert detector.beyond == ((joint,) if joint else ())


def balanced_power(case):
    balance = power_balance(case.robot, case.q, case.u, case.udot, **case.t)
    model = case.robot.model
    v, accelerations = case.joint_motion

    def energy(s):
        q = case.q + s * case.q_rate
        return energies.kinetic_energy(model, q, v + s * accelerations) + (
            energies.potential_energy(model, q))
    assert_close(balance.joints + balance.constraints,
                 slope(energy) + friction_of_joints(case) @ v, 1e-8)
    if not case.t:
        assert_close(balance.joints, inverse(case) @ case.u, CLOSED)


def drawn(case):
    """Compare bodies and energies that are drawn with the definition."""
    from kane_dynamics import plot
    from kane_dynamics.view import Window
    robot = case.robot
    v, _ = case.joint_motion
    run = simulate(robot, case.q, case.u, 3e-4, step=1e-4, t0=case.time)
    window = Window(robot, run, port=0)
    try:
        bodies = kinematics.configurations(robot.model, case.q)
        for frame, placed in zip(window._stage._frames, bodies):
            assert_close(frame.position, placed.p_wb)
    finally:
        window.close()
    figure = plot.plot_energy(robot, run)
    lines = {line.get_label(): line.get_ydata() for line in figure.axes[0].lines}
    assert_close(lines['kinetic'][0], energies.kinetic_energy(robot.model, case.q, v),
                 CLOSED)
    assert_close(lines['total'][0] - lines['kinetic'][0],
                 energies.potential_energy(robot.model, case.q), CLOSED)
    for figure in (plot.plot_trajectory(run), plot.plot_torque_by_source(robot, run),
                   plot.plot_reactions(robot, run)):
        for axes in figure.axes:
            for line in axes.lines:
                assert np.isfinite(line.get_ydata()).all()


def payload(case):
    """Compare the regressor with a payload's torque; identify it in exact samples."""
    robot = case.robot
    load = box(2.0, (0.1, 0.2, 0.3), at=(0.02, 0.03, 0.05))
    loaded = Robot(with_payload(robot.model, TOOL, load), **robot.options)
    heavy = replace(case, robot=loaded)
    added = inverse(heavy) - inverse(case)
    regressor = PayloadRegressor(robot, TOOL)
    Y = regressor(case.q, case.u, case.udot, case.time)
    assert_close(Y @ parameters_of(load.pseudo_inertia), added)
    estimator = PayloadEstimator(robot, TOOL, np.full(robot.n, 1e-5))
    rng = np.random.default_rng(1)
    run = simulate(loaded, case.q, case.u, 1.5, step=5e-4, t0=case.time, sample=0.0125)
    rows = []
    for name in robot.speed_names:
        rows.append(0.05 if 'mode' in name else 3.0)
    size = np.array(rows)
    for t, q in zip(run.t, run.q):
        u, udot = size * [[1.0], [10.0]] * rng.normal(size=(2, robot.n))
        sample = replace(heavy, q=q, u=u, udot=udot, t={'t': t} if case.t else {})
        estimator.update(q, u, udot, inverse(sample), t=t)
    assert_close(Y @ estimator._parameters, added, CLOSED)


def swept(case):
    """Compare a row with a step of the definition, and a longer one with `simulate`."""
    robot = case.robot
    start = {'q0': case.q.tolist(), 'u0': case.u.tolist(), 't0': case.time}
    for integrator, tolerance in (('rk4', CLOSED), ('implicit', 1e-7)):
        rows = Simulator(Sweep(robot, samples=2, duration=1e-5, step=1e-5,
                               integrator=integrator, **start)).columns(0)
        q, u = reference_step(case, 1e-5)
        assert_close([rows[f'q.{name}'][1] for name in robot.coordinate_names], q,
                     tolerance)
        assert_close([rows[f'u.{name}'][1] for name in robot.speed_names], u, tolerance)
    load = box(1.5, (0.1, 0.1, 0.1), at=(0.02, 0.03, 0.05))
    heavy = Robot(with_payload(twice_the_friction(robot.model), TOOL, load),
                  **robot.options)
    payload = {'frame': TOOL, 'mass': load.mass, 'com': load.com.tolist(),
               'gyration': float(np.sqrt(load.inertia[0, 0] / load.mass))}
    friction = {name: 2.0 for name in robot.joint_names if 'mode' not in name}
    rows = Simulator(Sweep(robot, samples=1, duration=0.02, step=1e-4, payload=payload,
                           friction=friction, **start)).columns(0)
    run = simulate(heavy, case.q, case.u, 0.02, step=1e-4, t0=case.time)
    assert rows['ok'].all() and rows['energy_closes'].all()
    assert_close([rows[f'q.{name}'][0] for name in robot.coordinate_names], run.q[-1],
                 CLOSED)
    assert_close([rows[f'u.{name}'][0] for name in robot.speed_names], run.u[-1], CLOSED)


def twice_the_friction(model):
    """Return a model with twice the friction of its joints."""
    return with_friction_times(2.0, model)


def verification(case):
    assert case.robot.verify(1) < CLOSED


def exported(case):
    """Compile the exported C, which passes its self-test and gives inverse dynamics."""
    with TemporaryDirectory() as folder:
        source, _ = case.robot.export_c(Path(folder) / 'out.c', (
            'inverse_dynamics', 'forward_dynamics', 'coriolis_matrix',
            f'jacobian:{TOOL}'))
        library = source.with_suffix('.so')
        subprocess.run(
            ['gcc', '-std=c99', '-Wall', '-Wextra', '-Wpedantic', '-Werror', '-O0',
             '-fPIC', '-shared', str(source), '-o', str(library), '-lm'], check=True)
        loaded = ctypes.CDLL(str(library))
    assert loaded.out_self_test() == 0
    result = np.empty(case.robot.n)
    time = np.array(case.time)
    arguments = [case.q, case.u, case.udot, None, *([time] if case.t else []), None,
                 result]
    loaded.out_inverse_dynamics.restype = None
    loaded.out_inverse_dynamics(*(x if x is None else x.ctypes.data_as(ctypes.c_void_p)
                                  for x in arguments))
    assert_close(result, inverse(case))


def vibration(case):
    """Small motions about a held configuration follow from Kane's forces beside it."""
    model = case.robot.model
    case = balanced(case) if model.balls else case
    modes = natural_vibration(case.robot, case.q)

    def slope_of_potential(q):
        return -kane.generalized_active_force(model, q, 0.0 * q, friction=False)
    held = case.robot.joint_torques(case.T.T @ slope_of_potential(case.q), case.q)

    def force(direction, s):
        q = joints_moved(model, case.q, s * direction)
        return moved(case, q, 0.0).T @ (slope_of_potential(q) - held)
    K = np.array([slope(partial(force, direction)) for direction in case.T.T]).T
    M = nonholonomic.mass_matrix(case.mechanism, case.q)
    square = np.sort(np.linalg.eigvals(np.linalg.solve(M, K)).real)
    assert_close(np.sign(modes.frequencies) * modes.frequencies**2, square, CLOSED)
    assert_close(modes.shapes.T @ kane.mass_matrix(model, case.q) @ modes.shapes,
                 np.eye(len(M)), CLOSED)


def balanced(case):
    """Return a case whose ball joints carry no moment, by Newton's method."""
    model = case.robot.model
    q = case.q
    places = []
    for ball in balls(model):
        for k in range(3):
            places.append(ball.speed + k)
    units = np.eye(model.n)[places]

    def moment(q, step, s):
        q = joints_moved(model, q, s * step)
        return kane.generalized_active_force(
            model, q, 0.0 * step, friction=False)[places]
    for _ in range(30):
        reference = moment(q, units[0], 0.0)
        by_turn = np.array([slope(partial(moment, q, unit)) for unit in units])
        turn = np.linalg.lstsq(by_turn.T, -reference, rcond=1e-6)[0]
        q = joints_moved(model, q, turn @ units * min(1.0, 0.5 / np.abs(turn).max()))
    assert_close(reference, 0.0 * reference)
    return replace(case, q=q)


def driven(case):
    """Return a motion of the driving joints through the case's state, and when."""
    robot = case.robot
    moment = case.time or 0.4
    names = [name for name in robot.joint_names if name in ('upper', 'fore',
                                                            'crank')][:robot.n]
    places = [robot.coordinate_names.index(name) for name in names]
    rates = case.q_rate[places]
    return Motion.from_points(
        [0.0, moment, 1.0], [case.q[places] + x for x in (-0.1, 0.0, 0.1)], [rates] * 3,
        [0.5 * rates] * 3, joint_names=names), moment, places


def all_joints(robot, motion, *states):
    """Return q, q' and q'' of all joints for rows of the driving joints."""
    if robot.speed_names == robot.joint_names:
        return states
    whole = mechanism_motion(robot, motion.joint_names, np.zeros(len(states[0])),
                             *states)
    return whole.q, robot.joint_rates(whole.q,
                                      whole.u), robot.joint_accelerations(*whole)


def actuators(case, q, needed):
    """Return the actuators' torques that give forces of joints, by the definition."""
    # Each generalized force acts on its own speed: the joint torques are its row of
    # W^-1.
    parts = nonholonomic.reduction(case.mechanism, q, 0.0)
    return np.linalg.inv(
        parts.W)[case.mechanism.free].T @ (moved(case, q, 0.0).T @ needed)


def rigid_model(case):
    """Return a case's robot and None, or the rigid model and the arm's bent beams."""
    robot = case.robot
    if not robot.model.flexible:
        return robot, None
    model = robot.model
    choice = {}
    if robot.constraint_names:
        choice = {'constraints': case.mechanism.constraints, 'independent': ['crank']}
        modes = [model.coordinate_names[k] for k in model.modal_coordinates]
        robot = Robot(model, **choice | {'independent': ['crank', *modes]})
    return Robot(stiffened(model), **choice), QuasiStatic(robot)


def held_by_actuators(case, bending, q, u, udot):
    """Return the torques of the joints for motions of all, by Kane's definition."""
    if bending is None:
        return actuators(case, q, kane.inverse_dynamics(case.robot.model, q, u, udot))
    robot = bending.robot
    joints = list(bending.joint_names)
    columns = [joints.index(name) for name in bending.speed_names]
    whole = np.zeros(robot.n_q)
    whole[[robot.coordinate_names.index(name) for name in joints]] = q
    whole[list(robot.model.modal_coordinates)] = bending.modes(
        q, u[columns], udot[columns])
    if robot.constraint_names:
        whole = robot.closed_configuration(whole, fixed=robot.speed_names)
    places = [robot.speed_names.index(name) for name in bending.speed_names]
    speeds = np.zeros((2, robot.n))
    speeds[:, places] = u[columns], udot[columns]
    mechanism = replace(case, robot=robot).mechanism
    tau = nonholonomic.inverse_dynamics(mechanism, whole, *speeds, 0.0)
    assert_close(np.delete(tau, places), np.zeros(robot.n - len(places)), 1e-7)  # modes
    result = np.zeros(len(joints))
    result[columns] = tau[places]
    return result


def scaled(case):
    """At the highest speed a limit is reached, none exceeded, by Kane's definition."""
    robot, bending = rigid_model(case)
    motion, _, _ = driven(case)
    time_scale = fastest(robot, motion, step=0.05, bending=bending)
    states = motion.sample(np.array([0.13, time_scale.t * time_scale.speed]))
    uses = []
    for q, u, udot in zip(*all_joints(robot, motion, *states)):
        tau = held_by_actuators(case, bending, q, time_scale.speed * u,
                                time_scale.speed**2 * udot)
        uses.append(max((np.abs(tau) / robot.limits.effort).max(),
                        np.abs(time_scale.speed * u / robot.limits.velocity).max()))
    assert_close(uses[1], 1.0, 1e-6)
    assert uses[0] <= 1.0 + 1e-6


def timed(case):
    """Reach some limit at most times, and exceed none, by Kane's definition."""
    robot = case.robot
    motion, _, _ = driven(case)
    timing = time_optimal(robot, motion, acceleration=2.0, points=100)
    times = timing.motion.times
    states = all_joints(robot, timing.motion, *timing.motion.sample(
        0.5 * (times[10:-10:7] + times[11:-9:7])))
    tau = np.array([actuators(case, row[0], kane.inverse_dynamics(robot.model, *row))
                    for row in zip(*states)])
    limits = robot.limits
    uses = [np.abs(values / bound).max(axis=1) for values, bound in (
        (tau, limits.effort), (states[1], limits.velocity), (states[2], 2.0))]
    assert_close(np.median(np.max(uses, axis=0)), 1.0, 1e-2)
    assert np.max(uses) <= 1.001


def optimized(case):
    """Plan a motion of three short intervals with torques of Kane's definition."""
    robot = case.robot
    problem = TrajectoryOptimizer(robot, nodes=3, interval=1e-8)
    problem.set_target(case.q, case.time)
    plan = problem.solve(case.q, case.u, iterations=2)
    udot = np.diff(plan.u, axis=0) / problem.interval
    at = case.time + problem.interval
    places = [robot.joint_names.index(name) for name in problem.actuator_names]
    assert_close(moved(case, plan.q[1], at)[places].T @ plan.tau[1],
                 nonholonomic.inverse_dynamics(
                     case.mechanism, plan.q[1], plan.u[1], udot[1], at), 1e-4)


def filled(case):
    robot, bending = rigid_model(case)
    motion, moment, places = driven(case)
    q, u, udot = motion.sample(moment)
    done = fill_trajectory(robot, [0.0], [q], [u], [udot],
                           joint_names=motion.joint_names, bending=bending)
    (q,), (u,), (udot,) = all_joints(robot, motion, *(x[None] for x in (q, u, udot)))
    if bending is not None:
        tau = held_by_actuators(case, bending, q, u, udot)
        assert_close(done.efforts[0],
                     tau[[robot.joint_names.index(name) for name in motion.joint_names]],
                     CLOSED)
        return
    T = moved(case, q, 0.0)  # each of the trajectory's joints has an actuator
    assert_close(
        done.efforts[0], np.linalg.solve(T[places].T, T.T @ kane.inverse_dynamics(
            robot.model, q, u, udot)), CLOSED if robot.constraint_names else TOLERANCE)


def demanded(case):
    """Move the other joints with the driving ones, by Kane's definition."""
    robot, bending = rigid_model(case)
    motion, moment, _ = driven(case)
    places = [robot.coordinate_names.index(name) for name in motion.joint_names]
    asked = demand(robot, motion, step=0.05, bending=bending)
    k = int(np.argmin(np.abs(asked.t - moment)))
    t = asked.t[k]
    q = asked.q[k]
    qdot = asked.u[k]
    qddot = asked.udot[k]
    for mine, stated in zip((q, qdot, qddot), motion.sample(t)):
        assert_close(mine[places], stated)
    if bending is not None:
        assert_close(asked.tau[k], held_by_actuators(case, bending, q, qdot, qddot),
                     CLOSED)
        return

    def missed(s):
        rows = case.mechanism.rows(case.mechanism.state(q + s * qdot, t + s))
        J = np.array(rows.J, dtype=float)
        b = np.array(rows.b, dtype=float)
        return J.reshape(-1, robot.n_q) @ (qdot + s * qddot) - b
    assert_close(missed(0.0), 0.0 * missed(0.0), CLOSED)
    assert_close(slope(missed), 0.0 * missed(0.0), CLOSED)
    rows = case.mechanism.rows(case.mechanism.state(q, t))
    assert_close([x or 0.0 for x in rows.residual], np.zeros(len(rows.residual)))
    T = moved(case, q, t)
    assert_close(T.T @ asked.tau[k],
                 T.T @ kane.inverse_dynamics(robot.model, q, qdot, qddot), CLOSED)
