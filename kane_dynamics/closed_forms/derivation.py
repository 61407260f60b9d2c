"""
The derivation of a mechanism's equations of motion on paper, step by step.

The functions of `mechanics.definition` run over SymPy symbols. Long entries of the
coefficients W, X, A, B and of accelerations get letters, as in the book, so that every
further expression is a short polynomial in them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass
from typing import Any

from kane_dynamics._util.checks import instance
from kane_dynamics._util.frozen import freeze
from kane_dynamics._util.typing import Array
from kane_dynamics.closed_forms.auxiliary_speeds import with_auxiliary_speeds
from kane_dynamics.closed_forms.polynomials import operations, shortened
from kane_dynamics.closed_forms.symbolic import (
    as_matrix, Parameter, ParameterSymbols, scalar, symbolic_mechanism, symbols,
    unwrapped)
from kane_dynamics.closed_forms.variations import forces_by_variations
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.ball_joints import coordinate_rates
from kane_dynamics.mechanics.definition import kane, kinematics, nonholonomic
from kane_dynamics.mechanics.friction import refuse_load_friction
from kane_dynamics.model.model import Frame, WORLD
from kane_dynamics.native.tracing.program import OperationCount
from kane_dynamics.robot.robot import Robot
import numpy as np
import sympy as sp

MOST = 7  # coordinates; the derivation of more is too long to read
LONG = 6  # operations; coefficients with more get a letter
LONG_DRIFT = 40  # of accelerations, which shorten where they are inserted
OWN = 'own'


@dataclass(frozen=True, eq=False)
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
    parameters : list of Parameter
        Those that appear.
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
    operations_before : OperationCount
        Operations of M and bias as the sums over bodies give them.

    """

    robot: Robot
    q: tuple[Any, ...]
    u: tuple[Any, ...]
    udot: tuple[Any, ...]
    free: list[int]
    dependent: list[int]
    torques: tuple[Any, ...]
    wrench: tuple[Any, ...]
    parameters: list[Parameter]
    letters: dict[Any, Any]
    conditions: tuple[Any, ...]
    Y: Any
    Z: Any
    W: Any
    X: Any
    A: Any
    B: Any
    drift: Any
    qdot: Any
    axes: str
    velocities: dict[str, Any]
    holonomic: dict[str, Any]
    partials: dict[str, Any]
    accelerations: dict[str, Any]
    active: dict[str, Any]
    M: Any
    inertia_bias: Any
    energy: dict[str, Any]
    auxiliary: dict[str, Any]
    operations_before: OperationCount

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
    def symbols_of_equations(self) -> set[Any]:
        """Return the symbols of all steps, and of the letters that they contain."""
        matrices = [self.M, self.right_side, self.qdot, self.Y, self.Z, self.A, self.B,
                    self.drift, *self.active.values(), *self.velocities.values(),
                    *self.partials.values(), *self.accelerations.values(),
                    sp.Matrix(list(self.auxiliary.values()))]
        found: set[Any] = set()
        for matrix in matrices:
            found |= matrix.free_symbols
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
        for symbol in reversed(self.letters):
            expression = expression.subs(symbol, self.letters[symbol])
        return expression


class _Paper:
    """Shortens expressions, and gives letters to long ones."""

    def __init__(self, q: Sequence[Any], speeds: Sequence[Any],
                 at: Mapping[Any, float]) -> None:
        """Start without letters; `at` are numbers at which signs are chosen."""
        self.letters: dict[Any, Any] = {}
        self.conditions: dict[Any, None] = {}
        self._q = q
        self._speeds = speeds
        self._at = at

    def short(self, array: Any) -> Any:
        """Return the shortest forms of an array of scalars as a SymPy matrix."""
        entries = np.asarray(array, dtype=object)
        expressions = [self._signed(unwrapped(x)) for x in entries.ravel()]
        rows, columns = entries.shape if entries.ndim == 2 else (len(entries), 1)
        return sp.Matrix(rows, columns, shortened(expressions, self._q, self._speeds))

    def symmetric(self, array: Any) -> Any:
        """Return the shortest forms of a symmetric array; equal entries are shared."""
        n = len(array)
        upper = [(r, s) for r in range(n) for s in range(r, n)]
        entries = dict(zip(upper, self.short(np.array([array[k] for k in upper]))))
        return sp.Matrix(n, n, lambda r, s: entries[min(r, s), max(r, s)])

    def lettered(self, name: str, array: Any) -> Any:
        """Return the entries of an array, long ones and quotients as letters."""
        source = np.asarray(array, dtype=object)
        result = np.empty(source.shape, dtype=object)
        short = self.short(source)
        limit = LONG_DRIFT if name in ('U', 'V') else LONG
        for place, expression in zip(np.ndindex(source.shape), short, strict=True):
            index = ''.join(str(k + 1) for k in place)
            if sp.count_ops(expression) > limit or _is_quotient(expression):
                symbol = sp.Symbol(f'{name}{index}', real=True)
                self.letters[symbol] = expression
                expression = symbol
            result[place] = scalar(expression)
        return result

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
               energy: bool = False, near: Any = None) -> Derivation:
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
    near : (n_q,) array_like, optional
        Configuration at which signs of square roots are those of the equations. Default:
        the robot's.

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
    rows = [force for force in auxiliary if force in robot.mechanism.labels]
    reactions = [force for force in auxiliary if force not in rows]
    steps = _Steps(robot, ParameterSymbols(numbers), reactions, near)
    fields = steps.speeds()
    fields |= steps.vectors(axes, points)
    fields |= steps.forces(rows)
    fields['energy'] = steps.energy() if energy else {}
    result = Derivation(robot=robot, axes=axes, parameters=[], letters=steps.paper.letters,
                        conditions=tuple(steps.paper.conditions), **fields)
    used = result.symbols_of_equations
    result.parameters.extend(parameter for parameter in steps.table.parameters.values()
                             if parameter.symbol in used)
    return result


class _Steps:
    """The steps of a derivation in their order; each returns fields of `Derivation`."""

    def __init__(self, robot: Robot, table: ParameterSymbols, reactions: Sequence[str],
                 near: Any) -> None:
        """Prepare the mechanism of symbols, with a speed for each reaction."""
        self.robot = robot
        self.table = table
        self.reactions = reactions
        numeric = with_auxiliary_speeds(robot.mechanism, reactions)
        self.mechanism = symbolic_mechanism(numeric, table, reactions)
        self.model = self.mechanism.model
        self.free = numeric.free
        self.n = len(self.free) - len(reactions)
        self.dependent = nonholonomic.dependent_places(numeric)
        self.count = robot.model.n  # speeds without those of reactions

        # Auxiliary speeds are symbols in velocities, and zero in the motion.
        self.at_rest = np.zeros(len(reactions)).astype(object)
        self.q_symbols, q = symbols(f'q{k + 1}' for k in range(robot.n_q))
        self.u_symbols, self.u = symbols(f'u{r + 1}' for r in range(self.model.n))
        self.udot_symbols, udot = symbols(f'udot{r + 1}' for r in range(self.count))
        self.q = np.concatenate([q, self.at_rest])
        self.moving_u = np.concatenate([self.u[:self.count], self.at_rest])
        self.u_I = self.moving_u[self.free]
        self.udot = np.concatenate([udot, self.at_rest])[self.free]
        self.t = symbols(['t'])[1][0]

        values = {parameter.symbol: parameter.value
                  for parameter in table.parameters.values()}
        values.update(zip(self.q_symbols, _configuration(robot, near)))
        values[self.t.value] = 0.0
        self.paper = _Paper(self.q_symbols, self.u_symbols, values)

    def speeds(self) -> dict[str, Any]:
        """Return speeds, kinematical differential equations and constraints."""
        short = self.paper.short
        mechanism, q, t = self.mechanism, self.q, self.t
        Y, Z = mechanism.speeds.of(q, t)
        parts = nonholonomic.reduction(mechanism, q, t, self.paper.lettered)
        dependent_speeds = short(parts.A @ self.u_I + parts.B)
        for place, expression in zip(self.dependent, dependent_speeds):
            self.paper.letters[self.u_symbols[place]] = expression
        self.parts = parts
        self.T = nonholonomic.partials_of(mechanism, parts)
        self.joint_rates = nonholonomic.constrained_rates(parts, self.moving_u)
        self.change = nonholonomic.drift(mechanism, parts, q, self.joint_rates, self.u_I,
                                         t, self.paper.lettered)
        self.joint_accelerations = nonholonomic.joint_accelerations(
            mechanism, parts, self.change, self.udot)
        qdot = coordinate_rates(self.model, q, self.joint_rates)[:self.robot.n_q]
        count = self.count
        return {'q': self.q_symbols, 'u': self.u_symbols, 'udot': self.udot_symbols,
                'free': self.free[:self.n], 'dependent': self.dependent,
                'Y': short(Y[:count, :count]), 'Z': short(Z[:count]),
                'W': as_matrix(parts.W), 'X': as_matrix(parts.X),
                'A': as_matrix(parts.A[:, :self.n]), 'B': as_matrix(parts.B),
                'drift': as_matrix(self.change.dependent), 'qdot': short(qdot)}

    def vectors(self, axes: str, points: Sequence[str]) -> dict[str, Any]:
        """Return velocities, partial velocities and accelerations of bodies and points."""
        short = self.paper.short
        bodies = kinematics.configurations(self.model, self.q)
        tables: dict[str, dict[str, Any]] = {
            'velocities': {}, 'holonomic': {}, 'partials': {}, 'accelerations': {}}
        speeds = self.parts.W @ self.u + self.parts.X
        for label, frame in _places(self.model, points).items():
            R = _axes(self.model, self.q, bodies, axes, frame)
            # Angular before linear, in the axes of R.
            turned = np.block([[np.zeros((3, 3)), R.T], [R.T, np.zeros((3, 3))]])
            by_joints = turned @ kinematics.frame_partial_velocities(
                self.model, frame, self.q, bodies=bodies)
            _, acceleration = kinematics.frame_motion(
                self.model, frame, self.q, self.joint_rates, self.joint_accelerations)
            tables['velocities'][label] = short(by_joints @ speeds)
            tables['holonomic'][label] = short(by_joints @ self.parts.W)
            tables['partials'][label] = short(by_joints @ self.T)
            tables['accelerations'][label] = short(turned @ acceleration)
        return tables

    def forces(self, rows: Sequence[str]) -> dict[str, Any]:
        """Return active and inertia forces, and the constraint forces of rows and joints."""
        short = self.paper.short
        model, q, T, n = self.model, self.q, self.T, self.n
        torque_symbols, torques = _torques(self.robot)
        by_source = _active_forces(self.robot, model, q, self.joint_rates, torques)
        active = {source: short(T.T @ force) for source, force in by_source.items()}
        M_raw = T.T @ kane.mass_matrix(model, q) @ T
        at_rest = np.zeros(len(self.free)).astype(object)
        bias_accelerations = nonholonomic.joint_accelerations(
            self.mechanism, self.parts, self.change, at_rest)
        inertia_raw = -(T.T @ kane.generalized_inertia_force(model, q, self.joint_rates,
                                                             bias_accelerations))
        M = self.paper.symmetric(M_raw)
        inertia_bias = short(inertia_raw)

        # Each reaction by the equation of its auxiliary speed, each row by that of the
        # dependent speed that it alone changes.
        auxiliary = {}
        udot = sp.Matrix([self.udot_symbols[r] for r in self.free[:n]])
        for k, reaction in enumerate(self.reactions, n):
            total = (M[k, :n] @ udot)[0] + inertia_bias[k]
            auxiliary[reaction] = total - sum(force[k] for force in active.values())
        joint_force = sum(by_source.values()) + kane.generalized_inertia_force(
            model, q, self.joint_rates, self.joint_accelerations)
        for row in rows:
            N = self.parts.W[:, self.dependent] @ self.parts.D[:, _kept_row(self.robot, row)]
            auxiliary[row] = short(np.array([-(N @ joint_force)]))[0]
        return {'torques': torque_symbols,
                'wrench': tuple(map(unwrapped, _wrench(self.robot).ravel())),
                'active': {source: force[:n, :] for source, force in active.items()
                           if not force.is_zero_matrix},
                'M': M[:n, :n], 'inertia_bias': inertia_bias[:n, :], 'auxiliary': auxiliary,
                'operations_before': operations(
                    [unwrapped(x) for x in (*M_raw.ravel(), *inertia_raw)])}

    def energy(self) -> dict[str, Any]:
        """Return F*, gravity and springs by variations of vectors."""
        return forces_by_variations(
            self.model, self.q, self.joint_rates, self.joint_accelerations,
            self.T[:, :self.n], self.paper.short)


def _configuration(robot: Robot, near: Any) -> Array:
    """Return the configuration at which signs are chosen, (n_q,)."""
    if near is None:
        near = robot.configuration
    return robot.neutral() if near is None else np.asarray(near, dtype=np.float64)


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


def _torques(robot: Robot) -> tuple[Any, Any]:
    """Return symbols of the torques of actuated joints, and those of all joints."""
    names = robot.model.joint_names
    plain: list[Any] = []
    torques = np.zeros(len(names)).astype(object)
    for k, joint in enumerate(names):
        if joint in robot.actuated_names:
            symbol, torque = symbols([f'T{k + 1}'])
            plain += symbol
            torques[k] = torque[0]
    return tuple(plain), torques


def _active_forces(robot: Robot, model: Any, q: Any, joint_rates: Any,
                   torques: Any) -> dict[str, Any]:
    """Return the generalized active forces of the joint rates by source, (n_j,) each."""
    none = np.zeros(3)

    def force(**options: Any) -> Any:
        return kane.generalized_active_force(model, q, joint_rates, gravity=none,
                                             **options)
    springs = force(friction=False)
    forces = {'gravity': -kane.gravity_force(model, q), 'springs': springs}
    if robot.friction:
        forces['friction'] = force(friction=True) - springs
    more = np.zeros(model.n - len(torques)).astype(object)
    forces['actuators'] = np.concatenate([torques, more])
    for frame, wrench in zip(robot.options['wrench_frames'], _wrench(robot)):
        of_frame = {frame: (wrench[:3], wrench[3:])}
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
