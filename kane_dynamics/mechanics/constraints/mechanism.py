"""
A model with its generalized speeds and constraints: rows, linear system, joint motion.

The independent speeds u_I and the constraints are one linear system for the joint rates,

    [ Y_I ]        [ u_I - Z_I ]
    [  J  ] q'  =  [     b     ],      S q' = s,

and its time derivative gives q''. The inverse is S^-1 = [ T  N ]. The columns of T are the partial
joint rates of the independent speeds (nonholonomic under constraints), so a generalized force is
T^T times the joint forces. The columns of N are those of the auxiliary speeds J q' - b, which are
zero in every motion: N^T times the joint forces are the constraint forces (Kane & Levinson,
chapter 4).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

from kane_dynamics._util.typing import Matrix, Vector
from kane_dynamics.errors import ConstraintError
from kane_dynamics.mechanics.algebra import linear_solve
from kane_dynamics.mechanics.algebra.dual import moving, rates
from kane_dynamics.mechanics.ball_joints import coordinate_rates
from kane_dynamics.mechanics.constraints import (Closure, Constraint, ConstraintRows,
                                                 DependentSpeeds, PointVelocity, Prescribed,
                                                 Rolling)
from kane_dynamics.mechanics.constraints.mechanism_state import MechanismState
from kane_dynamics.mechanics.constraints.row_units import length_of, turning_rows
from kane_dynamics.mechanics.constraints.speeds import chosen, JOINT_RATES
from kane_dynamics.mechanics.recursive.link import Link
from kane_dynamics.model.model import Model
import numpy as np


@dataclass(frozen=True, eq=False)
class JointMotion:
    """
    The joint motion for given independent speeds.

    Attributes
    ----------
    qdot, qddot : (n_j,) arrays
        Rates and accelerations of the n_j = `model.n` joints, angular velocities of ball joints;
        rad or m, and s.
    T : (n_j, n) array
        Joint rates per unit of each independent speed.
    N : (n_j, m) array
        Joint rates per unit of each constraint's auxiliary speed.
    T_rate : (n_j, n) array
        Time derivative of T along the motion.
    unit : bool
        Whether T = 1 and dT/dt = 0, in every configuration. Products with them are then skipped.

    """

    qdot: Vector
    qddot: Vector
    T: Matrix
    N: Matrix
    T_rate: Matrix
    unit: bool = False

    def projected(self, joint_forces: Vector) -> Vector:
        """Return T^T f: forces of the joints, (n_j,) or (n_j, k), on the independent speeds."""
        return joint_forces if self.unit else self.T.T @ joint_forces

    def by_speeds(self, by_joints: Matrix) -> Matrix:
        """Return A T: columns for the independent speeds from those for the joints."""
        return by_joints if self.unit else by_joints @ self.T

    def congruent(self, M: Matrix) -> Matrix:
        """Return T^T M T for a symmetric M of the joints, exactly symmetric."""
        return M if self.unit else congruent(M, self.T)


class Mechanism:
    """
    A model with generalized speeds and constraints.

    Parameters
    ----------
    model : Model
    speeds : None, Speeds or callable
        See `speeds.chosen`; joint rates by default.
    constraints : sequence of constraints
    free, kept : sequences of int
        Indices of the independent speeds and of linearly independent rows, from
        `independent_speeds.choose_independent`.
    sizes : sequence of float, optional
        Approximate size of each row, in `units`; 1 by default.
    rank_tolerance : float
        Singular values up to this fraction of the largest count as zero, and so do residuals of
        rows that then follow from others (rad, or lengths of the mechanism).

    Attributes
    ----------
    in_joint_rates : bool
        Whether u = q', and there are no constraints: a tree as it comes from a URDF.
    in_joint_speeds : bool
        The same, but with ball joints u has their angular velocities: T = 1, no rows.
    length : float
        m, see `row_units.length_of`: scales moments to forces and angles to distances.
    units : (n_j,) array
        `length` for joints that slide, 1 rad for others.
    row_units : (m,) array
        Of each row's residual: 1 rad where it constrains a rotation, `length` elsewhere.

    """

    def __init__(self, model: Model, speeds: Any = None, constraints: Sequence[Constraint] = (),
                 free: Sequence[int] | None = None, kept: Sequence[int] | None = None,
                 sizes: Sequence[float] | None = None, rank_tolerance: float = 1e-9) -> None:
        """Store the parts; by default all speeds are independent and all rows kept."""
        self.model = model
        self.speeds = chosen(model, speeds)
        self.constraints = tuple(constraints)
        self.labels = tuple(label for c in self.constraints for label in c.labels)
        self.free = list(range(model.n)) if free is None else list(free)
        self.kept = list(range(len(self.labels))) if kept is None else list(kept)
        self.owners = tuple(c.name for c in self.constraints for _ in c.labels)
        self.sizes = (1.0,) * len(self.labels) if sizes is None else tuple(sizes)
        self._rolling = [c for c in self.constraints if isinstance(c, Rolling) and (
            c.has_surface_rows and sum(self.owners[k] == c.name for k in self.kept) == 3)]
        self.rank_tolerance = rank_tolerance
        self.in_joint_speeds = (not self.labels and self.speeds.key == JOINT_RATES
                                and self.free == list(range(model.n)))
        self.in_joint_rates = self.in_joint_speeds and not model.balls
        self.length = length_of(model, self.constraints)
        self.units = np.array([self.length if name in model.sliding else 1.0
                               for name in model.joint_names])
        self.row_units = np.where(self.turning, 1.0, self.length)
        names = [c.name for c in self.constraints]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise ConstraintError(f'constraints: {twice} given twice; expected different names')

    @property
    def n(self) -> int:
        """Return the number of independent speeds."""
        return len(self.free)

    @property
    def key(self) -> str | None:
        """
        Return an identifier among mechanisms of the model; None with user-defined functions.

        Only user-defined functions may depend on time.
        """
        parts = [repr(self.free), repr(self.kept), repr(self.sizes), self.speeds.key or None,
                 *(_described(constraint) for constraint in self.constraints)]
        return None if None in parts else '\n'.join(part for part in parts if part)

    @property
    def left_out(self) -> list[int]:
        """Return the indices of the rows that are redundant."""
        return [k for k in range(len(self.labels)) if k not in self.kept]

    @property
    def turning(self) -> tuple[bool, ...]:
        """Return for each row whether it constrains a rotation: rad and N m, not m and N."""
        return tuple(turns for constraint in self.constraints
                     for turns in turning_rows(constraint, self.model))

    def with_choice(self, free: Sequence[int], kept: Sequence[int]) -> 'Mechanism':
        """Return the same mechanism with other independent speeds or rows."""
        return Mechanism(self.model, self.speeds, self.constraints, free, kept, self.sizes,
                         self.rank_tolerance)

    @property
    def speed_names(self) -> tuple[str, ...]:
        """Return the names of the independent speeds, in order."""
        return tuple(self.speeds.names[r] for r in self.free)

    def state(self, q: Any, t: Any = 0.0, links: Sequence[Link] | None = None) -> MechanismState:
        """Return the mechanism at q, (n_q,), and t, over any scalar."""
        return MechanismState(self.model, self.speeds, q, t, links)

    def rows(self, here: MechanismState) -> ConstraintRows:
        """Return the rows of all constraints, in the order of `labels`."""
        parts = [constraint.rows(here) for constraint in self.constraints]
        J = np.concatenate([np.zeros((0, here.width)), *(part.J for part in parts)])
        b = np.concatenate([np.zeros(0), *(part.b for part in parts)])
        return ConstraintRows(J, b, tuple(x for part in parts for x in part.residual))

    def functions(self, here: MechanismState, of_state: bool) -> dict[tuple[str, str], Any]:
        """
        Return the user-defined functions that must be continuous, by name and unit.

        They are those of t alone or, with `of_state`, those of q and t.
        """
        units = {'position(t)': ' (m or rad)', 'the velocity of position(t)': ' (m/s or rad/s)',
                 'value(t)': ' (m/s or rad/s)'}
        found = {} if self.speeds.key or not of_state else {
            (f'speeds: {name}(q, t)', ''): x
            for name, x in zip('YZ', self.speeds.of(here.q, here.t))}
        for constraint in self.constraints:
            if isinstance(constraint, DependentSpeeds if of_state else
                          Prescribed | PointVelocity):
                found |= {(f"constraint '{constraint.name}': {name}", units.get(name, '')): x
                          for name, x in constraint.functions(here).items()}
        return found

    def system(self, here: MechanismState) -> tuple[Any, Any]:
        """
        Return S, (n_q, n_q), and s, (n_q,), of S q' = s at zero independent speeds.

        The first rows define the independent speeds, Y q' = u - Z, the others are the constraints.
        Rows of wheels with all rows kept are `Rolling.surface_rows`.
        """
        Y, Z = here.speed_rows(self.speed_names)
        parts = [constraint.surface_rows(here)[0] if constraint in self._rolling
                 else constraint.rows(here) for constraint in self.constraints]
        J = np.concatenate([np.zeros((0, here.width)), *(part.J for part in parts)])
        b = np.concatenate([np.zeros(0), *(part.b for part in parts)])
        return np.concatenate([Y, J[self.kept]]), np.concatenate([-Z, b[self.kept]])

    def _of_rows(self, here: MechanismState, N: Any) -> Any:
        """Return joint rates per unit of the auxiliary speeds of `rows`, from those of S."""
        result = np.array(N, dtype=object)
        for constraint in self._rolling:
            places = [k for k, row in enumerate(self.kept)
                      if self.owners[row] == constraint.name]
            result[:, places] = N[:, places] @ constraint.surface_rows(here)[1].T
        return result if self._rolling else N

    def joint_motion(self, q: Any, u: Any, udot: Any, t: Any = 0.0,
                     links: Sequence[Link] | None = None) -> JointMotion:
        """
        Return the joint motion.

        Parameters
        ----------
        q : (n_q,) array of scalars
            Coordinates, rad or m.
        u, udot : (n,) arrays of scalars
            Independent speeds and their rates.
        t : scalar
            Time, s.
        links : sequence of Link, optional
            Use the kinematics of these links, which are compiled.

        Raises
        ------
        ConstraintError
            S is singular in every configuration.

        """
        if self.in_joint_speeds:
            n = self.n
            return JointMotion(u, udot, np.eye(n), np.zeros((n, 0)), np.zeros((n, n)), unit=True)
        here = self.state(q, t, links)
        S, s = self.system(here)
        inverse = self.solved(S, np.eye(len(S)))
        none = np.zeros(len(self.kept)).astype(object)
        qdot = inverse @ (np.concatenate([u, none]) + s)
        S_moving, s_moving = self.system(
            self.state(moving(q, coordinate_rates(self.model, q, qdot)), moving(t, 1.0), links))
        S_rate = rates(S_moving)
        given = rates(s_moving) - S_rate @ qdot
        if links is not None:
            given = self._with_closures(given, here, qdot)
        qddot = inverse @ (np.concatenate([udot, none]) + given)
        T = inverse[:, :self.n]
        return JointMotion(qdot, qddot, T, self._of_rows(here, inverse[:, self.n:]),
                           -(inverse @ (S_rate @ T)))

    def _with_closures(self, given: Any, here: MechanismState, qdot: Any) -> Any:
        """
        Return s' - S' q' with the rows of closed loops by accelerations.

        Velocities and accelerations from joint to joint take less arithmetic than the time
        derivative of every entry of S.
        """
        found: dict[int, Any] = {}
        first = 0
        for constraint in self.constraints:
            if isinstance(constraint, Closure):
                found.update(enumerate(constraint.accelerations(here, qdot), first))
            first += len(constraint.labels)
        return np.array([*given[:self.n], *(
            -found[row] if row in found else x for row, x in zip(self.kept, given[self.n:]))])

    def solved(self, S: Any, right: Any) -> Any:
        """Return S^-1 times a vector or a matrix; ConstraintError if S is always singular."""
        try:
            return linear_solve.solution(S, right.reshape(len(S), -1)).reshape(right.shape)
        except ZeroDivisionError as error:
            row = error.args[0]
            names = (*self.speed_names, *(self.labels[k] for k in self.kept))
            raise ConstraintError(f"speeds and constraints: '{names[row]}' depends on the others "
                                  'in every configuration, so that the motion is not determined; '
                                  'expected independent rows') from None


def congruent(M: Matrix, T: Matrix) -> Matrix:
    """Return T^T M T for a symmetric M, exactly symmetric: equal expressions."""
    half = M @ T
    n = T.shape[1]
    upper = {(r, s): T[:, r] @ half[:, s] for r in range(n) for s in range(r, n)}
    return np.array([[upper[min(r, s), max(r, s)] for s in range(n)] for r in range(n)])


def _described(constraint: Constraint) -> str | None:
    """Return a constraint's exact parameters as text; None if one of them is a function."""
    words = [type(constraint).__name__]
    for field in fields(constraint):
        value = getattr(constraint, field.name)
        if callable(value):
            return None
        words.append(repr(value.tolist() if isinstance(value, np.ndarray) else
                          sorted(value.items()) if isinstance(value, Mapping) else value))
    return ' '.join(words)
