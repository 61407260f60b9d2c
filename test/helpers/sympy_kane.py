"""SymPy's KanesMethod on a Model: frames, points and velocities of mechanics."""

from kane_dynamics.mechanics.constraints.independent_speeds import choose_independent
from kane_dynamics.mechanics.equations import Equations
from kane_dynamics.mechanics.recursive.tree_equations import TreeEquations
from kane_dynamics.model.model import WORLD
import numpy as np
import sympy as sp
import sympy.physics.mechanics as me


class Ours:
    """Our equations of a mechanism: the one place that says how tests ask for them."""

    def __init__(self, model, constraints=(), independent=None, speeds=None):
        self.model = model
        self.mechanism = choose_independent(model, speeds, constraints, independent)
        self.equations = Equations(TreeEquations(model), self.mechanism)

    def mass_matrix(self, q):
        return np.array(self.equations.mass_matrix(q, self.model.gravity, 0.0),
                        dtype=float)

    def bias_force(self, q, u, t=0.0):
        return np.array(self.equations.bias_force(q, u, self.model.gravity, t),
                        dtype=float)

    def forward_dynamics(self, q, u, tau, t=0.0):
        return self.equations.forward_dynamics(q, u, tau, None, self.model.gravity, t)

    def qdot(self, q, u, t=0.0):
        none = np.zeros(len(u))
        return np.array(self.equations.joint_motion(q, u, none, t).qdot, dtype=float)

    def constraint_forces(self, q, u, t=0.0):
        return np.array(self.equations.constraint_forces(
            q, u, np.zeros(len(u)), None, self.model.gravity, t), dtype=float)


class Peer:
    """
    A model in SymPy's terms.

    Parameters
    ----------
    model : Model
    rates : callable, optional
        Returns q' in terms of the speeds u; q' = u by default.

    """

    def __init__(self, model, rates=lambda u: u):
        n = model.n
        self.model = model
        self.q = me.dynamicsymbols(f'q:{n}')
        self.u = me.dynamicsymbols(f'u:{n}')
        self.rates = rates(self.u)
        self.N = me.ReferenceFrame('N')
        self.O = me.Point('O')  # noqa: E741
        self.O.set_vel(self.N, 0)
        self.frames = []
        self.points = []
        self.bodies = []
        self.loads = []
        for body in model.bodies:
            self._add(body)

    def _add(self, body):
        joint = body.joint
        N = self.N
        F, P = ((N, self.O) if body.parent == WORLD
                else (self.frames[body.parent], self.points[body.parent]))
        q = self.q[joint.coordinate]
        u = self.rates[joint.coordinate]
        if np.array_equal(joint.rotation, np.eye(3)):
            A = F
        else:
            A = F.orientnew(f'A_{body.name}', 'DCM', sp.Matrix(joint.rotation.T))
            A.set_ang_vel(F, 0)
        axis = vector(A, joint.axis)
        B = A
        at = P.locatenew(f'J_{body.name}', vector(F, joint.translation))
        at.v2pt_theory(P, N, F)
        if joint.kind == 'revolute':
            B = A.orientnew(body.name, 'Axis', [q, axis])
            B.set_ang_vel(A, u * axis)
        else:
            on = at
            at = on.locatenew(f'O_{body.name}', q * axis)
            at.set_vel(N, on.vel(N) + F.ang_vel_in(N).cross(q * axis) + u * axis)
        inertial = body.inertial
        com = at.locatenew(f'C_{body.name}', vector(B, inertial.com))
        com.v2pt_theory(at, N, B)
        self.frames.append(B)
        self.points.append(at)
        if inertial.mass:
            i = inertial.inertia
            inertia = me.inertia(B, i[0, 0], i[1, 1], i[2, 2], i[0, 1], i[1, 2], i[0, 2])
            self.bodies.append(
                me.RigidBody(body.name, com, B, inertial.mass, (inertia, com)))
            self.loads.append((com, inertial.mass * vector(N, self.model.gravity)))

    def body(self, name):
        """Return frame and origin of a body."""
        k = [body.name for body in self.model.bodies].index(name)
        return self.frames[k], self.points[k]

    def point(self, body, place):
        """Return a point fixed on a body."""
        B, at = self.body(body)
        point = at.locatenew(f'point on {body}', vector(B, place))
        point.v2pt_theory(at, self.N, B)
        return point

    def derived(self, rows=(), independent=None):
        """
        Return a function of (q, u_independent) that gives SymPy's numbers.

        Parameters
        ----------
        rows : sequence of expressions
            Velocities that vanish.
        independent : sequence of int
            Numbers of the independent speeds; all by default.

        """
        n = len(self.q)
        m = len(rows)
        free = list(range(n)) if independent is None else list(independent)
        bound = [r for r in range(n) if r not in free]
        kd = [q.diff() - rate for q, rate in zip(self.q, self.rates)]
        u_I = [self.u[r] for r in free]
        u_D = [self.u[r] for r in bound]
        method = me.KanesMethod(self.N, self.q, u_I, kd_eqs=kd, u_dependent=u_D or None,
                                velocity_constraints=list(rows) or None)
        method.kanes_equations(self.bodies, self.loads)
        tree = me.KanesMethod(self.N, self.q, self.u, kd_eqs=kd)
        tree.kanes_equations(self.bodies, self.loads)
        J = sp.Matrix(list(rows)).jacobian(self.u) if m else sp.zeros(0, n)
        quantities = [method.mass_matrix, method.forcing, J, tree.mass_matrix,
                      tree.forcing, sp.Matrix(self.rates)]
        function = sp.lambdify([self.q, self.u], quantities, cse=True)

        def at(q, u):
            # Dependent speeds from the rows: u_D = A u_I.
            everything = np.zeros(n)
            everything[free] = u
            J = np.array(function(q, everything)[2], dtype=float).reshape(m, n)
            A = np.zeros((0, n))
            if m:
                A = -np.linalg.solve(J[:, bound], J[:, free])
                everything[bound] = A @ u
            M, f, _, M_tree, f_tree, qdot = (
                np.array(x, dtype=float) for x in function(q, everything))
            f = f[:, 0]
            f_tree = f_tree[:, 0]
            # SymPy's rows: p dynamical equations, then m rates of constraints.
            p = n - m
            drift = np.linalg.solve(M[p:, p:], f[p:]) if m else np.zeros(0)
            udot = np.linalg.solve(M, f)
            all_udot = np.empty(n)
            all_udot[free] = udot[:p]
            all_udot[bound] = udot[p:]
            # What the tree lacks is the force of the rows: J^T lambda.
            force = np.linalg.lstsq(J.T, M_tree @ all_udot - f_tree, rcond=None)[0]
            return {'mass_matrix': M[:p, :p] + M[:p, p:] @ A,
                    'bias': M[:p, p:] @ drift - f[:p], 'udot': udot[:p],
                    'qdot': qdot[:, 0], 'forces': force}
        return at


def vector(frame, components):
    """Return a vector with components in a frame's axes."""
    return sum((float(x) * axis for x, axis in zip(components, frame) if x),
               me.Vector(0))


def agree(ours, peer, states, tolerance=1e-9, forces=None):
    """Check mass matrix, bias, u', q' and constraint forces at states (q, u)."""
    for q, u in states:
        theirs = peer(q, u)
        udot = ours.forward_dynamics(q, u, np.zeros(len(u)))
        pairs = [(ours.mass_matrix(q), theirs['mass_matrix']),
                 (ours.bias_force(q, u), theirs['bias']), (udot, theirs['udot']),
                 (ours.qdot(q, u), theirs['qdot'])]
        if forces is not None:
            pairs.append((ours.constraint_forces(q, u)[list(forces)], theirs['forces']))
        for got, expected in pairs:
            np.testing.assert_allclose(np.array(got, dtype=float), expected,
                                       rtol=tolerance,
                                       atol=tolerance * max(1.0, np.abs(expected).max()))
