"""
Model compensation of a reference motion that leaves the feedback passive.

    tau = M udot_r + C(q, u) u_r + gravity + springs + friction(u_r)

with the Coriolis matrix C of dM/dt = C + C^T. For s = u - u_r the arm then obeys M s' +
C s = feedback, and the rate of s^T M s / 2 is the power of the feedback alone. At rest,
u_r = 0, it is gravity compensation. Compensation of all of C u instead would add the
power u^T dM/dt u / 2. Source: B. Paden, R. Panja, "Globally asymptotically stable 'PD+'
controller for robot manipulators", Int. J. Control 47(6), 1988.

Friction is that of the reference motion, as in computed torque: compensation at measured
rates would accelerate an arm at rest. At rest and at reversals of the reference motion it
is that of the robot's choice, `feedforward_friction`; while the target rests it is zero.
"""

from kane_dynamics._util.typing import Scalar, Vector
from kane_dynamics.control.terms import Terms
from kane_dynamics.mechanics.equations import Equations
import numpy as np

WEIGHTS = ('inertia', 'coriolis', 'gravity', 'friction')  # of `compensation_weights`


def compensation_weights(terms: Terms) -> list[float]:
    """Return the weights of the terms of `reference_dynamics`, 0 or 1, (4,)."""
    return [float(getattr(terms, name)) for name in WEIGHTS]


def reference_dynamics(equations: Equations, q: Vector, u: Vector, u_r: Vector,
                       udot_r: Vector, weights: Vector, parameters: Vector,
                       t: Scalar) -> Vector:
    """
    Return the force of the compensation, dual to u, (n,), over any scalar.

    Parameters
    ----------
    equations : Equations
        Of the robot.
    q, u : (n_q,), (n,) arrays
        The measured state.
    u_r, udot_r : (n,) arrays
        The reference motion.
    weights : (4,) array
        Of the terms `WEIGHTS`, 0 or 1.
    parameters, t
        Of the robot; time, s.

    """
    inertia, coriolis, gravity, friction = weights
    tree = equations.tree
    motion = equations.joint_motion(q, u, equations.zeros, t)
    difference = u_r - u
    qdot_r = motion.qdot + motion.T @ difference
    # q'' = T u' + T' u + X': the terms of the speeds count as Coriolis terms.
    drift = motion.qddot + motion.T_rate @ difference
    qddot = inertia * (motion.T @ udot_r) + coriolis * drift

    # Weights of the terms scale what causes them: gravity, rates, accelerations.
    weighted = np.concatenate([gravity * parameters[:3], parameters[3:]])
    rigid = tree.reference_dynamics(q, coriolis * motion.qdot, coriolis * qdot_r, qddot,
                                    weighted)
    load = motion.projected(rigid)
    resisting = reference_friction(equations, q, qdot_r, drift + motion.T @ udot_r,
                                   load, t)
    return motion.projected(rigid + friction * resisting)


def resisting_force(equations: Equations, q: Vector, u: Vector, weights: Vector,
                    parameters: Vector, t: Scalar) -> Vector:
    """
    Return the bias force of the terms `WEIGHTS`, dual to u, (n,), over any scalar.

    Its friction resists the motion; it is not that which commands compensate. Arguments
    as of `reference_dynamics`.
    """
    _, coriolis, gravity, friction = weights
    motion = equations.joint_motion(q, u, equations.zeros, t)
    weighted = np.concatenate([gravity * parameters[:3], parameters[3:]])
    rigid = equations.tree.rigid_dynamics(q, coriolis * motion.qdot,
                                          coriolis * motion.qddot, None, weighted)
    load = motion.projected(rigid)
    resisting = rated_friction(equations, q, motion.qdot, load, t)
    return motion.projected(rigid + friction * resisting)


def rated_friction(equations: Equations, q: Vector, rates: Vector, load: Vector,
                   t: Scalar) -> Vector:
    """Return the friction of the joints, (n_j,), at rates, under a force of the drives."""
    return equations.tree.friction_force(rates, _loads(equations, q, load, t))


def reference_friction(equations: Equations, q: Vector, rates: Vector,
                       accelerations: Vector, load: Vector, t: Scalar) -> Vector:
    """
    Return the friction of the joints that commands compensate, (n_j,).

    It is that of a reference motion, under a force of the drives; at rest and at
    reversals by the robot's choice, `feedforward_friction`.
    """
    return equations.tree.feedforward_friction(rates, accelerations,
                                               _loads(equations, q, load, t))


def _loads(equations: Equations, q: Vector, load: Vector, t: Scalar) -> Vector | None:
    """Return the torques of the drives, (n_j,), or None if no friction depends on them."""
    if not equations.carries_loads:
        return None
    return equations.drive_torques(q, load, t)
