"""Comparison of the compiled kernels with the definition of Kane's equations."""

from copy import copy
from dataclasses import replace
from typing import Any

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import CompileError, ConstraintError, InputError
from kane_dynamics.mechanics.algebra.jet import moving, rates
from kane_dynamics.mechanics.ball_joints import joint_positions, moved, neutral
from kane_dynamics.mechanics.constraints.conditioning import figure, stacked
from kane_dynamics.mechanics.definition import beams, kane, nonholonomic
from kane_dynamics.mechanics.friction import least_load_slope, load_fractions
from kane_dynamics.model.model import Model, with_payload
import numpy as np

Pair = tuple[Array, Array]  # result of a kernel, result of the definition
REGULAR, TRIES = 1e4, 100  # largest figure of a regular state; random states to try
TOLERANCE = 1e-9  # largest relative error of a correct kernel
PARTS_OF_THE_TORQUE = ('bias_force', 'gravity_force', 'coriolis_matrix', 'regressor',
                       'body_torques')


def verified(robot: Any, states: int) -> float:
    """
    Return the largest relative error of a Robot's kernels at random states.

    Dynamics always; Coriolis matrix, derivatives, regressor and torques by body only if
    they were used before, for a robot in joint rates. The error of forward dynamics is
    that of the torque of its result; it is skipped where the mass matrix is singular,
    and of self-locking drives, of which the motion does not follow from the torque.

    Raises
    ------
    InputError
        `states` is less than 1.
    CompileError
        An error is larger than `TOLERANCE`; names the quantity and the error.

    """
    whole = isinstance(states, int | np.integer) and not isinstance(states, bool)
    if not whole or states < 1:
        raise InputError(f'states: {states!r}; expected an integer >= 1')
    rng = np.random.default_rng(0)
    gravity = robot.parameters.gravity
    payload = robot.parameters.payload
    # The definition knows no run-time parameters: its model has the payload.
    model = robot.model
    if payload is not None:
        model = with_payload(model, robot.equations.payload_frame.name, payload)
    constrained = not robot.equations.in_joint_rates
    compile_verified(robot)
    worst = 0.0
    for _ in range(states):
        if constrained:
            pairs = _constrained(robot, model, gravity, rng)
        else:
            # Kernels of trees are compared with the sums of the definition.
            q, u, udot = rng.uniform(-2.0, 2.0, (3, robot.n))
            pairs = _dynamics(robot, model, gravity, q, u, udot)
            for name, reference in OCCASIONAL.items():
                if robot.kernels.in_use(name):
                    pairs[name] = reference(robot, model, gravity, q, u, udot)
        torque = largest_entry(pairs['inverse_dynamics'][1])
        for name, (value, expected) in pairs.items():
            size = max(largest_entry(expected), 1e-300)
            if name in PARTS_OF_THE_TORQUE:  # of which one may vanish but for rounding
                size = max(size, torque)
            error = largest_entry(value - expected) / size
            if not error < TOLERANCE:
                raise CompileError(f'{name}: relative error {error:.3g} to the '
                                   f'definition; expected at most {TOLERANCE:g}')
            worst = max(worst, error)
    return worst


def compile_verified(robot: Any) -> None:
    """Compile the kernels that `verified` always compares, on all processors."""
    names = ['inverse_dynamics', 'mass_matrix']
    if robot.equations.in_joint_rates:
        names += ['bias_force', 'gravity_force']
    if determines_motion(robot):
        names.append('forward_dynamics')
    robot.compile(*names)


def largest_entry(values: Array) -> float:
    """Return the largest absolute value, 0 of none."""
    return float(np.abs(values).max(initial=0.0))


def _dynamics(robot: Any, model: Model, gravity: Array, q: Array, u: Array,
              udot: Array) -> dict[str, Pair]:
    """Return compiled and reference values of the quantities of a control loop."""
    M = kane.mass_matrix(model, q)
    bias = kane.bias_force(model, q, u, gravity=gravity, friction=robot.friction)
    tau = M @ udot + bias
    loaded = robot.equations.carries_loads
    if loaded:  # the torque is not linear in udot
        tau = kane.inverse_dynamics(model, q, u, udot, gravity=gravity)
    pairs = {
        'mass_matrix': (robot.mass_matrix(q), M),
        'bias_force': (robot.bias_force(q, u), bias),
        'gravity_force': (robot.gravity_force(q),
                          kane.gravity_force(model, q, gravity=gravity)),
        'inverse_dynamics': (robot.inverse_dynamics(q, u, udot), tau)}
    # Forward dynamics by its residual: M^-1 would multiply the rounding by the
    # condition.
    if determines_motion(robot) and is_regular(M):
        acceleration = robot.forward_dynamics(q, u, tau)
        needed = M @ acceleration + bias
        if loaded:
            needed = kane.inverse_dynamics(model, q, u, acceleration, gravity=gravity)
        pairs['forward_dynamics'] = (needed, tau)
    return pairs


def _constrained(robot: Any, model: Model, gravity: Array,
                 rng: np.random.Generator) -> dict[str, Pair]:
    """Return compiled and reference values for chosen speeds or constraints."""
    mechanism = copy(robot.mechanism)
    # The definition with the present payload, in the robot's speeds.
    mechanism.model = model
    q, t = regular_state(robot, rng)
    u, udot = rng.uniform(-2.0, 2.0, (2, robot.n))

    def torque(acceleration: Array) -> Array:
        return nonholonomic.inverse_dynamics(
            mechanism, q, u, acceleration, t, gravity=gravity, friction=robot.friction,
            motors=robot.equations.actuated)

    # The same motion by the definition, of which forward dynamics is the inverse.
    tau = torque(udot)
    M = nonholonomic.mass_matrix(mechanism, q, t)
    pairs = {'mass_matrix': (robot.mass_matrix(q, t=t), M),
             'inverse_dynamics': (robot.inverse_dynamics(q, u, udot, t=t), tau)}
    if determines_motion(robot) and is_regular(M):
        pairs['forward_dynamics'] = (torque(robot.forward_dynamics(q, u, tau, t=t)), tau)
    return pairs


def determines_motion(robot: Any) -> bool:
    """Return whether the motion follows from the torque: not of self-locking drives."""
    return not robot.friction or all(least_load_slope(*load_fractions(body.joint)) > 0.0
                                     for body in robot.model.bodies)


def is_regular(M: Array) -> bool:
    """Return whether forward dynamics can be compared at a mass matrix."""
    return bool(len(M) and np.linalg.cond(M) < 1e12)


def regular_state(robot: Any, rng: np.random.Generator) -> tuple[Array, float]:
    """
    Return a random closed and regular configuration, (n_q,), and a time, s.

    Raises
    ------
    CompileError
        None is found.

    """
    middle = neutral(robot.model)
    spread = 2.0
    latest = 2.0
    if robot.configuration is not None:  # user-defined functions are evaluated near it
        middle = np.asarray(robot.configuration, dtype=float)
        spread = 0.1
        latest = 0.01
    t = float(rng.uniform(0.0, latest)) if robot.equations.timed else 0.0
    # Random starts often do not close, or are nearly singular.
    for _ in range(TRIES):
        try:
            start = moved(robot.model, middle,
                          rng.uniform(-spread, spread, robot.model.n))
            q: Array = robot.closed_configuration(start, t=t)
        except ConstraintError:
            continue
        if conditioning(robot, q, t) < REGULAR:
            return q, t
    raise CompileError(f'{TRIES} random configurations: none is closed and regular; '
                       'expected one to compare the kernels with the definition at')


def conditioning(robot: Any, q: Array, t: float) -> float:
    """Return the conditioning figure of the independent speeds at q, (n_q,), and t."""
    mechanism = robot.mechanism
    return float(figure(mechanism, stacked(mechanism, q, t), mechanism.free,
                        mechanism.kept))


def _rigid(model: Model, gravity: Array, q: Array, u: Array, udot: Array) -> Array:
    """Return the rigid-body torque, (n,), without armature, springs and friction."""
    inertia: Array = kane.generalized_inertia_force(without_rotors(model), q, u, udot)
    weight: Array = kane.gravity_force(model, q, gravity=gravity)
    return weight - inertia


def without_rotors(model: Model) -> Model:
    """Return the model without armature."""
    bodies = []
    for body in model.bodies:
        joint = replace(body.joint, armature=0.0)
        bodies.append(replace(body, joint=joint))
    return replace(model, bodies=tuple(bodies))


def _coriolis(robot: Any, model: Model, gravity: Array, q: Array, u: Array,
              udot: Array) -> Pair:
    zero = np.zeros(robot.n)
    # The force quadratic in u: the torque without acceleration, less that at rest.
    moving = _rigid(model, gravity, q, u, zero)
    at_rest = _rigid(model, gravity, q, zero, zero)
    return robot.coriolis_matrix(q, u) @ u, moving - at_rest


def _torque_slopes(robot: Any, model: Model, gravity: Array, q: Array, u: Array,
                   udot: Array) -> Array:
    """Return the derivatives of the torque by q, u and udot, (n, 3 n)."""
    arguments = np.concatenate([q, u, udot])
    slopes = []
    # The rate of the torque if one argument alone changes.
    for direction in np.eye(len(arguments)):
        changing = np.split(moving(arguments, direction), 3)
        torque = kane.inverse_dynamics(model, *changing, gravity=gravity,
                                       friction=robot.friction)
        slopes.append(rates(torque))
    return np.array(slopes).T


def _derivatives(robot: Any, model: Model, gravity: Array, q: Array, u: Array,
                 udot: Array) -> Pair:
    by_q, by_u, _ = robot.inverse_dynamics_derivatives(q, u, udot)
    slopes = _torque_slopes(robot, model, gravity, q, u, udot)
    return np.hstack([by_q, by_u]), slopes[:, :2 * robot.n]


def _forward_derivatives(robot: Any, model: Model, gravity: Array, q: Array, u: Array,
                         tau: Array) -> Pair:
    udot = robot.forward_dynamics(q, u, tau)
    by_q, by_u, _ = robot.forward_dynamics_derivatives(q, u, tau)
    # At constant tau, what udot changes in the torque cancels what q and u change. The
    # derivative by udot is M, but of friction that depends on the load.
    slopes = _torque_slopes(robot, model, gravity, q, u, udot)
    by_state, by_udot = slopes[:, :2 * robot.n], slopes[:, 2 * robot.n:]
    return -by_udot @ np.hstack([by_q, by_u]), by_state


def _regressor(robot: Any, model: Model, gravity: Array, q: Array, u: Array,
               udot: Array) -> Pair:
    return (robot.regressor(q, u, udot) @ robot.inertial_parameters,
            _rigid(robot.model, gravity, q, u, udot))


def _body_torques(robot: Any, model: Model, gravity: Array, q: Array, u: Array,
                  udot: Array) -> Pair:
    positions = joint_positions(model, q)
    elastic = np.zeros(robot.n)
    for body in model.bodies:
        if body.beam is not None:
            elastic = elastic + beams.modal_force(body.beam, positions, u, robot.friction)
    by_body = robot.body_torques(q, u, udot)
    return by_body.sum(axis=0), _rigid(model, gravity, q, u, udot) - elastic


OCCASIONAL = {'coriolis_matrix': _coriolis, 'inverse_dynamics_derivatives': _derivatives,
              'forward_dynamics_derivatives': _forward_derivatives,
              'regressor': _regressor,
              'body_torques': _body_torques}
