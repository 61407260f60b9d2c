"""
Motions of the energy formulation that satisfy the speeds and constraints.

A constraint with a position-level residual, `residual(q, t)` = 0, is that residual
differentiated,

    (d residual / dq) q' = - d residual / dt,

independent of the constraint's own velocity equation; the others are velocity
components. The rates of W, X, A and B need no formulas: all numbers carry their time
derivative.
"""

from dataclasses import dataclass, replace
from typing import Any

from finite_kinematics import FiniteMechanismState
from hyperdual import joined, lifted, Parts, parts
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import ConstraintError
from kane_dynamics.mechanics.constraints.mechanism import Mechanism
import numpy as np


@dataclass(frozen=True, eq=False)
class AdmissibleMotion:
    """
    Motion that satisfies the speeds and constraints, at one time.

    Attributes
    ----------
    q, qdot, qddot : (n_q,) arrays
        Coordinates, their rates and accelerations; rad or m, and s.
    W, X : (n_q, n_q), (n_q,) arrays
        q' = W u + X.
    A, B : (m, n), (m,) arrays
        u_D = A u_I + B.
    variations : (n_q, n) array
        W_sr + sum_k W_sk A_kr: variation of q_s per virtual motion of independent speed
        r.
    J, b : (m, n_q), (m,) arrays
        The independent constraint rows, J q' = b.
    state : FiniteMechanismState
        Geometry at q, with velocity qdot.

    """

    q: Array
    qdot: Array
    qddot: Array
    W: Array
    X: Array
    A: Array
    B: Array
    variations: Array
    J: Array
    b: Array
    state: FiniteMechanismState

    def accelerated(self, udot: Array) -> 'AdmissibleMotion':
        """Return the motion with accelerations udot, (n,), of the speeds added."""
        return replace(self, qddot=self.qddot + self.variations @ udot)


def admissible(mechanism: Mechanism, q: Array, u: Array, udot: Array,
               t: float = 0.0) -> AdmissibleMotion:
    """
    Return the admissible motion for given independent speeds.

    Parameters
    ----------
    mechanism : Mechanism
        Model, generalized speeds, constraints, and the choice of independent ones.
    q : (n_q,) array
        Coordinates, rad or m.
    u, udot : (n,) arrays
        Independent speeds and their rates.
    t : float
        s.

    Raises
    ------
    ConstraintError
        If speeds or constraints are singular at q; the message names them.

    """
    rest = FiniteMechanismState(mechanism, q, np.zeros(mechanism.model.n), t)
    qdot = _motion(mechanism, rest, u, udot).qdot  # velocities need no rates
    return _motion(mechanism, FiniteMechanismState(mechanism, q, qdot, t), u, udot)


def _motion(mechanism: Mechanism, state: FiniteMechanismState, u: Array,
            udot: Array) -> AdmissibleMotion:
    """Return the motion; q'' is correct if `state` has the velocity q'."""
    n = mechanism.model.n
    free = mechanism.free
    dependent = [r for r in range(n) if r not in free]
    names = mechanism.speeds.names

    # q' = W u + X from u = Y q' + Z; every number carries its time derivative.
    Y, Z = mechanism.speeds.of(state.q, state.t)
    W = _solved(_in_time(state, Y), np.eye(n), f'speeds {", ".join(names)} are', state)
    X = -(W @ _in_time(state, Z))

    # u_D = A u_I + B from C u = b - J X, C = J W.
    J, b = _rows(mechanism, state)
    C = J @ W
    known = np.concatenate([-C[:, free], (b - J @ X)[:, None]], axis=1)
    rows = ', '.join(mechanism.labels[k] for k in mechanism.kept)
    dependent_names = ', '.join(names[r] for r in dependent)
    AB = _solved(C[:, dependent], known,
                 f'constraints {rows} on the speeds {dependent_names} are', state)
    A = AB[:, :-1]
    B = AB[:, -1]

    # The rate of q' is q''.
    variations = W[:, free] + W[:, dependent] @ A
    qdot = parts(variations @ _timed(u, udot) + W[:, dependent] @ B + X, 0)
    return AdmissibleMotion(
        q=parts(state.q, state.count).value, qdot=qdot.value, qddot=qdot.rate,
        W=_value(W), X=_value(X), A=_value(A), B=_value(B),
        variations=_value(variations), J=_value(J), b=_value(b), state=state)


def _value(numbers: Any) -> Array:
    """Return numbers without their time derivatives."""
    return parts(numbers, 0).value


def _rows(mechanism: Mechanism, state: FiniteMechanismState) -> tuple[Any, Any]:
    """Return J, (m, n_q), and b, (m,), of the independent rows, in time."""
    n = mechanism.model.n
    declared = mechanism.rows(state)
    J: list[Any] = []
    b: list[Any] = []
    for k in mechanism.kept:
        if declared.residual[k] is None:
            J.append(_in_time(state, declared.J[k]))
            b.append(_in_time(state, declared.b[k])[()])
        else:
            # d residual / dq is the row, -d residual / dt its right side; the latter are
            # the last of the variables of differentiation.
            residual = lifted(declared.residual[k], state.count)
            J.append(_timed(residual.gradient[:n], residual.gradient_rate[:n]))
            b.append(_timed(-residual.gradient[n], -residual.gradient_rate[n])[()])
    return np.array(J, dtype=object).reshape(len(J), n), np.array(b, dtype=object)


def _in_time(state: FiniteMechanismState, array: Any) -> Any:
    """Return an array with only its time derivative."""
    numbers = parts(array, state.count)
    return _timed(numbers.value, numbers.rate)


def _timed(values: Any, rates: Any) -> Any:
    """Return numbers combined with their time derivatives."""
    value = np.asarray(values, dtype=float)
    rate = np.asarray(rates, dtype=float)
    no_gradient = np.zeros((*value.shape, 0))
    return joined(Parts(value, no_gradient, rate, no_gradient))


def _solved(A: Any, b: Any, what: str, state: FiniteMechanismState) -> Any:
    """
    Return A^-1 b with its time derivative.

    The solution with A's numbers leaves a residual that is a pure rate. One refinement
    step removes it, because rates of rates are zero.
    """
    try:
        inverse = np.linalg.inv(parts(A, 0).value)
    except np.linalg.LinAlgError:
        q = parts(state.q, state.count).value
        raise ConstraintError(f'{what} singular at q = {q.tolist()}; expected '
                              'independent equations') from None
    first = inverse @ b
    return first + inverse @ (b - A @ first)
