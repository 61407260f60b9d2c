"""
Generalized speeds: u = Y(q, t) q' + Z(q, t), freely chosen (Kane & Levinson, chapter 2).

A choice is two functions over any scalar. Joint rates, Y = 1 and Z = 0, are the default;
other choices shorten the equations of common mechanisms. A user may define further ones.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from kane_dynamics._util.checks import instance
from kane_dynamics._util.typing import Matrix, Scalar, Vector
from kane_dynamics.errors import ConstraintError, InputError
from kane_dynamics.mechanics.algebra.user_functions import evaluated
from kane_dynamics.mechanics.definition import kinematics
from kane_dynamics.mechanics.recursive.tree_equations import NO_GRAVITY, TreeEquations
from kane_dynamics.model.model import Model
import numpy as np

Function = Callable[[Any, Any], Any]
JOINT_RATES = 'joint_rates'  # key of the default choice


@dataclass(frozen=True, eq=False)
class Speeds:
    """
    A choice of generalized speeds.

    Parameters
    ----------
    Y : callable
        ``Y(q, t)`` returns (n, n): the speeds' coefficients of the joint rates.
    Z : callable, optional
        ``Z(q, t)`` returns (n,): the speeds at q' = 0.
    names : sequence of str
        Names of the speeds; u1, u2 ... by default.
    key : str
        Identifies this choice among those of the same model in the kernel cache; empty
        for user-defined functions, which are not cached.
    definite : bool
        Whether Y is symmetric and positive definite everywhere, which saves arithmetic.

    """

    Y: Function
    Z: Function | None = None
    names: Sequence[str] = ()
    key: str = ''
    definite: bool = False

    def of(self, q: Vector, t: Scalar) -> tuple[Matrix, Vector]:
        """
        Return Y, (n, n), and Z, (n,), at q, t.

        Raises
        ------
        ConstraintError
            A function returns a wrong shape; names the function and both shapes.

        """
        # Without names, Y has a row for each coordinate.
        n = len(self.names) or len(q)
        Y = np.asarray(self._evaluated(self.Y, 'Y', q, t))
        if self.Z is None:
            Z = np.zeros(n)
        else:
            Z = np.asarray(self._evaluated(self.Z, 'Z', q, t))
        # User-defined functions may return anything that converts to an array.
        for name, value, shape in (('Y', Y, (n, n)), ('Z', Z, (n,))):
            if value.shape != shape:
                raise ConstraintError(f'{name}(q, t) returns shape {value.shape}; '
                                      f'expected {shape}, one row for each speed')
        return Y, Z

    def _evaluated(self, function: Function, name: str, q: Vector, t: Scalar) -> Any:
        """Return the value of a function; a user-defined one (no key) is checked."""
        if self.key:
            return function(q, t)
        return evaluated(function, f'speeds: {name}(q, t)', q, t)


def joint_rates(model: Model) -> Speeds:
    """Return u = q'; of ball joints, the angular velocity on the body's axes."""
    unit = np.eye(model.n)
    return Speeds(lambda q, t: unit, None, model.joint_names, JOINT_RATES)


def absolute_rates(model: Model) -> Speeds:
    """
    Return each body's angular velocity along its own joint axis; others are joint rates.

    The others are those of sliding joints and of the modes of beams. For a planar chain
    these are the rates of absolute angles, in which the equations of motion couple
    bodies through angle differences only.
    """
    instance(model, Model, 'model')
    # Only revolute joints have an angular velocity along their axis.
    body_of_joint = {}
    for k, body in enumerate(model.bodies):
        if body.joint.kind == 'revolute':
            body_of_joint[body.joint.name] = k

    def Y(q: Vector, t: Scalar) -> Matrix:
        # u_r = omega . axis, with omega = sum_s omega^s q_s': row r is omega^s . axis.
        configurations = kinematics.configurations(model, q)
        rows = []
        for r, joint in enumerate(model.coordinate_joints):
            if joint.name in body_of_joint:
                body = configurations[body_of_joint[joint.name]]
                rows.append(body.partial_angular_velocity @ body.axis)
            else:
                rows.append(np.eye(model.n)[r])
        return np.array(rows)

    names = tuple(f'{name}/absolute' for name in model.joint_names)
    return Speeds(Y, None, names, 'absolute_rates')


def body_angular_velocity(frame: str) -> Callable[[Model], Speeds]:
    """
    Return the speeds omega . b1, b2, b3 in a body's axes instead of angle rates.

    Parameters
    ----------
    frame : str
        A frame of a body that exactly three revolute joints move, such as a floating
        base; its axes are b1, b2, b3. All other speeds are joint rates.

    Returns
    -------
    callable
        Returns the `Speeds` of a model; ConstraintError unless exactly three revolute
        joints move the body.

    """
    def of(model: Model) -> Speeds:
        body_frame = model.frame(frame)
        # The revolute joints between the body and the base.
        turning = set()
        for k in model.path(body_frame.body):
            joint = model.bodies[k].joint
            if joint.kind == 'revolute':
                turning.add(joint.coordinate)
        angles = sorted(turning)
        if len(angles) != 3:
            names = ', '.join(model.joint_names[r] for r in angles) or 'none'
            raise ConstraintError(f"frame '{frame}': {len(angles)} revolute joints "
                                  f'({names}) move it; expected exactly three')

        def Y(q: Vector, t: Scalar) -> Matrix:
            # omega in the axes of the frame replaces the three angle rates.
            R, _ = kinematics.frame_pose(model, body_frame, q)
            J = kinematics.frame_partial_velocities(model, body_frame, q)
            omega = R.T @ J[3:]
            rows = list(np.eye(model.n).astype(object))
            for r, row in zip(angles, omega):
                rows[r] = row
            return np.array(rows)

        # The three speeds have the places of the angle rates that they replace.
        speed_names = list(model.joint_names)
        for r, part in zip(angles, ('x', 'y', 'z')):
            speed_names[r] = f'{frame}/omega_{part}'
        key = f'body_angular_velocity({frame!r})'
        return Speeds(Y, None, tuple(speed_names), key)
    return of


def momenta(model: Model) -> Speeds:
    """Return u = M(q) q', the momenta conjugate to the coordinates, N m s or N s."""
    instance(model, Model, 'model')
    tree = TreeEquations(model)

    def Y(q: Vector, t: Scalar) -> Matrix:
        return tree.mass_matrix(q, NO_GRAVITY)

    names = tuple(f'{name}/momentum' for name in model.joint_names)
    return Speeds(Y, None, names, 'momenta', definite=True)


def chosen_speeds(model: Model, choice: Any) -> Speeds:
    """
    Return the generalized speeds of the argument `speeds` of `Robot`.

    Parameters
    ----------
    model : Model
        The mechanism.
    choice : None, Speeds, or callable
        A callable takes the model and returns `Speeds`.

    Raises
    ------
    InputError
        The type is wrong, or the number of names differs from that of the coordinates.

    """
    speeds = joint_rates(model) if choice is None else choice
    # Functions such as `absolute_rates` choose speeds of the model.
    if callable(speeds):
        speeds = speeds(model)
    if not isinstance(speeds, Speeds):
        raise InputError(f'speeds: a {type(choice).__name__}; expected Speeds, or a '
                         'function that takes the model and returns them')
    names = tuple(speeds.names) or tuple(f'u{r + 1}' for r in range(model.n))
    if len(names) != model.n or len(set(names)) != len(names):
        raise InputError(f'names of the speeds: {list(names)}; expected {model.n} '
                         'different ones')
    return replace(speeds, names=names)


def speed_places(speeds: Speeds, names: Sequence[str]) -> list[int]:
    """Return the indices of speeds; ConstraintError lists the valid names."""
    for name in names:
        if name not in speeds.names:
            raise ConstraintError(f"no speed '{name}'; expected one of "
                                  f'{", ".join(speeds.names)}')
    return list(map(speeds.names.index, names))
