"""
The derivation of a mechanism's equations of motion on paper, step by step.

The functions of `mechanics.definition` run over SymPy symbols. Long entries of the
coefficients W, X, A, B and of accelerations get letters, as in the book, so that every
further expression is a short polynomial in them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from typing import Any

from kane_dynamics._util.checks import instance
from kane_dynamics._util.frozen import freeze
from kane_dynamics.closed_forms.auxiliary_speeds import with_auxiliary_speeds
from kane_dynamics.closed_forms.polynomials import operations, shortened
from kane_dynamics.closed_forms.symbolic import (
    as_matrix, as_scalars, Parameter, ParameterSymbols, symbolic_mechanism, symbols,
    unwrapped)
from kane_dynamics.closed_forms.variations import forces_by_variations
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.ball_joints import coordinate_rates
from kane_dynamics.mechanics.definition import kane, kinematics, nonholonomic
from kane_dynamics.mechanics.friction import refuse_load_friction
from kane_dynamics.model.model import Frame, WORLD
from kane_dynamics.robot.robot import Robot
import numpy as np
import sympy as sp

MOST = 7  # coordinates; the derivation of more is too long to read
LONG = 6  # operations; coefficients with more get a letter
LONG_DRIFT = 40  # of accelerations, which shorten where they are inserted
OWN = 'own'


class Derivation:
    """
    The steps of Kane's method for one mechanism, as SymPy objects.

    Attributes
    ----------
    robot : Robot
    q, u, udot : tuples of symbols
        Coordinates; all n_j generalized speeds, and their rates.
    free, dependent : lists of int
        Places in u of the n independent and the m dependent speeds.
    torques, wrench : tuples of symbols
        Of the actuated joints; forces and moments of the wrench frames, in their order.
    letters : dict of symbol to expression
        Letters of long coefficients, in the order of their evaluation, and the dependent
        speeds.
    conditions : tuple of expressions
        They are positive where the equations hold.
    Y, Z, W, X : SymPy matrices
        u = Y q' + Z of the joint rates q', and q' = W u + X.
    A, B : SymPy matrices
        u_D = A u_I + B, and u_D' = A u_I' + drift.
    drift : (m, 1) SymPy Matrix
    qdot : (n_q, 1) SymPy Matrix
        Kinematical differential equations.
    axes : str
        'own', 'world' or a frame: the axes of the vectors of all bodies and points.
    velocities, accelerations : dicts of str to (6, 1) SymPy Matrix
        By body or point: omega, then v (of the center of mass); alpha, then a.
    holonomic, partials : dicts of str to (6, n_j) and (6, n) SymPy Matrix
        Partial velocities of all speeds, and those of the independent speeds under the
        constraints.
    active : dict of str to (n, 1) SymPy Matrix
        Generalized active forces by source.
    M, inertia_bias : (n, n), (n, 1) SymPy Matrix
        Generalized inertia forces: F* = -(M u_I' + inertia_bias).
    energy : dict of str to (n, 1) SymPy Matrix
        F* ('inertia'), and the active force of 'gravity and springs', by variations of
        vectors, an independent derivation; empty unless asked for.
    auxiliary : dict of str to expression
        Constraint forces and moments by name, in terms of udot.
    operations_before : int
        Operations of M and bias as the sums over bodies give them.

    """

    def __init__(self, robot: Robot, numbers: bool, axes: str, points: Sequence[str],
                 auxiliary: Sequence[str], energy: bool) -> None:
        """Derive all steps in order; `derivation` describes the arguments."""
        self.robot = robot
        self.axes = axes
        rows = [force for force in auxiliary if force in robot.mechanism.labels]
        reactions = [force for force in auxiliary if force not in rows]
        self._table = ParameterSymbols(numbers)
        self._derive_speeds(reactions)
        self._derive_vectors(points)
        self._derive_forces(rows, reactions)
        self.energy = {}
        if energy:
            self.energy = forces_by_variations(
                self._model, self._q, self._joint_rates, self._joint_accelerations,
                self._T[:, :len(self.free)], self._paper.short)
        self.letters = self._paper.letters
        self.conditions = tuple(self._paper.conditions)

    def _derive_speeds(self, reactions: Sequence[str]) -> None:
        """Derive the kinematical differential equations and the constraints."""
        robot = self.robot
        numeric = with_auxiliary_speeds(robot.mechanism, reactions)
        mechanism = symbolic_mechanism(numeric, self._table, reactions)
        self._model = mechanism.model
        count = robot.model.n  # without the auxiliary speeds of reactions
        self.free = robot.mechanism.free
        self.dependent = nonholonomic.dependent_places(numeric)

        # Auxiliary speeds are symbols in velocities, and zero in the motion.
        at_rest = np.zeros(len(reactions)).astype(object)
        self.q, q = symbols(f'q{k + 1}' for k in range(robot.n_q))
        self.u, self._u = symbols(f'u{r + 1}' for r in range(mechanism.model.n))
        self.udot, udot = symbols(f'udot{r + 1}' for r in range(count))
        _, (t,) = symbols(['t'])
        self._q = q = np.concatenate([q, at_rest])
        u = np.concatenate([self._u[:count], at_rest])
        u_I = u[numeric.free]
        udot = np.concatenate([udot, at_rest])[numeric.free]

        start = robot.neutral() if robot.configuration is None else robot.configuration
        numbers = {parameter.symbol: parameter.value
                   for parameter in self._table.parameters.values()}
        self._paper = _Paper(self.u, {**numbers, **dict(zip(self.q, start)), t.value: 0.0})
        short = self._paper.short

        # u = Y q' + Z, its inverse q' = W u + X, and u_D = A u_I + B.
        Y, Z = mechanism.speeds.of(q, t)
        self.Y = short(Y[:count, :count])
        self.Z = short(Z[:count])
        self._parts = parts = nonholonomic.reduction(mechanism, q, t, self._paper.lettered)
        for r, expression in zip(self.dependent, short(parts.A @ u_I + parts.B)):
            self._paper.letters[self.u[r]] = expression
        self.W = as_matrix(parts.W)
        self.X = as_matrix(parts.X)
        self.A = as_matrix(parts.A[:, :len(self.free)])
        self.B = as_matrix(parts.B)
        self._T = nonholonomic.partials_of(mechanism, parts)
        self._joint_rates = nonholonomic.constrained_rates(parts, u)
        qdot = coordinate_rates(self._model, q, self._joint_rates)
        self.qdot = short(qdot[:robot.n_q])

        # u_D' = A u_I' + drift, and the accelerations, also at u_I' = 0.
        change = nonholonomic.drift(mechanism, parts, q, self._joint_rates, u_I, t,
                                    self._paper.lettered)
        self.drift = as_matrix(change.dependent)
        self._joint_accelerations, self._bias_accelerations = (
            nonholonomic.joint_accelerations(mechanism, parts, change, rates)
            for rates in (udot, np.zeros(len(udot)).astype(object)))

    def _derive_vectors(self, points: Sequence[str]) -> None:
        """Derive velocities, partial velocities and accelerations of bodies and points."""
        short = self._paper.short
        model, q, parts = self._model, self._q, self._parts
        bodies = kinematics.configurations(model, q)
        self.velocities, self.holonomic, self.partials, self.accelerations = (
            {}, {}, {}, {})
        for label, frame in _places(model, points).items():
            R = _axes(model, q, bodies, self.axes, frame)
            # Angular before linear, in the axes of R.
            turned = np.block([[np.zeros((3, 3)), R.T], [R.T, np.zeros((3, 3))]])
            by_joints = turned @ kinematics.frame_partial_velocities(
                model, frame, q, bodies=bodies)
            _, acceleration = kinematics.frame_motion(
                model, frame, q, self._joint_rates, self._joint_accelerations)
            self.velocities[label] = short(by_joints @ (parts.W @ self._u + parts.X))
            self.holonomic[label] = short(by_joints @ parts.W)
            self.partials[label] = short(by_joints @ self._T)
            self.accelerations[label] = short(turned @ acceleration)

    def _derive_forces(self, rows: Sequence[str], reactions: Sequence[str]) -> None:
        """Derive active and inertia forces, and the constraint forces by name."""
        short = self._paper.short
        model, q, T = self._model, self._q, self._T
        n = len(self.free)
        self.torques, torques = _torques(self.robot, model.n)
        wrench = _wrench(self.robot)
        self.wrench = tuple(map(unwrapped, wrench.ravel()))
        by_source = _active_forces(self.robot, model, q, self._joint_rates, torques, wrench)
        active = {source: short(T.T @ force) for source, force in by_source.items()}
        self.active = {source: force[:n, :] for source, force in active.items()
                       if not force.is_zero_matrix}
        derived_M = T.T @ kane.mass_matrix(model, q) @ T
        derived_bias = -(T.T @ kane.generalized_inertia_force(
            model, q, self._joint_rates, self._bias_accelerations))
        self.operations_before = operations([*as_matrix(derived_M), *as_matrix(derived_bias)])
        upper = short(np.triu(derived_M))
        M = sp.Matrix(*upper.shape, lambda r, s: upper[min(r, s), max(r, s)])
        bias = short(derived_bias)
        self.M = M[:n, :n]
        self.inertia_bias = bias[:n, :]

        # A reaction follows from the equation of its auxiliary speed, the force of a row from
        # the equation of the dependent speed that this row alone changes.
        self.auxiliary = {}
        udot = sp.Matrix([self.udot[r] for r in self.free])
        for k, reaction in enumerate(reactions, n):
            force = sum(force[k] for force in active.values())
            self.auxiliary[reaction] = (M[k, :n] @ udot)[0] + bias[k] - force
        joint_force = sum(by_source.values()) + kane.generalized_inertia_force(
            model, q, self._joint_rates, self._joint_accelerations)
        for row in rows:
            N = (self._parts.W[:, self.dependent]
                 @ self._parts.D[:, _kept_row(self.robot, row)])
            self.auxiliary[row] = short(np.array([-(N @ joint_force)]))[0]

    @property
    def bias(self) -> Any:
        """Return the bias force, (n, 1): M u_I' + bias = tau + external."""
        own = [force for source, force in self.active.items()
               if source in ('gravity', 'springs', 'friction')]
        return self.inertia_bias - sum(own, sp.zeros(len(self.free), 1))

    @property
    def right_side(self) -> Any:
        """Return f, (n, 1), of M u_I' = f: the sum of all forces at u_I' = 0."""
        return sum(self.active.values(), -self.inertia_bias)

    @property
    def inertia_force(self) -> Any:
        """Return F*, (n, 1)."""
        udot = sp.Matrix([self.udot[r] for r in self.free])
        return -(self.M * udot + self.inertia_bias)

    @property
    def speeds_of_tables(self) -> list[int]:
        """Return the places in u of the columns of `partials`: auxiliary ones last."""
        return [*self.free, *range(len(self.udot), len(self.u))]

    @property
    def parameters(self) -> list[Parameter]:
        """Return the parameters that appear."""
        return self._table.used(self.symbols_of_equations)

    @property
    def symbols_of_equations(self) -> set[Any]:
        """Return the symbols of all steps, and of the letters that they contain."""
        found: set[Any] = sp.Tuple(
            self.M, self.right_side, self.qdot, self.Y, self.Z, self.A, self.B, self.drift,
            *self.active.values(), *self.velocities.values(), *self.partials.values(),
            *self.accelerations.values(), *self.auxiliary.values()).free_symbols
        for symbol, expression in reversed(self.letters.items()):
            if symbol in found:
                found |= expression.free_symbols
        return found

    def text(self) -> str:
        """Return the steps as plain text."""
        from kane_dynamics.closed_forms.derivation_text import as_text
        return as_text(self)

    def markdown(self) -> str:
        """Return the steps as Markdown with formulas in LaTeX."""
        from kane_dynamics.closed_forms.derivation_text import as_markdown
        return as_markdown(self)

    def latex(self) -> str:
        """Return the steps as LaTeX, for a document with the package amsmath."""
        from kane_dynamics.closed_forms.derivation_text import as_latex
        return as_latex(self)

    def code(self, language: str = 'python') -> str:
        """Return a function that evaluates the equations, in 'python' or 'c' (C99)."""
        from kane_dynamics.closed_forms.derivation_code import as_code
        return as_code(self, language)

    def expanded(self, expression: Any) -> Any:
        """Return an expression or matrix in q, u_I, t and parameters, without letters."""
        values: dict[Any, Any] = {}
        for symbol, value in self.letters.items():
            values[symbol] = value.xreplace(values)
        return expression.xreplace(values)


class _Paper:
    """Shortens expressions, and gives letters to long ones."""

    def __init__(self, speeds: Sequence[Any], at: Mapping[Any, float]) -> None:
        """Start without letters; `at` are numbers at which signs are chosen."""
        self.letters: dict[Any, Any] = {}
        self.conditions: dict[Any, None] = {}
        self._speeds = speeds
        self._at = at

    def short(self, array: Any) -> Any:
        """Return the shortest forms of an array of scalars as a SymPy matrix."""
        matrix = as_matrix(array).applyfunc(self._signed)
        return sp.Matrix(*matrix.shape, shortened(list(matrix), self._speeds))

    def lettered(self, name: str, array: Any) -> Any:
        """Return the entries of an array, long ones and quotients as letters."""
        short = self.short(array)
        limit = LONG_DRIFT if name in ('U', 'V') else LONG
        for place in np.ndindex(short.shape):
            if sp.count_ops(short[place]) > limit or _is_quotient(short[place]):
                index = ''.join(str(k + 1) for k in place[:np.ndim(array)])
                symbol = sp.Symbol(f'{name}{index}', real=True)
                self.letters[symbol] = short[place]
                short[place] = symbol
        return as_scalars(short).reshape(np.shape(array))

    def _signed(self, expression: Any) -> Any:
        """Return an expression without |x| of functions of q, and note the sign of x."""
        for part in expression.atoms(sp.Abs):
            inner = part.args[0]
            if inner.free_symbols & set(self._speeds):
                continue
            sign = -1 if inner.subs(self._at) < 0 else 1
            self.conditions[sign * inner] = None
            expression = expression.xreplace({part: sign * inner})
        return expression


def _is_quotient(expression: Any) -> bool:
    """Return whether an expression divides by something else than a number."""
    return any(power.exp.is_negative and power.base.free_symbols
               for power in expression.atoms(sp.Pow))


def derivation(robot: Robot, *, numbers: bool = False, axes: str = OWN,
               points: Sequence[str] = (), auxiliary: Sequence[str] = (),
               energy: bool = False) -> Derivation:
    """
    Derive the equations of motion of a mechanism by Kane's method.

    Parameters
    ----------
    robot : Robot
        Of any kind, with its generalized speeds and constraints.
    numbers : bool
        Keep the mechanism's numbers instead of symbols for them.
    axes : str
        Axes of the vectors: 'own' (of each body), 'world', or a frame.
    points : sequence of str
        Frames whose origins are points of the tables.
    auxiliary : sequence of str
        Constraint forces to bring into evidence: names of constraint rows, or
        '<joint>:<direction>' with a direction x, y, z, rx, ry, rz of the joint's body.
    energy : bool
        Derive F*, gravity and springs by variations of vectors, too.

    Raises
    ------
    InputError
        Too many coordinates or terms, load friction, or an unknown frame or force.

    """
    instance(robot, Robot, 'robot')
    name = robot.model.name
    if robot.friction:
        refuse_load_friction(robot.model, f"derivation of '{name}'")
    if not 0 < robot.n_q <= MOST:
        raise InputError(f"derivation of '{name}': {robot.n_q} coordinates; expected 1 "
                         f'to {MOST}: choose fewer with --joints, --base or --tip, or '
                         'linear_form about one motion')
    return Derivation(robot, numbers, axes, points, auxiliary, energy)


def _places(model: Any, points: Sequence[str]) -> dict[str, Frame]:
    """Return frames at the centers of mass of bodies with mass, and at the points."""
    places = {}
    for k, body in enumerate(model.bodies):
        if unwrapped(body.inertial.mass) == 0 and not np.any(body.inertial.inertia):
            continue
        place = copy(Frame(body.name, k))
        freeze(place, 'translation', body.inertial.com)
        places[body.name] = place
    for point in points:
        places[f'point {point}'] = model.frame(point)
    return places


def _axes(model: Any, q: Any, bodies: Any, axes: str, frame: Frame) -> Any:
    """Return the axes of the vectors of a body or point, (3, 3), columns."""
    if axes == 'world' or (axes == OWN and frame.body == WORLD):
        return np.eye(3)
    if axes == OWN:
        return bodies[frame.body].R_wb
    R, _ = kinematics.frame_pose(model, model.frame(axes), q, bodies)
    return R


def _torques(robot: Robot, n: int) -> tuple[Any, Any]:
    """Return symbols of the torques of actuated joints, and the torques of all, (n,)."""
    actuated = [k for k, joint in enumerate(robot.model.joint_names)
                if joint in robot.actuated_names]
    torques = np.zeros(n).astype(object)
    plain, torques[actuated] = symbols(f'T{k + 1}' for k in actuated)
    return plain, torques


def _active_forces(robot: Robot, model: Any, q: Any, joint_rates: Any,
                   torques: Any, wrench: Any) -> dict[str, Any]:
    """Return the generalized active forces of the joint rates by source, (n_j,) each."""
    none = np.zeros(3)

    def force(**options: Any) -> Any:
        return kane.generalized_active_force(model, q, joint_rates, gravity=none,
                                             **options)
    springs = force(friction=False)
    forces = {'gravity': -kane.gravity_force(model, q), 'springs': springs}
    if robot.friction:
        forces['friction'] = force(friction=True) - springs
    forces['actuators'] = torques
    for frame, components in zip(robot.options['wrench_frames'], wrench):
        of_frame = {frame: (components[:3], components[3:])}
        forces[f'wrench at {frame}'] = force(friction=False, wrenches=of_frame) - springs
    return forces


def _wrench(robot: Robot) -> Any:
    """Return forces and moments of the wrench frames, (k, 6)."""
    names = []
    for k in range(1, len(robot.options['wrench_frames']) + 1):
        names += [f'{letter}{axis}{k}' for letter in 'FM' for axis in 'xyz']
    return symbols(names)[1].reshape(-1, 6)


def _kept_row(robot: Robot, name: str) -> int:
    """Return the place of a constraint row; InputError for a redundant one."""
    mechanism = robot.mechanism
    row = mechanism.labels.index(name)
    if row not in mechanism.kept:
        kept = ', '.join(mechanism.labels[k] for k in mechanism.kept)
        raise InputError(f"auxiliary: '{name}', a redundant row, whose force is not "
                         f'determined; expected one of {kept}')
    return mechanism.kept.index(row)
