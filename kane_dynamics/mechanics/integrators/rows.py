"""
Equations of motion in which rows hold joints and contacts, over any scalar.

With v = T u + X, the velocities J v of all rows and the directions D of their forces,

    M u' = net + T^T D^T f,    (J v' + J' v)_s = 0  of the rows s that are held

D is J, but for the normal of a contact that slides: its force has the friction with it,
which is opposite to the slip. Which rows are held are conditions, so one program serves
every choice of modes. A feedback of J v and of the distance takes out the error of the
integrator; it is zero in an exact motion, and so changes no order.
"""

from typing import NamedTuple

from kane_dynamics._util.typing import Matrix, Scalar, Vector
from kane_dynamics.mechanics.algebra.choice import magnitude, select
from kane_dynamics.mechanics.algebra.ltdl import factorize, solve
from kane_dynamics.mechanics.contacts import ContactRows
from kane_dynamics.mechanics.integrators.held_joints import LinearSystem, REGULAR, Solution
import numpy as np

IMMOBILE = 1e-24  # response of a row to its force, relative to those of all rows
BEGUN = 1e-9  # m/s: slip in the direction in which a contact begins to slide


class HeldJointRows(NamedTuple):
    """
    Rows of k joints, by their places among the joint rates.

    `held` are conditions; `past`, (k,), is how far a joint that a stop holds is past it.
    """

    joints: list[int]
    held: list[Scalar]
    past: Vector


class ContactModes(NamedTuple):
    """
    Conditions of c contacts, and directions (c, 2) near those of their slip.

    A contact that slides turns from such a direction by less than a right angle. `floors`,
    (c,), are distances that contacts keep.
    """

    touching: list[Scalar]
    sticking: list[Scalar]
    begins: Matrix
    friction: Vector
    floors: Vector


class StageRows(NamedTuple):
    """
    All rows of a robot in one stage of a step.

    Redundant rows share as in `forces`, (k + 3 c,), those of joints and then of contacts.
    """

    joints: HeldJointRows
    contacts: ContactRows | None
    modes: ContactModes
    feedback: float  # 1/s
    forces: Vector


def row_solution(system: LinearSystem, M: Matrix, force: Vector, rows: StageRows) -> Solution:
    """
    Return the solution of M w = force + T^T D^T f with the f that holds rows.

    Its f has the force of each joint, then of the normal and both tangents of each
    contact, (k + 3 c,).
    """
    joints, held, past = rows.joints
    n_j = len(system.v)
    T = np.eye(n_j) if system.T is None else system.T
    J, D, offsets, conditions = _contact_part(rows, system)
    near = rows.forces
    masked = {}
    if system.T is None:
        near = near[len(joints):]
        # Joints of a tree are held exactly: their rows and columns take no part.
        masked = dict(zip(joints, held))
    else:
        unit = np.eye(n_j)[joints]
        J = np.concatenate([unit, J])
        D = np.concatenate([unit, D])
        own = rows.feedback * (2.0 * system.v[joints] + rows.feedback * past)
        offsets = np.concatenate([own, offsets])
        conditions = [*held, *conditions]

    # Accelerations without f, and those due to a unit of each force.
    M_masked, net = _masked(M, force, masked)
    factors = factorize(M_masked, system.order)
    w_free = solve(factors, system.order, net)
    w_of_unit = np.zeros((len(w_free), len(D)))
    if len(D):
        columns = []
        for row in D @ T:
            of_unit = [_without(masked, i, x) for i, x in enumerate(row)]
            columns.append(solve(factors, system.order, np.array(of_unit)))
        w_of_unit = np.stack(columns, axis=1)
    free = J @ (T @ w_free + system.drift) + offsets
    # The forces nearest to the given ones: they differ only where rows are redundant.
    response = J @ (T @ w_of_unit)
    near = np.array([select(condition, x, 0.0) for condition, x in zip(conditions, near)])
    conditions = _movable(conditions, response, D @ T, M)
    f = near - forces_of_held(response, conditions, free + response @ near)
    w = w_free + w_of_unit @ f
    generalized = (D @ T).T @ f
    if not masked:
        return Solution(w, f, free, generalized)

    # The force on a held joint is what its row of M w = force lacks.
    of_joints = []
    for joint, condition in masked.items():
        lacking = M[joint] @ w - force[joint] - generalized[joint]
        of_joints.append(select(condition, lacking, 0.0))
    return Solution(w, np.concatenate([of_joints, f]), free,
                    generalized + np.eye(n_j)[joints].T @ np.array(of_joints))


def _contact_part(rows: StageRows, system: LinearSystem
                  ) -> tuple[Matrix, Matrix, Vector, list[Scalar]]:
    """Return J, D, the rates of J v without v', and the conditions of contacts."""
    contacts = rows.contacts
    if contacts is None:
        empty = np.zeros((0, len(system.v)))
        return empty, empty, np.zeros(0), []
    D = list(contacts.J)
    offsets = list(contacts.drift + 2.0 * rows.feedback * contacts.velocities)
    conditions: list[Scalar] = []
    for i, (touching, sticking) in enumerate(zip(rows.modes.touching, rows.modes.sticking)):
        normal = 3 * i
        error = contacts.distances[i] - rows.modes.floors[i]
        offsets[normal] = offsets[normal] + rows.feedback**2 * error
        # The direction of slip, also where the contact only begins to slide. Past the end
        # of the slip friction goes on smoothly: the guard of the slip ends the step there.
        begins = rows.modes.begins[i]
        slip = contacts.velocities[normal + 1:normal + 3] + BEGUN * begins
        along = direction(slip * select(slip @ begins < 0.0, -1.0, 1.0))
        friction = select(sticking, 0.0, rows.modes.friction[i])
        D[normal] = D[normal] - friction * (along @ contacts.J[normal + 1:normal + 3])
        conditions += [touching, sticking, sticking]
    return contacts.J, np.array(D), np.array(offsets), conditions


def _movable(conditions: list[Scalar], response: Matrix, rows: Matrix, M: Matrix
             ) -> list[Scalar]:
    """
    Return the conditions of rows that are held and that a motion could change.

    A row that only rounding moves, such as one across a plane mechanism, or of a point whose
    joints are all held, gets no force from its motion.
    """
    size: Scalar = 0.0  # of the responses without held joints
    for row in rows:
        for j, x in enumerate(row):
            size = size + x * x / M[j, j]
    movable = []
    for i, condition in enumerate(conditions):
        moves = select(magnitude(response[i, i]) > IMMOBILE * size, 1.0, 0.0)
        movable.append(select(condition, moves, 0.0) > 0.5)
    return movable


def direction(slip: Vector) -> Vector:
    """Return the unit vector of a slip, (2,), or zeros of none."""
    size = np.sqrt(slip[0] * slip[0] + slip[1] * slip[1])
    return slip * select(size > 0.0, 1.0 / select(size > 0.0, size, 1.0), 0.0)


def _masked(M: Matrix, force: Vector, masked: dict[int, Scalar]
            ) -> tuple[Matrix, Vector]:
    """Return M and a force with the rows and columns of held joints as of the unit matrix."""
    if not masked:
        return M, force
    n = len(force)
    result = np.empty((n, n), dtype=object)
    for i in range(n):
        for j in range(n):
            entry = M[i, j]
            for joint in {i, j} & masked.keys():
                entry = select(masked[joint], float(i == j), entry)
            result[i, j] = entry
    return result, np.array([_without(masked, i, x) for i, x in enumerate(force)])


def _without(masked: dict[int, Scalar], i: int, x: Scalar) -> Scalar:
    """Return an entry of a force, 0 if its joint is held."""
    return select(masked[i], 0.0, x) if i in masked else x


def forces_of_held(A: Matrix, conditions: list[Scalar], motion: Vector) -> Vector:
    """Return f, (k,), with A f = motion for held rows, by the regular A and a refinement."""
    k = len(conditions)
    if not k:
        return np.zeros(0)
    trace: Scalar = 0.0
    for i, condition in enumerate(conditions):
        trace = trace + select(condition, A[i, i], 0.0)
    trace = select(trace > 0.0, trace, 1.0)
    # Rows and columns that are not held are those of the unit matrix.
    masked = np.empty((k, k), dtype=object)
    exact = np.empty((k, k), dtype=object)
    for i in range(k):
        for j in range(k):
            entry = select(conditions[j], A[i, j], 0.0)
            exact[i, j] = select(conditions[i], entry, float(i == j))
            masked[i, j] = exact[i, j] + (REGULAR * trace if i == j else 0.0)
    right = np.array([select(condition, x, 0.0)
                      for condition, x in zip(conditions, motion)])
    factors = _elimination(masked)
    f = _solved(factors, right)
    return f + _solved(factors, right - exact @ f)


def _elimination(A: Matrix) -> Matrix:
    """Return L and U of A = L U in one matrix, without pivots: A is regular."""
    U = A.copy()
    for i in range(len(U)):
        reciprocal = 1.0 / U[i, i]
        for r in range(i + 1, len(U)):
            U[r, i] = U[r, i] * reciprocal
            U[r, i + 1:] = U[r, i + 1:] - U[r, i] * U[i, i + 1:]
    return U


def _solved(LU: Matrix, b: Vector) -> Vector:
    """Return x with L U x = b."""
    x = list(b)
    for i in range(len(x)):
        for j in range(i):
            x[i] = x[i] - LU[i, j] * x[j]
    for i in reversed(range(len(x))):
        for j in range(i + 1, len(x)):
            x[i] = x[i] - LU[i, j] * x[j]
        x[i] = x[i] / LU[i, i]
    return np.array(x)
