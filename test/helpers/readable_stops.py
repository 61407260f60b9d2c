"""Steps with joints held at stops, in NumPy: one system for motion and forces."""

from kane_dynamics.mechanics.ball_joints import coordinate_rates, on_unit_quaternions
from kane_dynamics.mechanics.integrators.interface import StageRates
from kane_dynamics.mechanics.integrators.rosenbrock import ImplicitStep
from kane_dynamics.mechanics.integrators.runge_kutta import runge_kutta_4
import numpy as np


class HeldMotion:
    """A robot with constant torques and some joints that are held."""

    def __init__(self, robot, tau, side):
        """Store them; `side` is by coordinate."""
        self.robot = robot
        self.tau = tau
        self.side = side
        self.rows = [robot.model.places.index(k) for k in np.flatnonzero(side)]
        self.method = ImplicitStep(robot.equations)
        self.stages = []

    def motion(self, q, u, t):
        """Return T, and rates and accelerations of the joints at udot = 0."""
        robot = self.robot
        if robot.equations.in_joint_rates:
            return np.eye(robot.n), u, np.zeros(robot.n)
        coefficients = robot.equations.joint_motion(q, u, np.zeros(robot.n), t)
        return [np.array(x, dtype=float)
                for x in (coefficients.T, coefficients.qdot, coefficients.qddot)]

    def solution(self, q, u, t, more=0.0, force=0.0):
        """Return udot and what holds; `more` is added to M, `force` to the torque."""
        robot = self.robot
        T, _, drift = self.motion(q, u, t)
        at = {'t': t} if robot.equations.timed else {}
        at_rest = np.zeros(robot.n)
        net = self.tau - robot.inverse_dynamics(q, u, at_rest, **at) + force
        held = T[self.rows]
        n = robot.n
        K = np.block([[robot.mass_matrix(q, **at) + more, -held.T],
                      [held, np.zeros((len(held), len(held)))]])
        unknowns = np.linalg.solve(K, np.concatenate([net, -drift[self.rows]]))
        f, a = np.zeros((2, robot.n_q))
        f[self.side != 0.0] = unknowns[n:]
        places = [p is not None for p in robot.model.places]
        a[[p for p in robot.model.places
           if p is not None]] = (T @ unknowns[:n] + drift)[places]
        self.stages.append((f, a, held.T @ unknowns[n:]))
        return unknowns[:n]

    def rates(self, x, t):
        """Return the rates of q and u."""
        q, u = np.split(x, [self.robot.n_q])
        v = self.motion(q, u, t)[1]
        return np.concatenate(
            [coordinate_rates(self.robot.model, q, v), self.solution(q, u, t)])

    def implicit(self, x, t, h):
        """Return q and u after a linearly implicit step."""
        method = self.method

        def stage(q, u, tau, first, g, moment, deflections):
            now = t + 0.5 * moment * h
            T, v, _ = self.motion(q, u, now)
            D = np.diag(method.resistance(v).astype(float))
            K = method._K
            C = method._C
            turned = T @ first.udot
            force = 2.0 * g * ((D + C) @ turned + K @ first.joints)
            force = force - g * K @ (v - 2.0 * g * turned)
            w = self.solution(q, u, now, T.T @ (g * (D + C) + g * g * K) @ T,
                              T.T @ force)
            rates = v + g * method._sprung * (T @ w - 2.0 * turned)
            return StageRates(rates, w)
        q, u = np.split(x, [self.robot.n_q])
        q, u, _ = method.step(stage, q, u, lambda *_: self.tau, h, np.zeros(0))
        return np.concatenate([q, u])

    def corrected(self, q, u, t, stop):
        """Return q and u without the rest of the motion of the held joints."""
        robot = self.robot
        where = np.flatnonzero(self.side)
        if robot.equations.in_joint_rates:
            return q, u
        at = {'t': t} if robot.equations.timed else {}
        for _ in range(3):
            T, _, _ = self.motion(q, u, t)
            along = np.linalg.solve(robot.mass_matrix(q, **at), T[self.rows].T)
            p = np.linalg.solve(T[self.rows] @ along, q[where] - stop[where])
            q = self.closed(q - coordinate_rates(robot.model, q, T @ (along @ p)), t)
        T, v, _ = self.motion(q, u, t)
        along = np.linalg.solve(robot.mass_matrix(q, **at), T[self.rows].T)
        return q, u - along @ np.linalg.solve(T[self.rows] @ along, v[self.rows])

    def closed(self, q, t):
        """Return q after a Newton step on the loops, with unit quaternions."""
        if not self.robot.equations.in_joint_rates:
            q = np.array(self.robot.equations.closure_step(q, t), dtype=float)
        return on_unit_quaternions(self.robot.model, q)


def pressed_step(robot, tau, side, integrator, q, u, t, h):
    """Return q and u after a step with held torques and joints at stops."""
    motion = HeldMotion(robot, tau, side)
    x = np.concatenate([q, u])
    if integrator == 'implicit':
        x = motion.implicit(x, t, h)
    else:
        x = runge_kutta_4(motion.rates, x, (t, t + 0.5 * h, t + h), h)
    q_end, u_end = np.split(x, [robot.n_q])
    q_end = motion.closed(q_end, t + h)
    stop = np.where(side > 0.0, robot.limits.upper, robot.limits.lower)
    return motion.corrected(q_end, u_end, t + h, stop)
