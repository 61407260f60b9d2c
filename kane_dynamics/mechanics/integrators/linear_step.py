"""
The linearly implicit step of arms with elastic joints whose springs and dampers are linear.

It is the method of `rosenbrock` with less arithmetic: stiffness K and damping D are the
same in both stages, and all that depends on the configuration, the mass matrix M and the
forces of the bodies, is taken in the middle of the step, at q_m = q + h/2 u. Both stages
then share M and its factors. With the bodies' forces b(q, u), without springs and
friction, they solve

    (M + g D + g^2 K) a = tau_0 - b(q_m, u)   - K (q + g u) - D u
    (M + g D + g^2 K) w = tau_1 - b(q_m, u_1) - K (q + (h - g) u + 2 g (h - 2 g) a)
                                              - D (u + (h - 2 g) a)

with g = gamma h and u_1 = u + h a. K and D are those of the stages of `rosenbrock`,
collected, so that the damping of stiff springs is that of the method. The bodies' part
is of second order, because the mean of both stages has the middle of the step in q and
in u. Without springs and dampers, and with forces that do not depend on u, it is the
leapfrog method.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

from kane_dynamics._util.typing import Matrix, Scalar, Vector
from kane_dynamics.mechanics.algebra.ltdl import factorize, solve
from kane_dynamics.mechanics.elastic_joints import linear_drives
from kane_dynamics.mechanics.equations import Equations
from kane_dynamics.mechanics.friction import is_nonlinear
from kane_dynamics.model.drive import StiffnessCurve
import numpy as np


class StageWeights(NamedTuple):
    """
    Positions of springs and rates of dampers in a stage, as weights of u and of a.

    Springs are at q + `u_of_springs` u + `a_of_springs` a, dampers at u + `a_of_dampers` a.
    """

    u_of_springs: Scalar
    a_of_springs: Scalar
    a_of_dampers: Scalar

    def force(self, stiffness: float, damping: float, q: Scalar, u: Scalar, a: Scalar
              ) -> Scalar:
        """Return the force of a spring and a damper, collected by q, u and a."""
        of_u = self.u_of_springs * stiffness + damping
        of_a = self.a_of_springs * stiffness + self.a_of_dampers * damping
        return stiffness * q + of_u * u + of_a * a


class TreeTerms(NamedTuple):
    """
    Mass matrix and forces of the bodies of a tree, in one step.

    `mass_matrix(q)` is (n, n); `body_forces(q, u)`, (n,), are without springs and
    friction; `friction_factors` are factors on the joints' friction, (n,) or a scalar.
    """

    mass_matrix: Callable[[Vector], Matrix]
    body_forces: Callable[[Vector, Vector], Vector]
    friction_factors: Any


def is_linear(equations: Equations) -> bool:
    """Return whether `LinearStep` serves a robot: elastic joints, all forces linear."""
    tree = equations.tree
    # Only linear springs and dampers are constant within a step; see the module.
    if not equations.model.drives:
        return False
    if not equations.in_joint_rates:  # constraints, or matrices that vary with the time
        return False
    if tree.flexible or tree.bristles:
        return False
    for elastic in equations.model.drives:
        if isinstance(elastic.drive.stiffness, StiffnessCurve):
            return False
    joints = [body.joint for body in equations.model.bodies]
    return not (tree.friction and any(map(is_nonlinear, joints)))


def tree_terms(equations: Equations, wrench: Matrix | None, parameters: Vector,
               friction_factors: Any = 1.0) -> TreeTerms | None:
    """Return the terms for `LinearStep`; None for robots that it does not serve."""
    tree = equations.tree
    if not is_linear(equations):
        return None

    # Terms in the middle of the step, which both stages share.
    def mass_matrix(q: Vector) -> Matrix:
        M: Matrix = tree.mass_matrix(q, parameters)
        return M

    def body_forces(q: Vector, u: Vector) -> Vector:
        forces: Vector = tree.body_forces(q, u, tree.zeros, wrench, parameters)
        return forces
    return TreeTerms(mass_matrix, body_forces, friction_factors)


class LinearStep:
    """
    The step of one robot.

    Parameters
    ----------
    equations : Equations
        Equations of motion, which have `tree_terms`.
    gamma : float
        Of the method; g is gamma times the step.

    """

    def __init__(self, equations: Equations, gamma: float) -> None:
        """Collect the springs and dampers of joints, and of drives."""
        tree = equations.tree
        self._tree = tree
        self._gamma = gamma
        self._K, self._D = np.zeros((2, tree.n))
        for body in equations.model.bodies:
            joint = body.joint
            square = joint.multiplier**2
            self._K[joint.coordinate] += square * joint.stiffness
            if tree.friction:
                self._D[joint.coordinate] += square * joint.damping
        self._drive_K, self._drive_D = linear_drives(equations.model)
        if not tree.friction:
            self._drive_D = 0.0 * self._drive_D
        # Forces at position and rate 0: of springs with another rest, and offsets.
        zeros = np.zeros(tree.n)
        at_zero = tree.spring_force(zeros) + tree.friction_force(zeros)
        self._at_zero = np.asarray(at_zero, dtype=np.float64)
        # Only rates of joints with springs are implicit.
        self._sprung = (self._K + np.diag(self._drive_K) != 0.0).astype(float)

    def step(self, terms: TreeTerms, torque: Callable[[Vector, Vector, int], Vector],
             q: Vector, u: Vector, h: Scalar) -> tuple[Vector, Vector]:
        """
        Return q and u after a step of length h, s.

        ``torque(q, u, moment)``, (n,), is that at the beginning, 0, and at the end, 2.
        """
        tree = self._tree
        order = tree.order
        g = self._gamma * h
        middle = q + (0.5 * h) * u

        # First stage, with the torque at the step's beginning.
        at_beginning = StageWeights(g, 0.0, 0.0)
        forces = self._forces(q, u, tree.zeros, at_beginning, tree.zeros)
        net = torque(q, u, 0) - terms.body_forces(middle, u) - forces
        factors = factorize(self._matrix(terms, middle, g), order)
        a = solve(factors, order, net)

        # Second stage, with the torque at the end of an Euler step. Factors on friction
        # act on its change within the step; the torque has their other part.
        u_1 = u + h * a
        q_1 = q + h * (u + (g * self._sprung) * a)
        at_end = StageWeights(h - g, 2.0 * g * (h - 2.0 * g), h - 2.0 * g)
        of_dampers = h - 2.0 * g * (terms.friction_factors * np.ones(tree.n))
        forces = self._forces(q, u, a, at_end, of_dampers)
        net = torque(q_1, u_1, 2) - terms.body_forces(middle, u_1) - forces
        w = solve(factors, order, net)

        # The mean of both stages' rates; those of the positions are u + g a and
        # u_1 + g (w - 2 a).
        change = w - a
        rates = u + u_1 + (g * self._sprung) * change
        return q + (0.5 * h) * rates, u_1 + (0.5 * h) * change

    def _matrix(self, terms: TreeTerms, q: Vector, g: Scalar) -> Matrix:
        """Return M + g D + g^2 K, (n, n); entries that are zero cause no arithmetic."""
        M = terms.mass_matrix(q)
        D = np.diag(terms.friction_factors * self._D) + self._drive_D
        K = np.diag(self._K) + self._drive_K
        result = M.astype(object)
        # Springs and dampers couple few joints; the other entries stay those of M.
        for i, j in zip(*np.nonzero((D != 0.0) | (K != 0.0))):
            result[i, j] = result[i, j] + g * (D[i, j] + g * K[i, j])
        return result

    def _forces(self, q: Vector, u: Vector, a: Vector, weights: StageWeights,
                a_of_dampers: Vector) -> Vector:
        """
        Return the forces of springs and dampers of a stage, (n,).

        `a_of_dampers`, (n,), are the weights of the joints' own dampers.
        """
        # Springs and dampers of joints, each at one coordinate.
        forces: list[Scalar] = list(self._at_zero)
        for j, (stiffness, damping) in enumerate(zip(self._K, self._D)):
            if stiffness or damping:
                of_joint = weights._replace(a_of_dampers=a_of_dampers[j])
                force = of_joint.force(stiffness, damping, q[j], u[j], a[j])
                forces[j] = forces[j] + force

        # Springs and dampers of drives, between a motor and its link.
        for _, drive, link, motor in self._tree.model.drives:
            deflection = q[motor] - q[link]
            deflection_rate = u[motor] - u[link]
            deflection_change = a[motor] - a[link]
            damping = drive.damping if self._tree.friction else 0.0
            torque = weights.force(drive.stiffness_at_rest, damping, deflection,
                                   deflection_rate, deflection_change)
            forces[motor] = forces[motor] + torque
            forces[link] = forces[link] - torque
        return np.array(forces)
