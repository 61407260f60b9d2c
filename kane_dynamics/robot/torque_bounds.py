"""
Bounds of the torque for uncertain inertial parameters and friction.

Inverse dynamics is linear in the inertial parameters, in the friction coefficients and in
the armatures p: tau = tau_0 + Y (p - p_0). If each parameter lies within p_0 +- delta,
independently of the others, the torque of each actuator lies within tau_0 +- |Y| delta,
and reaches both ends: the bounds are exact for the box.

The friction speed enters nonlinearly and is taken as known; so are the damping at
high rates and what breakaway friction exceeds Coulomb friction by.

With load friction, tau = L + friction(v, L), where the load L is linear in the inertial
parameters and in the armatures, and lies within L_0 +- delta_L. At a given rate the right
side is linear on either side of L = 0. Its extremes are therefore at the ends of the
interval of loads, or at zero where that is inside; the other terms of friction add their own
half-widths. These bounds are exact, too, but not symmetric about tau_0. Wrenches change
L_0 alone.

With chosen speeds or constraints, tau = f + T^T friction(v, L(f)), where the generalized
force f without friction is linear in the parameters, and the loads L in f. Where the load
of each such joint, and what its friction acts on, are one and the same entry of f, as with
the rates of the motors as speeds, each torque is again a function of one number with a
kink at zero. Elsewhere the largest torque is the maximum over the box of a sum of several
such functions, of loads that the same parameters determine: no sum of largest parts, but
for each choice of the loads' signs a linear program. Such bounds are refused.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields, replace
from functools import wraps
from typing import Any, NoReturn

from kane_dynamics._util.checks import instance, number, shape_of
from kane_dynamics._util.fork_safety import lazy_property
from kane_dynamics._util.frozen import freeze
from kane_dynamics._util.typing import Array, Matrix, Scalar, Vector
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.algebra.dual import select
from kane_dynamics.mechanics.algebra.vector import is_zero
from kane_dynamics.mechanics.constraints.conditioning import guarded
from kane_dynamics.mechanics.constraints.mechanism import JointMotion
from kane_dynamics.mechanics.equations import Equations
from kane_dynamics.mechanics.friction import (carries_load, carries_loads, coulomb_levels,
                                              friction_torque, has_curved_damping,
                                              refuse_load_friction)
from kane_dynamics.mechanics.recursive.regressor import parameters_of, pseudo_inertia_of
from kane_dynamics.model.model import FRICTION as LAW_FIELDS, Inertial, Joint, Model, WORLD
from kane_dynamics.native.runtime.kernel import Kernel
from kane_dynamics.native.tracing.subroutine import Subroutines
from kane_dynamics.robot.kernel_set import OUTLINED
import numpy as np
from numpy.typing import ArrayLike

FRICTION = ('damping', 'friction', 'friction_offset')  # in which the torque is linear
LOSSES = (*FRICTION, 'armature')
# Places of the compiled kernels of a robot.
BOUNDS = 'torque_bounds', ''
LOADED_BOUNDS = 'torque_bounds_under_force', ''
DEVIATION = 'torque_deviation', ''
JOINT_DEVIATION = 'joint_torque_deviation', ''


class TorqueBounds:
    """
    Smallest and largest torque, (n,) or (N, n) arrays, N m or N.

    `lower, upper = bounds` gives both.
    """

    __slots__ = ('_rows',)

    def __init__(self, rows: Array) -> None:
        """Keep both in one array, (2, n) or (N, 2, n)."""
        self._rows = rows

    @property
    def lower(self) -> Array:
        """Return the smallest torque, N m or N."""
        return self._rows[..., 0, :]

    @property
    def upper(self) -> Array:
        """Return the largest torque, N m or N."""
        return self._rows[..., 1, :]

    def __iter__(self) -> Iterator[Array]:
        """Yield the smallest, then the largest torque."""
        return iter((self.lower, self.upper))

    def __repr__(self) -> str:
        """Return both as text."""
        return f'TorqueBounds(lower={self.lower!r}, upper={self.upper!r})'


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """
    Box of uncertain parameters: each lies within plus or minus a number of its value.

    `Uncertainty.of` makes one from relative errors. The damping at high rates, the
    friction speeds and what breakaway friction exceeds Coulomb friction by are taken as known.

    Attributes
    ----------
    inertial : (bodies, 10) array
        Of the inertial parameters of each body about its origin, in the order of
        `mechanics.recursive.regressor`: kg, kg m, kg m^2.
    damping, friction, friction_offset, armature : (bodies,) arrays
        Of these properties of each body's joint, in units of `Joint`.
    payload : (10,) array
        Of the payload's inertial parameters, in the axes of the robot's payload frame.

    Raises
    ------
    InputError
        A shape differs, or a number is negative or not finite.

    """

    inertial: ArrayLike
    damping: ArrayLike
    friction: ArrayLike
    friction_offset: ArrayLike
    armature: ArrayLike
    payload: ArrayLike = (0.0,) * 10

    def __post_init__(self) -> None:
        """Check shapes and numbers."""
        # The box has numbers for each body or joint, and ten for the payload.
        bodies = len(np.atleast_1d(np.asarray(self.damping)))
        for field in fields(self):
            shape = {'inertial': (bodies, 10), 'payload': (10,)}.get(field.name, (bodies,))
            try:
                values = np.array(getattr(self, field.name), dtype=np.float64)
            except (TypeError, ValueError):
                raise InputError(f'uncertainty: {field.name}: not an array of numbers; '
                                 f'expected shape {shape}') from None
            if values.shape != shape:
                raise InputError(f'uncertainty: {field.name}: shape {values.shape}; '
                                 f'expected {shape}')
            # Half-widths of the box, which cannot be negative.
            if not ((values >= 0.0) & np.isfinite(values)).all():
                worst = values[~((values >= 0.0) & np.isfinite(values))][0]
                raise InputError(f'uncertainty: {field.name}: {worst}; expected finite '
                                 'numbers >= 0')
            freeze(self, field.name, values)

    @lazy_property
    def bodies(self) -> int:
        """Return the number of bodies."""
        return len(np.asarray(self.damping))

    @lazy_property
    def has_payload(self) -> bool:
        """Return whether a parameter of the payload is uncertain."""
        return bool(np.any(self.payload))

    @lazy_property
    def box(self) -> Array:
        """Return all half-widths, (10 + 14 bodies,): payload, bodies, then joints."""
        losses = [np.asarray(getattr(self, name)) for name in LOSSES]
        box = np.concatenate([np.ravel(self.payload), np.ravel(self.inertial), *losses])
        box.flags.writeable = False
        return box

    @classmethod
    def of(cls, model: Model, *, mass: float = 0.0, com: float = 0.0,
           inertia: float = 0.0, friction: float = 0.0, offset: float = 0.0,
           payload_mass: float = 0.0, payload_com: ArrayLike = (0.0, 0.0, 0.0)
           ) -> Uncertainty:
        """
        Return the box around a model's values with these errors of all bodies and joints.

        The parameters about a body's origin depend on mass, center of mass and inertia
        together. The box holds all their combinations, and some more.

        Parameters
        ----------
        model : Model
            Its values are the center of the box.
        mass, inertia, friction : float
            Relative errors of masses; of inertias about the centers of mass, relative to
            the largest moment; of damping, Coulomb friction (the larger one of both
            directions) and armature. 0.1 is 10 %.
        com : float
            Error of each coordinate of the centers of mass, m.
        offset : float
            Error of the torque of each joint that does not depend on the motion, N m
            or N.
        payload_mass : float
            Error of the mass of the payload at the robot's payload frame, kg.
        payload_com : (3,) array_like
            The largest distances of that mass from the frame along its axes, m.

        Raises
        ------
        InputError
            An error is negative or not finite.

        """
        instance(model, Model, 'model')
        errors = {'mass': mass, 'com': com, 'inertia': inertia, 'friction': friction,
                  'offset': offset, 'payload_mass': payload_mass}
        for name, value in errors.items():
            number(value, name, 'a finite number >= 0', lambda x: 0.0 <= x < np.inf)
        inertial = []
        for body in model.bodies:
            inertial.append(_inertial_box(body.inertial, mass, com, inertia))
        # The box of friction and armature is relative to the model's values.
        joints = [body.joint for body in model.bodies]
        relative = {}
        for name in ('damping', 'friction', 'armature'):
            values = [getattr(joint, name) for joint in joints]
            if name == 'friction':  # the box has the same width in both directions
                values = [max(coulomb_levels(joint)) for joint in joints]
            relative[name] = friction * np.abs(np.array(values, dtype=np.float64))
        payload = _payload_box(payload_mass, payload_com)
        return cls(np.array(inertial).reshape(-1, 10), friction_offset=np.full(
            len(joints), offset), payload=payload, **relative)


def box_size(bodies: int) -> int:
    """Return the number of uncertain parameters of a payload, bodies and joints."""
    return 10 + (10 + len(LOSSES)) * bodies


def _inertial_box(inertial: Inertial, mass: float, com: float, inertia: float) -> Array:
    """Return the half-widths of a body's ten parameters, (10,)."""
    m, center = inertial.mass, np.abs(inertial.com)
    heaviest, farthest = m * (1.0 + mass), center + com
    moments = heaviest * farthest - m * center
    # Entries of m c c^T, which the parallel axis theorem adds to the inertia.
    products = heaviest * np.outer(farthest, farthest) - m * np.outer(center, center)
    largest = float(np.abs(np.linalg.eigvalsh(inertial.inertia)).max())
    axes = np.trace(products) - np.diag(products)
    xx, yy, zz = inertia * largest + axes
    xy, xz, yz = inertia * largest + products[np.triu_indices(3, 1)]
    return np.array([m * mass, *moments, xx, xy, yy, xz, yz, zz])


def _payload_box(mass: float, com: ArrayLike) -> Array:
    """Return the half-widths for a point mass at most so far from the frame, (10,)."""
    try:
        distances = np.array(com, dtype=np.float64)
    except (TypeError, ValueError):
        distances = np.full(3, np.nan)
    if distances.shape != (3,) or not (np.isfinite(distances) & (distances >= 0.0)).all():
        raise InputError(f'payload_com: {com!r}; expected three finite distances >= 0, m')
    # Largest second moments of a point mass within these distances: sum of squares,
    # products.
    products = np.outer(distances, distances)
    xx, yy, zz = np.trace(products) - np.diag(products)
    xy, xz, yz = products[np.triu_indices(3, 1)]
    return mass * np.array([1.0, *distances, xx, xy, yy, xz, yz, zz])


class OfSameBox:
    """
    The method `Robot.torque_bounds`, which calls its kernel alone where it can.

    That is for one state, given by arrays, and the box of the call before. All other calls
    go to the body of the method, which checks the box.
    """

    def __init__(self, method: Callable[..., TorqueBounds]) -> None:
        self.checked = method
        self.__doc__ = method.__doc__

    def __get__(self, robot: Any, owner: type | None = None) -> Any:
        """Return the method bound to a robot, and store it in the robot for later calls."""
        if robot is None:
            return self.checked
        checked = self.checked.__get__(robot)
        # The box of the call before, its numbers, and the kernel: one tuple, so that
        # threads exchange all of them at once.
        last: tuple[Any, Array, Callable[..., Any]] = object(), np.empty(0), checked

        @wraps(self.checked)
        def call(*values: Any, **named: Any) -> TorqueBounds:
            nonlocal last
            uncertainty, box, kernel = last
            bounds: TorqueBounds
            if len(values) == 4 and values[3] is uncertainty and not named:
                q, u, udot, _ = values
                if type(q) is np.ndarray and q.ndim == 1:
                    # Without the constructor, whose checks take as long as the kernel.
                    bounds = object.__new__(TorqueBounds)
                    bounds._rows = kernel(q, u, udot, box)
                    return bounds
            bounds = checked(*values, **named)
            # Without wrenches, and at the time 0, all that varies from call to call is the
            # state.
            if len(values) == 4 and not named:
                last = values[3], values[3].box, robot._entries[BOUNDS]
            return bounds
        robot.__dict__['torque_bounds'] = call
        return call


def torque_bounds(robot: Any, q: ArrayLike, u: ArrayLike, udot: ArrayLike,
                  uncertainty: Uncertainty, wrench: Any, t: ArrayLike) -> TorqueBounds:
    """Return the smallest and the largest torque; see `Robot.torque_bounds`."""
    if wrench is None:
        return TorqueBounds(_of_box(robot, BOUNDS, (q, u, udot), uncertainty, t))
    if _is_loaded(robot):
        external = robot.external_force(q, wrench=wrench, t=t)
        state = q, u, udot, external
        return TorqueBounds(_of_box(robot, LOADED_BOUNDS, state, uncertainty, t))
    deviation = torque_deviation(robot, q, u, udot, uncertainty, t)
    torque = robot.inverse_dynamics(q, u, udot, wrench=wrench, t=t)
    return TorqueBounds(np.stack([torque - deviation, torque + deviation], axis=-2))


def torque_deviation(robot: Any, q: ArrayLike, u: ArrayLike, udot: ArrayLike,
                     uncertainty: Uncertainty, t: ArrayLike = 0.0, *,
                     of_joints: bool = False) -> Array:
    """
    Return the largest deviation of the torque from the model, |Y| delta, N m or N.

    Parameters
    ----------
    robot : Robot
        Without beams.
    q, u, udot, t
        As in `Robot.inverse_dynamics`.
    uncertainty : Uncertainty
        Of the robot's model.
    of_joints : bool
        Of the actuators' torques, `Robot.joint_torques`, instead of the generalized
        forces.

    Returns
    -------
    (n,) or (N, n) array; n_q instead of n with `of_joints`.

    """
    of_actuators = of_joints and not robot.equations.in_joint_rates
    place = JOINT_DEVIATION if of_actuators else DEVIATION
    return _of_box(robot, place, (q, u, udot), uncertainty, t)


def _of_box(robot: Any, place: tuple[str, str], state: tuple[ArrayLike, ...],
            uncertainty: Uncertainty, t: ArrayLike) -> Array:
    """Return the result of a kernel for states that share one box of uncertainties."""
    instance(uncertainty, Uncertainty, 'uncertainty')
    equations: Equations = robot.equations
    if (uncertainty.bodies != len(equations.model.bodies)
            or (uncertainty.has_payload and equations.tree.payload_frame is None)):
        _refuse(robot, uncertainty)
    kernel = robot._entries.get(place) or _compiled(robot, place)
    box: Array = uncertainty.box
    # The box is the same for all states of a batch, and so may be the time.
    count = shape_of(state[0], 'q')[:-1]
    if len(count) == 1:
        box = np.broadcast_to(box, (*count, len(box)))
    return np.asarray(kernel(*state, box, *equations.time_inputs(t, state[0])))


def _refuse(robot: Any, uncertainty: Uncertainty) -> NoReturn:
    """Raise InputError for a box of another robot."""
    bodies = robot.model.bodies
    if uncertainty.bodies != len(bodies):
        raise InputError(f'uncertainty: of {uncertainty.bodies} bodies; '
                         f'expected {len(bodies)}: '
                         f'{", ".join(body.name for body in bodies)}')
    raise InputError('uncertainty: of a payload, of a robot without payload frame; '
                     'expected Robot(..., payload_frame=...)')


def _compiled(robot: Any, place: tuple[str, str]) -> Callable[..., Any]:
    """Return the entry point of a kernel of a robot, which is compiled now."""
    # The bounds are sums of abs(regressor) times the box: linear in the parameters.
    if robot.model.flexible:
        raise InputError('robot: with beams; expected a rigid one, as the torque of '
                         'beams is not linear in their parameters')
    # Bounds that are not symmetric have no half-width.
    if _is_loaded(robot) and place not in (BOUNDS, LOADED_BOUNDS):
        refuse_load_friction(robot.model, 'uncertainty')
    kernel = _kernel(robot, place)
    entry: Callable[..., Any] = kernel.entry('', kernel)
    robot._entries[place] = entry
    return entry


def _is_loaded(robot: Any) -> bool:
    """Return whether the friction of any joint depends on the torque that it transmits."""
    return bool(robot.friction and carries_loads(robot.model))


def _kernel(robot: Any, place: tuple[str, str]) -> Kernel:
    """Return the kernel of the bounds, or of the deviation alone."""
    equations: Equations = robot.equations

    # The torque of the model and its largest deviation in the box, which is exact where
    # parameters are linear.
    def bounds(q: Vector, u: Vector, udot: Vector, box: Vector, t: Scalar,
               parameters: Vector, limits: Vector) -> Matrix:
        if equations.carries_loads:
            return under_force(q, u, udot, equations.zeros, box, t, parameters, limits)
        torque = equations.inverse_dynamics(q, u, udot, None, parameters, t)
        deviation = deviation_law(equations, q, u, udot, box, parameters, t)
        return guarded_result(np.stack([torque - deviation, torque + deviation]), q, t,
                              limits)

    def under_force(q: Vector, u: Vector, udot: Vector, external: Vector, box: Vector,
                    t: Scalar, parameters: Vector, limits: Vector) -> Matrix:
        result = loaded_bounds(equations, q, u, udot, external, box, parameters, t)
        return guarded_result(result, q, t, limits)

    def deviation(q: Vector, u: Vector, udot: Vector, box: Vector, t: Scalar,
                  parameters: Vector, limits: Vector) -> Vector:
        result = deviation_law(equations, q, u, udot, box, parameters, t,
                               of_joints=place == JOINT_DEVIATION)
        return guarded_result(result, q, t, limits)

    def guarded_result(result: Array, q: Vector, t: Scalar, limits: Vector) -> Array:
        if not equations.watched:
            return result
        return np.asarray(guarded(result, equations.margin(q, t, limits)))

    def reason(state: dict[str, Array]) -> Kernel | None:
        """Return the kernel in speeds that are regular at a state, or raise the error."""
        from kane_dynamics.robot.robot import in_regular_speeds
        regular = in_regular_speeds(robot, state)
        return None if regular is None else _kernel(regular, place)

    n = robot.n
    size = box_size(len(equations.model.bodies))
    inputs = {'q': (robot.n_q,), 'u': (n,), 'udot': (n,)}
    if place == LOADED_BOUNDS:
        inputs['external'] = (n,)
    inputs['box'] = (size,)
    laws = {BOUNDS: (bounds, (2, n)),
            LOADED_BOUNDS: (under_force, (2, n)),
            DEVIATION: (deviation, (n,)),
            JOINT_DEVIATION: (deviation, (robot.n_q,))}
    law, shape = laws[place]
    # A tree is never singular.
    explanation = None if equations.in_joint_rates else reason
    kernel: Kernel = robot.kernels.compiled(law, place[0], inputs, shape,
                                            reason=explanation)
    return kernel


def loaded_bounds(equations: Equations, q: Vector, u: Vector, udot: Vector,
                  external: Vector, box: Vector, parameters: Vector, t: Scalar) -> Matrix:
    """
    Return the least and the largest torque with load friction, (2, n).

    `external` is the generalized force of wrenches, (n,).
    """
    if not equations.in_joint_rates:
        _require_single_loads(equations, q, t)
    bodies = len(equations.model.bodies)
    # The numbers of the box on which loads depend: all but those of friction.
    of_loads = np.ones(box_size(bodies))
    losses = of_loads[-len(LOSSES) * bodies:].reshape(len(LOSSES), bodies)
    losses[:len(FRICTION)] = 0.0
    force = equations.rigid_dynamics(q, u, udot, None, parameters, t) - external
    of_force = deviation_law(equations, q, u, udot, of_loads * box, parameters, t)
    of_friction = deviation_law(equations, q, u, udot, (1.0 - of_loads) * box, parameters, t)

    # The torque as a function of the force without friction has a kink where the drive
    # transmits nothing. The force in the interval that is nearest to the kink is a place of
    # an extreme, in addition to both ends.
    least = force - of_force
    largest = force + of_force
    motion = equations.joint_motion(q, u, udot, t)
    kink = -motion.projected(_transmitted_damping(equations, motion))
    nearest = np.array([select(low > at, low, select(high < at, high, at))
                        for low, high, at in zip(least, largest, kink)])
    lower = upper = _with_friction(equations, q, motion, least, t)
    for at in (nearest, largest):
        torque = _with_friction(equations, q, motion, at, t)
        lower = np.array([select(x < y, x, y) for x, y in zip(torque, lower)])
        upper = np.array([select(x < y, y, x) for x, y in zip(torque, upper)])
    return np.stack([lower - of_friction, upper + of_friction])


def _transmitted_damping(equations: Equations, motion: JointMotion) -> Vector:
    """Return the damping of drives in the loads of joints with load friction, (n_j,)."""
    tree = equations.tree
    damping = np.array(tree.transmitted(motion.qdot, tree.zeros), dtype=object)
    for joint in equations.model.coordinate_joints:
        if not carries_load(joint):
            damping[joint.coordinate] = 0.0
    return damping


def _with_friction(equations: Equations, q: Vector, motion: JointMotion, force: Vector,
                   t: Scalar) -> Vector:
    """Return a generalized force plus the friction of drives that bear it, (n,)."""
    loads = equations.drive_torques(q, force, t)
    friction = equations.tree.friction_force(motion.qdot, loads)
    return force + motion.projected(friction)


def _require_single_loads(equations: Equations, q: Vector, t: Scalar) -> None:
    """Raise InputError if a drive's load or friction concerns several generalized forces."""
    T = equations.at_rest(q, t).T
    loads = np.stack([equations.drive_torques(q, unit, t) for unit in np.eye(equations.n)],
                     axis=1)
    for joint in equations.model.coordinate_joints:
        if not carries_load(joint):
            continue
        # The generalized forces to which its friction adds, and those that load its motor.
        acts_on = [r for r, x in enumerate(T[joint.coordinate]) if not is_zero(x)]
        bears = [r for r, x in enumerate(loads[joint.coordinate]) if not is_zero(x)]
        # A joint without a motor has no load.
        if bears and (acts_on != bears or len(bears) > 1):
            raise InputError(f"torque_bounds: joint '{joint.name}' has load friction "
                             f'{joint.load_friction:g}, and its load does not belong to one '
                             'speed; expected the rates of the joints with motors as speeds '
                             '(independent=, actuated=), because the largest torque is else '
                             'not the sum of largest parts')


def deviation_law(equations: Equations, q: Vector, u: Vector, udot: Vector, box: Vector,
                  parameters: Vector, t: Scalar, *, of_joints: bool = False) -> Vector:
    """
    Return |Y| delta, with the numbers of the box as delta, over any scalar.

    It is of the generalized forces, (n,), or with `of_joints` of the actuators' torques,
    (n_q,).
    """
    bodies = len(equations.model.bodies)
    inertial_size = 10 + 10 * bodies
    inertial = box[:inertial_size]
    losses = box[inertial_size:].reshape(len(LOSSES), bodies)

    # Columns of Y: of the payload, of the bodies, then one of each joint. Uncertain losses
    # of a joint act along one line, so that their half-widths add up.
    of_bodies = _regressor(equations, q, u, udot, parameters, t)
    of_payload = _payload_columns(equations, of_bodies)
    of_losses, loss_sizes = _loss_columns(equations, q, u, udot, losses, t)
    Y = np.concatenate([of_payload, of_bodies, of_losses], axis=1)
    delta = np.concatenate([inertial, loss_sizes])
    if of_joints:
        unit_forces = np.eye(equations.n)
        to_joints = np.stack([equations.joint_torques(unit, q, t)
                              for unit in unit_forces], axis=1)
        Y = to_joints @ Y
    return _absolute(Y) @ delta


def _regressor(equations: Equations, q: Vector, u: Vector, udot: Vector,
               parameters: Vector, t: Scalar) -> Matrix:
    """Return the regressor of the bodies; of large trees with subroutines."""
    if equations.in_joint_rates and equations.n > OUTLINED:
        return equations.tree.regressor(q, u, udot, parameters, Subroutines())
    return equations.regressor(q, u, udot, parameters, t)


def _payload_columns(equations: Equations, Y: Matrix) -> Matrix:
    """Return the columns of the payload's parameters, (n, 10), from those of its body."""
    frame = equations.tree.payload_frame
    if frame is None or frame.body == WORLD:
        return np.zeros((len(Y), 10))
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = frame.rotation, frame.translation
    # The pseudo-inertia on the body is pose P pose^T, linear in the ten parameters.
    on_body = [parameters_of(pose @ pseudo_inertia_of(unit) @ pose.T) for unit in np.eye(10)]
    own = 10 * frame.body
    return Y[:, own:own + 10] @ np.column_stack(on_body)


def _loss_columns(equations: Equations, q: Vector, u: Vector, udot: Vector,
                  losses: Matrix, t: Scalar) -> tuple[Matrix, Vector]:
    """
    Return the directions of the joints' torques, (n, bodies), and their half-widths.

    The direction of a joint is the generalized force of a unit torque in it.
    """
    motion = equations.joint_motion(q, u, udot, t)
    directions, sizes = [], []
    by_name = dict(zip(LOSSES, losses, strict=True))
    for k, body in enumerate(equations.model.bodies):
        joint = body.joint
        # The direction in which a torque at this joint acts on the independent speeds.
        unit = np.zeros(len(motion.qdot))
        unit[joint.coordinate] = joint.multiplier
        directions.append(motion.projected(unit))
        rate = joint.multiplier * motion.qdot[joint.coordinate]
        # The half-width adds up over armature and friction terms, since each is
        # independent of the others.
        size = _absolute_number(joint.multiplier * motion.qddot[joint.coordinate])
        size = size * by_name['armature'][k]
        if equations.tree.friction:
            for name in FRICTION:
                unit_friction = friction_torque(_with_only(joint, name), rate)
                size = size + _absolute_number(unit_friction) * by_name[name][k]
        sizes.append(size)
    return np.stack(directions, axis=1), np.array(sizes)


def _with_only(joint: Joint, name: str) -> Joint:
    """Return the joint with one kind of friction, of coefficient 1."""
    plain = Joint('plain', 'revolute', joint.axis)
    friction: dict[str, Any] = {term: getattr(plain, term) for term in LAW_FIELDS}
    friction[name] = 1.0
    if name == 'damping' and has_curved_damping(joint):
        friction.update(fast_damping=0.0, damping_speed=joint.damping_speed)
    return replace(joint, **friction)


def _absolute_number(x: Scalar) -> Scalar:
    """Return the absolute value of a number over any scalar."""
    return abs(x) if isinstance(x, int | float) else select(x < 0.0, -x, x)


def _absolute(values: Matrix) -> Matrix:
    """Return the absolute values of an array over any scalar."""
    flat = [_absolute_number(x) for x in np.ravel(values)]
    return np.array(flat, dtype=object).reshape(np.shape(values))
