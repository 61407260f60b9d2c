"""
Motion under constraints from the tree's own equations and all rows of the Jacobian.

Nothing of the library's treatment of constraints is used: no independent speeds, no choice of
rows. At each time M q'' + h = J^T lambda and J q'' = -J' q' are solved in the least-squares sense,
DOP853 integrates, and every so often positions and velocities are projected onto the constraints.
"""

from kane_dynamics import Closure, Coupling, PointVelocity, Robot, Rolling
import numpy as np
from scipy.integrate import DOP853
from scipy.linalg import solve_triangular

DIFFERENCE = 1e-3  # of a unit of motion: for J' q' by differences of fourth order
RANK = 1e-7
LONGEST = 0.02  # s: a trial step that opens loops wide ends nowhere


def skew(v):
    """Return the matrix of v x."""
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


class Reference:
    """A mechanism's tree and constraints, written independently of the library."""

    def __init__(self, loops):
        """Compile the tree alone."""
        self.tree = Robot(loops.model, friction=False)
        self.constraints = loops.constraints
        self.names = loops.model.coordinate_names
        size = np.linalg.svd(self.rows(loops.q0)[0], compute_uv=False)
        self.rank = int(np.sum(size > RANK * size[0]))

    def rows(self, q):
        """Return J, all rows, and the residuals of positions with their own rows' numbers."""
        J, gaps, _ = self._stack(q, np.zeros(len(q)))
        places = [k for k, gap in enumerate(gaps) if gap is not None]
        return J, np.array([gaps[k] for k in places]), places

    def _stack(self, q, v):
        found = [row for constraint in self.constraints for row in self._rows_of(constraint, q, v)]
        J, gaps, rates = zip(*found)
        return np.array(J), gaps, np.array(rates)

    def _rows_of(self, constraint, q, v):
        """Return each row of J, its residual of position or None, and J' v."""
        if isinstance(constraint, Closure):
            return self._of_closure(constraint, q, v)
        rows = self._plain_rows(constraint, q)
        h = DIFFERENCE / max(1.0, float(np.abs(v).max()))
        near, far = ([(ahead[0] - back[0]) @ v for ahead, back in zip(
            *(self._plain_rows(constraint, q + sign * k * h * v) for sign in (1.0, -1.0)))]
            for k in (1.0, 2.0))
        return [(*row, (8.0 * a - b) / (12.0 * h)) for row, a, b in zip(rows, near, far)]

    def _of_closure(self, constraint, q, v):
        tree, none = self.tree, np.zeros(len(q))
        frames = constraint.first, constraint.second
        (T1, T2), (J1, J2) = ([of(frame, q) for frame in frames]
                              for of in (tree.frame_pose, tree.partial_velocities))
        c1, c2 = (tree.frame_acceleration(frame, q, v, none) for frame in frames)
        w1, w2 = J1[3:] @ v, J2[3:] @ v
        found = list(zip(J1[:3] - J2[:3], T1[:3, 3] - T2[:3, 3], c1[:3] - c2[:3]))
        axes = {'spherical': [], 'revolute': [constraint.axis],
                'weld': list(np.eye(3))}[constraint.kind]
        for axis in axes:
            a, b = T1[:3, :3] @ axis, T2[:3, :3] @ axis
            A, B = skew(a), skew(b)
            da, db = np.cross(w1, a), np.cross(w2, b)
            # a x b = 0; its rate is (w1 x a) x b + a x (w2 x b)
            rate = (B @ A @ c1[3:] - A @ B @ c2[3:] + np.cross(np.cross(w1, da), b)
                    + 2.0 * np.cross(da, db) + np.cross(a, np.cross(w2, db)))
            found += zip(B @ A @ J1[3:] - A @ B @ J2[3:], np.cross(a, b), rate)
        return found

    def _plain_rows(self, constraint, q):
        """Return the rows, and residuals or None, of a constraint that is no loop."""
        tree = self.tree
        if isinstance(constraint, Coupling):
            row = np.zeros(len(q))
            row[self.names.index(constraint.joint)] = 1.0
            for other, ratio in constraint.ratios.items():
                row[self.names.index(other)] -= ratio
            return [(row, row @ q - constraint.offset)]
        T, J = tree.frame_pose(constraint.frame, q), tree.partial_velocities(constraint.frame, q)
        if isinstance(constraint, PointVelocity):
            return [((T[:3, :3] @ constraint.direction) @ J[:3], None)]
        assert isinstance(constraint, Rolling)
        axle = T[:3, :3] @ constraint.axis
        down = -np.array([0.0, 0.0, 1.0]) + axle[2] * axle
        r = constraint.radius * down / np.linalg.norm(down)
        contact = J[:3] - skew(r) @ J[3:]
        return [(contact[0], None), (contact[1], None), (contact[2], T[2, 3] + r[2])]

    def acceleration(self, q, v):
        """Return q''."""
        J, _, rates = self._stack(q, v)
        free = self.tree.forward_dynamics(q, v, np.zeros(len(q)))
        L = np.linalg.cholesky(self.tree.mass_matrix(q))
        A = solve_triangular(L, J.T, lower=True)
        push = self._least(A.T, -rates - J @ free)
        return free + solve_triangular(L.T, push, lower=False)

    def projected(self, q, v):
        """Return the nearest state that meets the constraints."""
        for _ in range(4):
            J, gap, places = self.rows(q)
            if not len(gap) or np.abs(gap).max() < 1e-14:
                break
            q = q - np.linalg.lstsq(J[places], gap, rcond=RANK)[0]
        J = self.rows(q)[0]
        return q, v - self._least(J, J @ v)

    def _least(self, A, b):
        """Return the least solution with as many singular values as J has where it was begun."""
        U, size, V = np.linalg.svd(A, full_matrices=False)
        m = self.rank
        return V[:m].T @ ((U[:, :m].T @ b) / size[:m])

    def regularity(self, q):
        """Return the smallest singular value of J that is not zero by redundancy, relative."""
        size = np.linalg.svd(self.rows(q)[0], compute_uv=False)
        return float(size[self.rank - 1] / size[0])

    def motion(self, q, v, times, tolerance=1e-10, longest=LONGEST):
        """Return q and v at increasing times, (K, n_q) each, from time 0."""
        def slope(t, x):
            q, v = np.split(x, 2)
            return np.concatenate([v, self.acceleration(q, v)])
        found, now = [], 0.0
        for t in times:
            solver = DOP853(slope, now, np.concatenate([q, v]), t, rtol=tolerance,
                            atol=tolerance, max_step=longest)
            while solver.status == 'running':
                solver.step()
            if solver.status != 'finished':
                raise ArithmeticError(f'the reference stops at {solver.t} s')
            q, v = self.projected(*np.split(solver.y, 2))
            now = t
            found.append((q, v))
        return tuple(np.array(x) for x in zip(*found))
