"""
Linear equations of motion on paper, about an equilibrium or a steady motion.

The functions of `mechanics.definition` run over symbols for one deviation x at a time, and
every coefficient is cut after its first power. So the entries are short where the
equations of large motions are not: those of a bicycle about its upright motion.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from kane_dynamics._util.checks import finite_row, instance, number
from kane_dynamics.analysis.linearization import admitted, Linearization
from kane_dynamics.closed_forms.polynomials import shortened
from kane_dynamics.closed_forms.symbolic import (
    as_matrix, as_scalars, Parameter, ParameterSymbols, scalar, symbolic_mechanism)
from kane_dynamics.mechanics.ball_joints import require_angles
from kane_dynamics.mechanics.definition import kane, nonholonomic
from kane_dynamics.mechanics.friction import refuse_load_friction
from kane_dynamics.robot.robot import Robot
import numpy as np
import sympy as sp

X = sp.Symbol('x', real=True)  # the deviation
MATRICES = ('M', 'C', 'K', 'G', 'H', 'positions')


@dataclass(frozen=True, eq=False)
class LinearForm:
    """
    M du' + C du + K dq = dtau and dq' = G dq + H du, of deviations from a motion.

    Attributes
    ----------
    names : tuple of str
        Of the k entries of dq, then of the n entries of du, as of `Linearization`.
    M, C, K : (n, n), (n, n), (n, k) SymPy matrices
    G, H : (k, k), (k, n) SymPy matrices
    positions : (n_j, k) SymPy Matrix
        Deviations of all joints per unit of those in dq.
    parameters : list of Parameter
        Those that appear; coordinates q and speeds u of the motion are among them.

    """

    names: tuple[str, ...]
    M: Any
    C: Any
    K: Any
    G: Any
    H: Any
    positions: Any
    parameters: list[Parameter]

    @property
    def A(self) -> Any:  # noqa: N802
        """Return A, (k + n, k + n), of x' = A x + B dtau with x = [dq, du]."""
        lower = self.M.inv() * self.K.row_join(self.C)
        return self.G.row_join(self.H).col_join(-lower)

    @property
    def B(self) -> Any:  # noqa: N802
        """Return B, (k + n, n)."""
        return sp.zeros(*self.H.shape).col_join(self.M.inv())

    def characteristic(self, names: Sequence[str], symbol: Any) -> Any:
        """
        Return the characteristic polynomial of these entries of x, a SymPy expression.

        Its roots are eigenvalues if the other entries have no part in the rates of these.
        """
        places = [self.names.index(name) for name in names]
        A = self.A.extract(places, places)
        return sp.cancel((symbol * sp.eye(len(places)) - A).det(method='berkowitz'))

    def numeric(self, values: Mapping[Any, float] | None = None) -> Linearization:
        """Return the equations in numbers; `values` replace the values of some symbols."""
        numbers = {parameter.symbol: parameter.value for parameter in self.parameters}
        numbers.update(values or {})
        M, C, K, G, H, positions = (
            np.array(getattr(self, name).subs(numbers), dtype=np.float64)
            for name in MATRICES)
        A = np.block([[G, H], [-np.linalg.solve(M, np.hstack([K, C]))]])
        B = np.concatenate([np.zeros(H.shape), np.linalg.inv(M)])
        return Linearization(A, B, self.names, positions)


def linear_form(robot: Robot, q: Any = None, u: Any = None, *, numbers: bool = False,
                t: float = 0.0) -> LinearForm:
    """
    Return the linear equations of motion about a state, in symbols.

    The torques keep the speeds, like in `linearized`, which returns the same equations in
    numbers. Under constraints, only deviations that the constraints admit are considered.
    A relation of the parameters that closes a loop at this state is not used.

    Parameters
    ----------
    robot : Robot
        Of any kind without ball joints.
    q : (n_q,) array_like, optional
        Coordinates that meet the constraints, rad or m. Zeros stay zeros, others are
        symbols. Default: `Robot.neutral`.
    u : (n,) array_like, optional
        Independent speeds, likewise. Default: at rest.
    numbers : bool
        Keep the mechanism's numbers instead of symbols for them.
    t : float
        Time, s.

    Raises
    ------
    InputError
        Ball joints, load friction, expressions of too many terms, or a wrong argument.

    """
    instance(robot, Robot, 'robot')
    model = robot.model
    label = f"linear_form of '{model.name}'"
    require_angles(model, label)
    if robot.friction:
        refuse_load_friction(model, label)
    q = robot.neutral() if q is None else finite_row(q, 'q', robot.coordinate_names)
    u = np.zeros(robot.n) if u is None else finite_row(u, 'u', robot.speed_names)
    t = number(t, 't', 'a finite number, s', np.isfinite)
    table = ParameterSymbols(numbers)
    mechanism = symbolic_mechanism(robot.mechanism, table)
    # The motion is always of symbols.
    nominal = ParameterSymbols()
    q_0 = _nominal(nominal, 'q', q, robot.coordinate_names)
    u_0 = _nominal(nominal, 'u', u, robot.speed_names)
    tangent = _Tangent(mechanism, q_0, robot.friction, t)
    independent, _ = admitted(robot, q, np.eye(model.n), t)
    positions = tangent.positions(independent)

    # One deviation at a time: of each independent joint, then of each speed.
    by_q = [tangent.slopes(q_0 + column * scalar(X), u_0) for column in positions.T]
    by_u = []
    for unit in np.eye(robot.n).astype(object):
        by_u.append(tangent.slopes(q_0, u_0 + unit * scalar(X)))
    matrices = [tangent.mass_matrix()]
    for columns in (by_u, by_q):
        matrices.append(sp.Matrix.hstack(*(force for force, _ in columns)))
    for columns in (by_q, by_u):
        rows = [qdot.extract(independent, [0]) for _, qdot in columns]
        matrices.append(sp.Matrix.hstack(sp.zeros(len(independent), 0), *rows))
    matrices.append(as_matrix(positions))
    used = set().union(*(matrix.free_symbols for matrix in matrices))
    parameters = [*nominal.used(used), *table.used(used)]
    names = [model.joint_names[k] for k in independent]
    names += [f'rate of {name}' for name in robot.speed_names]
    return LinearForm(names=tuple(names), parameters=parameters,
                      **dict(zip(MATRICES, matrices)))


def _nominal(table: ParameterSymbols, letter: str, values: Any,
             names: Sequence[str]) -> Any:
    """Return coordinates or speeds of the motion as symbols, zeros as zeros."""
    unit = 'rad or m' if letter == 'q' else 'rad/s or m/s'
    return np.array([table.scalar(f'{letter}{k}', value, unit, f'{name} in the motion')
                     for k, (name, value) in enumerate(zip(names, values), 1)],
                    dtype=object)


class _Tangent:
    """Forces and rates of a mechanism to first order in the deviation X."""

    def __init__(self, mechanism: Any, q: Any, friction: bool, t: float) -> None:
        """Store the mechanism of symbols, and its coordinates in the motion."""
        self._mechanism = mechanism
        self._q = q
        self._friction = friction
        self._t = t

    def linear(self, name: str, array: Any) -> Any:
        """Return scalars cut after the first power of X, each coefficient short."""
        matrix = as_matrix(array)
        values = list(matrix.subs(X, 0).doit())
        slopes = list(matrix.diff(X).subs(X, 0).doit())
        short = shortened([*values, *slopes])
        linear = [x + X * slope for x, slope in zip(short, short[len(values):])]
        return as_scalars(sp.Matrix(*matrix.shape, linear)).reshape(np.shape(array))

    def positions(self, independent: Sequence[int]) -> Any:
        """Return the deviations of all joints per unit of the independent ones."""
        n = self._mechanism.model.n
        dependent = [k for k in range(n) if k not in independent]
        positions = np.zeros((n, len(independent))).astype(object)
        positions[independent] = np.eye(len(independent))
        if not dependent:
            return positions
        rows = self._mechanism.rows(self._mechanism.state(self._q, self._t))
        of_positions = [k for k in self._mechanism.kept if rows.residual[k] is not None]
        R = self.linear('R', rows.J[of_positions])
        inverse = nonholonomic.inverse(R[:, dependent])
        positions[dependent] = self.linear('P', -(inverse @ R[:, independent]))
        return positions

    def slopes(self, q: Any, u: Any) -> tuple[Any, Any]:
        """Return the slopes of T^T times the joints' forces at u' = 0, and of q'."""
        mechanism = self._mechanism
        parts = nonholonomic.reduction(mechanism, q, self._t, self.linear)
        T = self.linear('T', nonholonomic.partials_of(mechanism, parts))
        speeds = nonholonomic.all_speeds(mechanism, parts, u)
        qdot = self.linear('rates', nonholonomic.constrained_rates(parts, speeds))
        change = nonholonomic.drift(mechanism, parts, q, qdot, u, self._t, self.linear)
        at_rest = np.zeros(len(u)).astype(object)
        qddot = nonholonomic.joint_accelerations(mechanism, parts, change, at_rest)
        force = kane.generalized_inertia_force(mechanism.model, q, qdot,
                                               self.linear('accelerations', qddot))
        force = force + kane.generalized_active_force(mechanism.model, q, qdot,
                                                      friction=self._friction)
        force = self.linear('force', T.T @ self.linear('joint force', -force))
        return as_matrix(force).diff(X), as_matrix(qdot).diff(X)

    def mass_matrix(self) -> Any:
        """Return M in the motion, (n, n)."""
        M = nonholonomic.mass_matrix(self._mechanism, self._q, self._t)
        return as_matrix(self.linear('M', M))
