"""
Motion under constraints from the tree's own equations and all rows of the Jacobian.

Nothing of the library's treatment of constraints is used: no independent speeds, no
choice of rows. At each time M q'' + h = J^T lambda and J q'' = -J' q' are solved in the
least-squares sense, DOP853 integrates, and every so often positions and velocities are
projected onto the constraints. Every function takes one state, (n,), or N states, (N,
n), which share their steps.
"""

from kane_dynamics import Closure, Coupling, PointVelocity, Robot, Rolling
import numpy as np
from scipy.integrate import DOP853

DIFFERENCE = 1e-3  # of a unit of motion: for J' q' by differences of fourth order
RANK = 1e-7
LONGEST = 0.02  # s: a trial step that opens loops wide ends nowhere
TOLERANCE = 1e-13  # of DOP853: free motions of several loops amplify errors by up to 1e7
PERTURBED = 1e-9  # rad or m
SKEW = np.zeros((3, 3, 3))  # v x w = (v @ SKEW) w
for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
    SKEW[i, j, k] = -1.0
    SKEW[i, k, j] = 1.0
SKEW = SKEW.reshape(3, 9)


def skew(v):
    """Return the matrix of v x."""
    return (v @ SKEW).reshape(*v.shape[:-1], 3, 3)


def product(A, x):
    """Return A x for each of N."""
    return (A @ x[..., None])[..., 0]


def cross(a, b):
    """Return a x b for each of N."""
    return product(skew(a), b)


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
        """Return J, all rows, and the residuals of positions with their rows."""
        J, gaps, _ = self._stack(q, np.zeros(q.shape))
        places = [k for k, gap in enumerate(gaps) if gap is not None]
        return J, np.array([gaps[k] for k in places]).T, places

    def _stack(self, q, v):
        """Return J, each row's residual of position or None, and J' v."""
        J = []
        gaps = []
        rates = []
        for constraint in self.constraints:
            rows, gap, rate = (self._of_closure if isinstance(constraint, Closure)
                               else self._of_other)(constraint, q, v)
            J.append(rows)
            gaps += gap
            rates.append(rate)
        return np.concatenate(J, axis=-2), gaps, np.concatenate(rates, axis=-1)

    def _of_other(self, constraint, q, v):
        h = DIFFERENCE / max(1.0, float(np.abs(v).max()))
        J, gaps = self._plain_rows(constraint, q)
        near, far = (product(self._plain_rows(constraint, q + k * h * v)[0]
                             - self._plain_rows(constraint, q - k * h * v)[0], v)
                     for k in (1.0, 2.0))
        return J, gaps, (8.0 * near - far) / (12.0 * h)

    def _of_closure(self, constraint, q, v):
        tree = self.tree
        none = np.zeros(q.shape)
        frames = constraint.first, constraint.second
        (T1, T2), (J1, J2) = ([of(frame, q) for frame in frames]
                              for of in (tree.frame_pose, tree.jacobian))
        c1, c2 = (tree.frame_acceleration(frame, q, v, none) for frame in frames)
        moment1 = J1[..., 3:, :]
        moment2 = J2[..., 3:, :]
        w1 = product(moment1, v)
        w2 = product(moment2, v)
        J = [J1[..., :3, :] - J2[..., :3, :]]
        rates = [c1[..., :3] - c2[..., :3]]
        gaps = [T1[..., :3, 3] - T2[..., :3, 3]]
        axes = {'spherical': [], 'revolute': [constraint.axis],
                'weld': list(np.eye(3))}[constraint.kind]
        for axis in axes:
            a = T1[..., :3, :3] @ axis
            b = T2[..., :3, :3] @ axis
            A = skew(a)
            B = skew(b)
            BA = B @ A
            AB = A @ B
            da = cross(w1, a)
            db = cross(w2, b)
            # a x b = 0; its rate is (w1 x a) x b + a x (w2 x b)
            rates.append(product(BA, c1[..., 3:]) - product(AB, c2[..., 3:])
                         + cross(cross(w1, da), b) + 2.0 * cross(da, db)
                         + cross(a, cross(w2, db)))
            J.append(BA @ moment1 - AB @ moment2)
            gaps.append(cross(a, b))
        return (np.concatenate(J, axis=-2), list(np.concatenate(gaps, axis=-1).T),
                np.concatenate(rates, axis=-1))

    def _plain_rows(self, constraint, q):
        """Return the rows, and residuals or None, of a constraint that is no loop."""
        tree = self.tree
        if isinstance(constraint, Coupling):
            row = np.zeros(q.shape)
            row[..., self.names.index(constraint.joint)] = 1.0
            for name, ratio in constraint.ratios.items():
                row[..., self.names.index(name)] -= ratio
            return row[..., None, :], [np.sum(row * q, axis=-1) - constraint.offset]
        T = tree.frame_pose(constraint.frame, q)
        J = tree.jacobian(constraint.frame, q)
        if isinstance(constraint, PointVelocity):
            direction = T[..., :3, :3] @ constraint.direction
            return direction[..., None, :] @ J[..., :3, :], [None]
        assert isinstance(constraint, Rolling)
        axle = T[..., :3, :3] @ constraint.axis
        down = -np.array([0.0, 0.0, 1.0]) + axle[..., 2:] * axle
        r = constraint.radius * down / np.linalg.norm(down, axis=-1, keepdims=True)
        contact = J[..., :3, :] - skew(r) @ J[..., 3:, :]
        return contact, [None, None, T[..., 2, 3] + r[..., 2]]

    def acceleration(self, q, v):
        """Return q''."""
        J, _, rates = self._stack(q, v)
        free = self.tree.forward_dynamics(q, v, np.zeros(q.shape))
        L = np.linalg.cholesky(self.tree.mass_matrix(q))
        A = np.linalg.solve(L, J.swapaxes(-1, -2))
        push = self._least(A.swapaxes(-1, -2), -rates - product(J, free))
        return free + np.linalg.solve(L.swapaxes(-1, -2), push[..., None])[..., 0]

    def projected(self, q, v):
        """Return the nearest state that meets the constraints."""
        for _ in range(4):
            J, gap, places = self.rows(q)
            if not gap.size or np.abs(gap).max() < 1e-14:
                break
            q = q - product(np.linalg.pinv(J[..., places, :], rcond=RANK), gap)
        J = self.rows(q)[0]
        return q, v - self._least(J, product(J, v))

    def _least(self, A, b):
        """Return the least solution, with as many singular values as J had before."""
        U, size, V = np.linalg.svd(A, full_matrices=False)
        m = self.rank
        return product(V[..., :m, :].swapaxes(-1, -2),
                       product(U[..., :m].swapaxes(-1, -2), b) / size[..., :m])

    def regularity(self, q):
        """Return J's smallest singular value not zero by redundancy, relative."""
        size = np.linalg.svd(self.rows(q)[0], compute_uv=False)
        return float(size[self.rank - 1] / size[0])

    def motion(self, q, v, times, tolerance=TOLERANCE, longest=LONGEST):
        """Return q and v at increasing times, (K, n) or (K, N, n) each, from time 0."""
        def slope(t, x):
            q, v = x.reshape(shape)
            return np.concatenate([v, self.acceleration(q, v)]).ravel()
        rates = []
        now = 0.0
        shape = (2, *q.shape)
        for t in times:
            solver = DOP853(slope, now, np.concatenate([q, v]).ravel(), t,
                            rtol=tolerance, atol=tolerance, max_step=longest)
            while solver.status == 'running':
                solver.step()
            if solver.status != 'finished':
                raise ArithmeticError(f'the reference stops at {solver.t} s')
            q, v = self.projected(*solver.y.reshape(shape))
            now = t
            rates.append((q, v))
        return tuple(np.array(x) for x in zip(*rates))

    def growth(self, q, v, times):
        """
        Return how much larger a small perturbation of q and v may be at each time, (K,).

        The norm of the linear map from errors of all coordinates and rates, which are
        projected onto the constraints, to the largest error of a coordinate. A single
        direction may have little of the one that grows most.
        """
        n = len(q)
        paths = [(q, v)] + [self.projected(q + d[:n], v + d[n:])
                            for d in PERTURBED * np.eye(2 * n)]
        path = self.motion(*(np.stack(rows) for rows in zip(*paths)), times)[0]
        return np.abs(path[:, 1:] - path[:, :1]).sum(axis=1).max(axis=1) / PERTURBED
