"""
The equations of motion of a mechanism, over any scalar.

`TreeEquations` computes the joint forces f(q, q', q'') of the tree alone (RNEA). The
mechanism gives the joint motion for independent speeds u, q' = T u + X. Kane's method
projects the joint forces on these speeds:

    tau = T^T f,    M = T^T M_q T,    constraint forces = N^T (f - joint torques)

T^T f is F~_r + F~_r* with the sign changed: forces without work in an admissible motion
cancel.

A tree in joint rates is the mechanism with T = 1 and no rows. `JointMotion` skips the
products with T there, so that its traced programs are those of the tree alone.
"""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from copy import copy
from typing import Any

from kane_dynamics._util.typing import Matrix, Scalar, Vector
from kane_dynamics.errors import ConstraintError, InputError
from kane_dynamics.mechanics.algebra.jet import moving, rates
from kane_dynamics.mechanics.algebra.ltdl import factorize, Factors, inverse, solve
from kane_dynamics.mechanics.ball_joints import coordinate_rates
from kane_dynamics.mechanics.constraints import ConstraintRows
from kane_dynamics.mechanics.constraints.conditioning import guarded, LIMITS, margin
from kane_dynamics.mechanics.constraints.mechanism import (JointMotion, Mechanism,
                                                           MechanismState,
                                                           ReleasedJointState)
from kane_dynamics.mechanics.constraints.redundant_forces import shared_forces
from kane_dynamics.mechanics.constraints.transmission import (least_torques,
                                                              transmission_margin,
                                                              undetermined)
from kane_dynamics.mechanics.friction import carries_load
from kane_dynamics.mechanics.recursive.tree_equations import TreeEquations
from kane_dynamics.model.model import Frame
import numpy as np

# Least pivot of a mobility, over 6, relative to its diagonal entry: below it, directions
# are nearly dependent, and their condition number decides.
DEPENDENT = 1e-8


class Equations:
    """
    The equations of motion of a mechanism.

    Parameters
    ----------
    tree : TreeEquations
        The recursions in joint space: of the same model, in joint rates, without
        constraints.
    mechanism : Mechanism
    actuated : sequence of str or mapping of str to float, optional
        Names of the joints that have actuators; the torques have minimum norm, or with a
        mapping the least sum of weight times torque squared. By default tau acts as the
        forces dual to the independent speeds.

    Attributes
    ----------
    in_joint_rates : bool
        Whether the mechanism is a tree in joint rates: u = q', no constraints, no ball
        joints.
    timed : bool
        Whether a result may depend on the time.
    watched : bool
        Whether a state may be singular or open: there are constraint rows. The
        parameters of the kernels then end with its limits, see `margin`.
    limits : int
        Number of limits of a state at the end of the parameters.
    unsupported : tuple of str
        Names of the methods that do not support beams.
    zeros : (n,) array
        Zeros, read-only.

    Raises
    ------
    ConstraintError
        No such joint, fewer actuators than independent speeds, or a weight that is not
        positive.

    Notes
    -----
    Methods take q (n_q,), the independent speeds u (n,), and the time t, s. Callers may
    always pass the time; only equations that are `timed` use it.

    """

    def __init__(self, tree: TreeEquations, mechanism: Mechanism,
                 actuated: Sequence[str] | Mapping[str, float] | None = None) -> None:
        """Check the actuated joints and store the parts."""
        self.tree = tree
        self.mechanism = mechanism
        self.model = tree.model
        self.n = mechanism.n
        self.n_q = tree.n_q
        self.speed_names = mechanism.speed_names
        self.wrench_frames = tree.wrench_frames
        self.payload_frame = tree.payload_frame
        self.friction = tree.friction
        self.in_joint_rates = mechanism.in_joint_rates
        self.timed = mechanism.key is None  # only user-defined functions depend on time
        self.watched = bool(mechanism.labels)
        self.limits = LIMITS if self.watched else 0
        self.unsupported = tree.unsupported
        # Zeros of an array of objects add no operation to a traced program.
        self.zeros = np.zeros(self.n).astype(object)
        self.zeros.setflags(write=False)
        self.carries_loads = tree.carries_loads
        self.actuated: list[int] | None = None
        self._inverse_weights: Vector = None  # of the actuated joints
        if actuated is not None:
            self.actuated = self._actuated_coordinates(actuated)
            # By default all torques have the same weight: minimum norm.
            if isinstance(actuated, Mapping):
                names = [self.model.joint_names[k] for k in self.actuated]
                weights = np.array([actuated[name] for name in names])
            else:
                weights = np.ones(len(self.actuated))
            self._inverse_weights = 1.0 / weights
        if self.carries_loads and self.watched:
            self._require_drives()

    def _require_drives(self) -> None:
        """Raise ConstraintError unless the motors' torques determine the loads of drives."""
        # The load of a drive is its motor's torque less its friction, so that every such
        # joint needs a motor of known torque.
        drives = self.actuated or []
        names = [self.model.joint_names[k] for k in drives]
        for joint in self.model.coordinate_joints:
            if carries_load(joint) and joint.name not in names:
                raise ConstraintError(f"joint '{joint.name}': load friction in a mechanism "
                                      'with constraints; expected it among the joints '
                                      'that have motors, by actuated=')
        if len(drives) > self.n:
            raise ConstraintError(f'load friction: {len(drives)} motors for {self.n} '
                                  'independent speeds; expected as many motors, since '
                                  'redundant ones may share the load in any way')

    def _actuated_coordinates(
            self, joints: Sequence[str] | Mapping[str, float]) -> list[int]:
        """Return the indices of the actuated coordinates, or raise ConstraintError."""
        names = self.model.joint_names
        # Known joints with positive weights.
        for joint in joints:
            if joint not in names:
                raise ConstraintError(f"actuated: '{joint}'; expected one of "
                                      f'{", ".join(names)}')
            weight = joints[joint] if isinstance(joints, Mapping) else 1.0
            if not 0.0 < weight < np.inf:
                raise ConstraintError(f"actuated: weight {weight} of '{joint}'; "
                                      'expected a positive, finite number')
        # Fewer torques than independent speeds leave some of them without actuation.
        places = sorted(set(map(names.index, joints)))
        if len(places) < self.n:
            raise ConstraintError(
                f'actuated: {len(places)} joints; expected at least {self.n}, the '
                f'number of independent speeds ({", ".join(self.speed_names)})')
        return places

    def time_inputs(self, t: Any, states: Any = None) -> tuple[Any, ...]:
        """
        Return the time as the last input of a kernel, or nothing where it has none.

        Callers always pass the time; only kernels of `timed` equations have it as an
        input. A single time stands for all rows of `states`, (N, ...) arrays. The time may
        also be a name or an `Argument`, without states.
        """
        if not self.timed:
            return ()
        batch: tuple[int, ...] = ()
        with suppress(ValueError):  # rows of several lengths, which the kernel refuses
            batch = np.shape(states)[:-1]
        if batch and np.ndim(t) == 0:
            return (np.full(batch, t),)
        return (t,)

    def require_timeless(self, what: str, reason: str) -> None:
        """Raise InputError if speeds or constraints are functions of time."""
        if self.timed:
            raise InputError(f'{what}: speeds or constraints that are functions of time; '
                             f'expected none, {reason}')

    # Kinematics: the motion of joints and frames for independent speeds.

    def state(self, q: Vector, t: Scalar = 0.0) -> MechanismState:
        """Return the mechanism at a configuration, by the compiled links."""
        return self.mechanism.state(q, t, self.tree.geometry)

    def constraint_rows(self, q: Vector, t: Scalar = 0.0) -> ConstraintRows:
        """Return the rows of all constraints at a configuration."""
        return self.mechanism.rows(self.state(q, t))

    def joint_motion(self, q: Vector, u: Vector, udot: Vector,
                     t: Scalar = 0.0) -> JointMotion:
        """Return rates and accelerations of the joints, with T and N."""
        return self.mechanism.joint_motion(q, u, udot, t, self.tree.geometry)

    def at_rest(self, q: Vector, t: Scalar = 0.0) -> JointMotion:
        """Return the joint motion at u = udot = 0, for callers that only use T and N."""
        return self.joint_motion(q, self.zeros, self.zeros, t)

    def joint_rates(self, q: Vector, u: Vector, t: Scalar = 0.0) -> Vector:
        """Return q', (n_q,)."""
        return coordinate_rates(self.model, q, self.joint_speeds(q, u, t))

    def joint_speeds(self, q: Vector, u: Vector, t: Scalar = 0.0) -> Vector:
        """Return the joint rates, (n_j,): q', and angular velocities of ball joints."""
        return self.joint_motion(q, u, self.zeros, t).qdot

    def joint_accelerations(self, q: Vector, u: Vector, udot: Vector,
                            t: Scalar = 0.0) -> Vector:
        """Return the rates of `joint_speeds`, (n_j,): q'', angular accelerations."""
        return self.joint_motion(q, u, udot, t).qddot

    def frame_pose(self, frame: Frame, q: Vector, t: Scalar = 0.0) -> Matrix:
        """Return the homogeneous transformation frame to world, (4, 4)."""
        return self.tree.frame_pose(frame, q)

    def frame_velocity(self, frame: Frame, q: Vector, u: Vector,
                       t: Scalar = 0.0) -> Vector:
        """Return linear then angular velocity, (6,)."""
        return self.tree.frame_velocity(frame, q, self.joint_speeds(q, u, t))

    def frame_acceleration(self, frame: Frame, q: Vector, u: Vector, udot: Vector,
                           t: Scalar = 0.0) -> Vector:
        """Return linear then angular acceleration, (6,)."""
        motion = self.joint_motion(q, u, udot, t)
        return self.tree.frame_acceleration(frame, q, motion.qdot, motion.qddot)

    def partial_velocities(self, frame: Frame, q: Vector, t: Scalar = 0.0) -> Matrix:
        """Return the Jacobian (partial velocities) in the independent speeds, (6, n)."""
        # v = J q', q' = T u + X: the partial velocities of u are the columns of J T.
        J = self.tree.partial_velocities(frame, q)
        return self.at_rest(q, t).by_speeds(J)

    def partial_velocity_rates(self, frame: Frame, q: Vector, u: Vector,
                               t: Scalar = 0.0) -> Matrix:
        """Return the rate of the partial velocities along the motion, (6, n)."""
        motion = self.joint_motion(q, u, self.zeros, t)
        J_rate = self.tree.partial_velocity_rates(frame, q, motion.qdot)
        if motion.unit:
            return J_rate
        # (J T)' = J' T + J T'
        J_rate = J_rate @ motion.T
        return J_rate + self.tree.partial_velocities(frame, q) @ motion.T_rate

    def operational_space_inertia(self, frame: Frame, q: Vector, parameters: Vector,
                                  t: Scalar = 0.0) -> Matrix:
        """Return (J M^-1 J^T)^-1 in all six directions, (6, 6); NaN near singularity."""
        J = self.partial_velocities(frame, q, t)
        mobility = J @ self.inverse_mass_matrix(q, parameters, t) @ J.T
        order = range(6)
        try:
            return inverse(factorize(mobility, order, order, DEPENDENT), order)
        except ZeroDivisionError:  # a direction in which the frame never moves
            return np.full((6, 6), np.nan)

    # Constraints: residuals, and the correction that keeps loops closed.

    def constraint_residual(self, q: Vector, t: Scalar = 0.0) -> Vector:
        """Return the residual of every row, (m,), m or rad; 0 if it is of velocities."""
        return self.constraint_rows(q, t).residual_or_zero

    def closure_rows(self, q: Vector, t: Scalar = 0.0) -> Matrix:
        """Return J, residuals and 1 where a row has one, as columns, (m, n_j + 2)."""
        rows = self.constraint_rows(q, t)
        residual = rows.residual_or_zero
        of_positions = np.array([float(x is not None) for x in rows.residual])
        return np.concatenate([rows.J, residual[:, None], of_positions[:, None]], axis=1)

    def constraint_velocity_residual(self, q: Vector, u: Vector,
                                     t: Scalar = 0.0) -> Vector:
        """Return the velocity residual J q' - b of every row, (m,)."""
        rows = self.constraint_rows(q, t)
        return rows.J @ self.joint_speeds(q, u, t) - rows.b

    def keeps_positions(self, q: Vector, t: Scalar = 0.0) -> bool:
        """Return whether a constraint is one of positions, such as a closed loop."""
        if not self.mechanism.labels:
            return False
        residual = self.constraint_rows(q, t).residual
        return any(x is not None for x in residual)

    def closure_step(self, q: Vector, t: Scalar = 0.0) -> Vector:
        """
        Return q after one Newton step on the constraint residuals of positions, (n_q,).

        The step is in the span of N, so that it does not change the independent speeds.
        It changes the lengths of quaternions, to second order.
        """
        # J N = 1 and Y_I N = 0: J dq = -residual with dq = -N residual, and u_I stays.
        residual = self.constraint_rows(q, t).residual_or_zero
        step = -(self.at_rest(q, t).N @ residual[self.mechanism.kept])
        return q + coordinate_rates(self.model, q, step)

    def margin(self, q: Vector, t: Scalar, limits: Vector) -> Scalar:
        """Return the margin of a state, positive if accepted; see `conditioning`."""
        return margin(self.mechanism, q, t, limits, self.tree.geometry)

    # Dynamics: joint forces of the tree, projected on the independent speeds.

    def _joint_forces(self, q: Vector, motion: JointMotion, wrench: Any,
                      parameters: Vector, t: Scalar) -> Vector:
        """Return the joint forces f of the tree for a motion, (n_j,)."""
        if not self.tree.carries_loads:
            return self.tree.inverse_dynamics(q, motion.qdot, motion.qddot, wrench,
                                              parameters)
        # The loads of the drives have the generalized force of the motion.
        rigid = self.tree.rigid_dynamics(q, motion.qdot, motion.qddot, wrench, parameters)
        loads = self.drive_torques(q, motion.projected(rigid), t)
        return rigid + self.tree.friction_force(motion.qdot, loads)

    def driven_friction(self, q: Vector, rates: Vector, tau: Vector, t: Scalar = 0.0,
                        directions: Vector | None = None,
                        deflections: Vector | None = None) -> Vector:
        """
        Return the friction of the joints, (n_j,), while motors have torques.

        Parameters
        ----------
        q : (n_q,) array
            rad or m.
        rates : (n_j,) array
            Of the joints.
        tau : (n,) array
            Generalized force of the motors.
        t : scalar
            s.
        directions, deflections : (n_j,), (n_b,) arrays, optional
            As of `TreeEquations.friction_force`.

        """
        if not self.tree.carries_loads:
            # Without load friction, the rates alone determine it.
            return self.tree.friction_force(rates, None, directions, deflections)
        torques = self.drive_torques(q, tau, t)
        loads = self.tree.drive_loads(rates, torques, None, directions, deflections)
        # tau = L + friction. With bristles, the friction under given loads is the sum of
        # its parts.
        if deflections is None:
            return torques - loads
        return self.tree.friction_force(rates, loads, directions, deflections)

    def deflection_rates(self, q: Vector, rates: Vector, deflections: Vector, tau: Vector,
                         t: Scalar = 0.0) -> Vector:
        """
        Return the rates of the deflections of bristles, (n_b,), while motors have torques.

        Arguments as of `driven_friction`.
        """
        loads = self._loads_of_bristles(q, rates, deflections, tau, t)
        return self.tree.deflection_rates(rates, deflections, loads)

    def deflections_after(self, q: Vector, rates: Vector, deflections: Vector, tau: Vector,
                          travel: Vector, t: Scalar = 0.0) -> Vector:
        """
        Return the deflections of bristles, (n_b,), after a travel of the joints, (n_j,).

        Other arguments as of `driven_friction`.
        """
        loads = self._loads_of_bristles(q, rates, deflections, tau, t)
        return self.tree.deflections_after(rates, deflections, loads, travel)

    def _loads_of_bristles(self, q: Vector, rates: Vector, deflections: Vector, tau: Vector,
                           t: Scalar) -> Vector | None:
        """Return the loads of the drives, (n_j,); None for friction without load."""
        if not self.tree.carries_loads:
            return None
        torques = self.drive_torques(q, tau, t)
        return self.tree.drive_loads(rates, torques, None, None, deflections)

    def load_friction(self, q: Vector, u: Vector, tau: Vector,
                      t: Scalar = 0.0) -> Vector:
        """Return the friction of motors with torques tau beyond `friction_force`, (n,)."""
        if not self.tree.carries_loads:
            return self.zeros
        motion = self.joint_motion(q, u, self.zeros, t)
        friction = self.driven_friction(q, motion.qdot, tau, t)
        return motion.projected(friction - self.tree.friction_force(motion.qdot))

    def drive_torques(self, q: Vector, tau: Vector, t: Scalar = 0.0) -> Vector:
        """Return the torques of the drives, (n_j,), of a generalized force, (n,)."""
        if self.mechanism.in_joint_speeds:
            return tau
        return self.shared_torques(q, tau, t)

    def inverse_dynamics(self, q: Vector, u: Vector, udot: Vector, wrench: Any,
                         parameters: Vector, t: Scalar = 0.0) -> Vector:
        """Return tau = M udot + bias - external, (n,), dual to u."""
        motion = self.joint_motion(q, u, udot, t)
        return motion.projected(self._joint_forces(q, motion, wrench, parameters, t))

    def rigid_dynamics(self, q: Vector, u: Vector, udot: Vector, wrench: Any,
                       parameters: Vector, t: Scalar = 0.0) -> Vector:
        """Return inverse dynamics without friction, (n,)."""
        motion = self.joint_motion(q, u, udot, t)
        force = self.tree.rigid_dynamics(q, motion.qdot, motion.qddot, wrench,
                                         parameters)
        return motion.projected(force)

    def bias_force(self, q: Vector, u: Vector, parameters: Vector,
                   t: Scalar = 0.0) -> Vector:
        """Return the bias force h(q, u), (n,): tau at udot = 0, no external wrenches."""
        return self.inverse_dynamics(q, u, self.zeros, None, parameters, t)

    def gravity_force(self, q: Vector, parameters: Vector, t: Scalar = 0.0) -> Vector:
        """Return the tau that balances gravity alone, (n,)."""
        return self.at_rest(q, t).projected(self.tree.gravity_force(q, parameters))

    def friction_force(self, u: Vector, q: Vector | None = None,
                       t: Scalar = 0.0) -> Vector:
        """Return the friction of all joints, (n,), dual to u; joint rates need no q."""
        motion = self.joint_motion(q, u, self.zeros, t)
        return motion.projected(self.tree.friction_force(motion.qdot))

    def feedforward_change(self, q: Vector, u: Vector, udot: Vector, parameters: Vector,
                           t: Scalar = 0.0) -> Vector:
        """
        Return the torques by which commands of a motion exceed inverse dynamics, (n,).

        It is the difference of friction at rest and at reversals, by the choice
        `feedforward_friction`.
        """
        motion = self.joint_motion(q, u, udot, t)
        loads = None
        if self.carries_loads:
            rigid = self.tree.rigid_dynamics(q, motion.qdot, motion.qddot, None, parameters)
            loads = self.drive_torques(q, motion.projected(rigid), t)
        commanded = self.tree.feedforward_friction(motion.qdot, motion.qddot, loads)
        return motion.projected(commanded - self.tree.friction_force(motion.qdot, loads))

    def external_force(self, q: Vector, wrench: Any, t: Scalar = 0.0) -> Vector:
        """Return the generalized force, (n,), of wrenches (k, 6) at declared frames."""
        return self.at_rest(q, t).projected(self.tree.external_force(q, wrench))

    def mass_matrix(self, q: Vector, parameters: Vector, t: Scalar = 0.0) -> Matrix:
        """Return M = T^T M_q T, (n, n)."""
        M = self.tree.mass_matrix(q, parameters)
        return self.at_rest(q, t).congruent(M)

    def inverse_mass_matrix(self, q: Vector, parameters: Vector,
                            t: Scalar = 0.0) -> Matrix:
        """Return M^-1, (n, n)."""
        return inverse(*self.mass_factors(q, parameters, t))

    def mass_factors(self, q: Vector, parameters: Vector,
                     t: Scalar = 0.0) -> tuple[Factors, list[int]]:
        """Return the LTDL factorization of M and the order of its rows, for `solve`."""
        # The tree eliminates from the tips on, which keeps the zeros of M; M of other
        # speeds has few.
        if self.mechanism.in_joint_speeds:
            M = self.tree.mass_matrix(q, parameters)
            return self.tree.factors(M), self.tree.order
        order = list(range(self.n))
        M = self.mass_matrix(q, parameters, t)
        return factorize(M, order, self._watched_pivots), order

    @property
    def _watched_pivots(self) -> range:
        """Return the independent speeds if a joint may move without kinetic energy."""
        count = self.n if self.tree.without_own_inertia else 0
        return range(count)

    def coriolis_matrix(self, q: Vector, u: Vector, parameters: Vector,
                        t: Scalar = 0.0) -> Matrix:
        """
        Return the Coriolis matrix C = T^T (C_q T + M_q dT/dt), (n, n).

        It follows from q' = T u + x and q'' = T u' + T' u + x', of which C u has the
        terms in u; dM/dt = C + C^T, since M = T^T M_q T.
        """
        # C q' of the tree, and what the rate of T adds to the accelerations.
        motion = self.joint_motion(q, u, self.zeros, t)
        C = self.tree.coriolis_matrix(q, motion.qdot, parameters)
        if motion.unit:
            return C
        CT = C @ motion.T
        M_q = self.tree.mass_matrix(q, parameters)
        return motion.T.T @ (CT + M_q @ motion.T_rate)

    def momentum_terms(self, q: Vector, u: Vector, parameters: Vector,
                       t: Scalar = 0.0) -> Matrix:
        """
        Return the generalized momentum p and the force beta that its rate lacks, (2, n).

        tau is that of the motors less `load_friction`.

        With q' = T u + X: p = T^T M_q q', and p' = tau + external - beta,
        beta = T^T (h_q - dM_q/dt q') - (dT/dt)^T M_q q', with the tree's bias force h_q.
        """
        motion = self.joint_motion(q, u, self.zeros, t)
        qdot = motion.qdot
        momentum = self.tree.mass_matrix(q, parameters) @ qdot

        # dM_q/dt = C + C^T
        C = self.tree.coriolis_matrix(q, qdot, parameters)
        if self.carries_loads:
            # Friction without load: `load_friction` is that of the motors' torques.
            tree = self.tree
            bias = tree.rigid_dynamics(q, qdot, tree.zeros, None, parameters)
            bias = bias + tree.friction_force(qdot)
        else:
            bias = self.tree.bias_force(q, qdot, parameters)
        tree_beta = bias - (C @ qdot + qdot @ C)
        beta = motion.projected(tree_beta) - motion.T_rate.T @ momentum
        return np.array([motion.projected(momentum), beta])

    def forward_dynamics(self, q: Vector, u: Vector, tau: Vector, wrench: Any,
                         parameters: Vector, t: Scalar = 0.0) -> Vector:
        """Return udot = M^-1 (tau + external - bias), (n,)."""
        if self.n == self.tree.n:
            _, udot = self._unconstrained(q, u, tau, wrench, parameters, t)
        else:
            _, _, udot = self._projected(q, u, tau, wrench, parameters, t)
        return udot

    def state_rates(self, q: Vector, u: Vector, tau: Vector, wrench: Any,
                    parameters: Vector, t: Scalar = 0.0) -> Vector:
        """Return q' then udot, (n_q + n,): the system that is integrated."""
        # Without constraint rows, the tree's dynamics give q'' without projecting M.
        if self.n == self.tree.n:
            speeds, udot = self._unconstrained(q, u, tau, wrench, parameters, t)
        else:
            motion, _, udot = self._projected(q, u, tau, wrench, parameters, t)
            speeds = motion.qdot
        return np.concatenate([coordinate_rates(self.model, q, speeds), udot])

    def _unconstrained(self, q: Vector, u: Vector, tau: Vector, wrench: Any,
                       parameters: Vector, t: Scalar) -> tuple[Vector, Vector]:
        """
        Return the joints' rates and udot without constraints, by the tree's dynamics.

        Y has an inverse: q' = Y^-1 (u - Z), the joints have the torques Y^T tau, and
        udot = Y q'' + Y' q' + Z'.
        """
        if self.mechanism.in_joint_speeds:
            return u, self.tree.forward_dynamics(q, u, tau, wrench, parameters)

        # Y q' = u - Z
        Y, negative_Z = self.mechanism.system(self.state(q, t))
        if self.mechanism.speeds.definite:
            order = self.tree.order
            qdot = solve(factorize(Y, order), order, u + negative_Z)
        else:
            qdot = self.mechanism.solved(Y, u + negative_Z)
        qddot = self.tree.forward_dynamics(q, qdot, Y.T @ tau, wrench, parameters)

        # Y and Z along the motion, for their time derivatives.
        q_moving = moving(q, coordinate_rates(self.model, q, qdot))
        along_motion = self.state(q_moving, moving(t, 1.0))
        Y_moving, negative_Z_moving = self.mechanism.system(along_motion)
        udot = Y @ qddot + rates(Y_moving) @ qdot - rates(negative_Z_moving)
        return qdot, udot

    def _projected(self, q: Vector, u: Vector, tau: Vector, wrench: Any,
                   parameters: Vector, t: Scalar) -> tuple[JointMotion, Vector, Vector]:
        """Return the motion at udot = 0; joint forces and udot of the actual motion."""
        # M udot = tau - T^T f, with the joint forces f at udot = 0.
        motion = self.joint_motion(q, u, self.zeros, t)
        if self.tree.carries_loads:
            rigid = self.tree.rigid_dynamics(q, motion.qdot, motion.qddot, wrench,
                                             parameters)
            force_at_zero = rigid + self.driven_friction(q, motion.qdot, tau, t)
        else:
            force_at_zero = self._joint_forces(q, motion, wrench, parameters, t)
        M_q = self.tree.mass_matrix(q, parameters)
        order = list(range(self.n))
        factors = factorize(motion.congruent(M_q), order, self._watched_pivots)
        udot = solve(factors, order, tau - motion.projected(force_at_zero))

        # udot adds T udot to q'', and M_q times that to the joint forces.
        force = force_at_zero + M_q @ (motion.T @ udot)
        return motion, force, udot

    def with_constants(self, **constants: Vector) -> 'Equations':
        """Return equations with constants of `TreeEquations.with_constants`."""
        result = copy(self)
        result.tree = self.tree.with_constants(**constants)
        return result

    # Torques of actuators, forces of constraints, loads of joints.

    def joint_torques(self, tau: Vector, q: Vector, t: Scalar = 0.0) -> Vector:
        """Return joint torques, (n_q,), of the force tau; NaN where not actuated."""
        torques = self.shared_torques(q, tau, t)
        if self.actuated is None:
            return torques
        T = self.at_rest(q, t).T
        margin_of_actuation = transmission_margin(self.mechanism, T, self.actuated)
        return guarded(torques, margin_of_actuation)

    def shared_torques(self, q: Vector, tau: Vector, t: Scalar) -> Vector:
        """Return `joint_torques` without a check of the configuration."""
        if self.mechanism.in_joint_speeds:
            return tau
        if self.actuated is None:
            # Y_I T = 1, Y_I N = 0: Y_I^T tau has the generalized force tau, and no
            # constraint forces.
            return self._dual_joint_forces(q, tau, t)

        T = self.at_rest(q, t).T
        torques = np.zeros(self.tree.n).astype(object)
        try:
            torques[self.actuated] = least_torques(T[self.actuated],
                                                   self._inverse_weights, tau)
        except ZeroDivisionError:
            raise undetermined(self.mechanism, self.actuated) from None
        return torques

    def _dual_joint_forces(self, q: Vector, tau: Vector, t: Scalar) -> Vector:
        """Return Y_I^T tau, the joint forces dual to the independent speeds, (n_j,)."""
        Y_I, _ = self.state(q, t).speed_rows(self.speed_names)
        return Y_I.T @ tau

    def generalized_force(self, q: Vector, joint_torques: Vector,
                          t: Scalar = 0.0) -> Vector:
        """Return the generalized force of joint torques (n_q,), (n,)."""
        return self.at_rest(q, t).projected(joint_torques)

    def actual_joint_forces(self, q: Vector, u: Vector, tau: Vector, parameters: Vector,
                            t: Scalar = 0.0) -> Vector:
        """Return the joint forces, (n_q,), of actuators and constraints together."""
        # T = 1: nothing to project. Without rows, the joints have only the forces dual to
        # the speeds.
        if self.mechanism.in_joint_speeds:
            return tau
        if self.n == self.tree.n:
            return self._dual_joint_forces(q, tau, t)
        _, force, _ = self._projected(q, u, tau, None, parameters, t)
        return force

    def constraint_forces(self, q: Vector, u: Vector, tau: Vector, wrench: Any,
                          parameters: Vector, t: Scalar = 0.0) -> Vector:
        """Return the force of every row, (m,); of redundant rows of least norm."""
        motion, force, _ = self._projected(q, u, tau, wrench, parameters, t)
        applied = self.shared_torques(q, tau, t)
        return self._row_forces(q, t, motion.N, force - applied)

    def row_forces_of_motion(self, q: Vector, v: Vector, vdot: Vector, applied: Vector,
                             parameters: Vector, t: Scalar = 0.0) -> Vector:
        """
        Return the force of every row, (m,), in a motion of the joints, v and v', (n_j,).

        `applied`, (n_j,), are the forces of actuators, friction, stops and others on the
        joints.
        """
        rigid = self.tree.rigid_dynamics(q, v, vdot, None, parameters)
        return self._row_forces(q, t, self.at_rest(q, t).N, rigid - applied)

    def _row_forces(self, q: Vector, t: Scalar, N: Matrix,
                    joint_forces: Vector) -> Vector:
        """Return the forces of all rows, (m,), equivalent to these joint forces."""
        J = self.constraint_rows(q, t).J
        kept_forces = N.T @ joint_forces
        return shared_forces(self.mechanism, J, N, kept_forces)

    def joint_reaction(self, body: int, q: Vector, u: Vector, udot: Vector, wrench: Any,
                       parameters: Vector, t: Scalar = 0.0) -> Vector:
        """Return the joint reaction of the body with index `body`, (6,)."""
        return self.joint_reactions(q, u, udot, wrench, parameters, t)[body]

    def joint_reactions(self, q: Vector, u: Vector, udot: Vector, wrench: Any,
                        parameters: Vector, t: Scalar = 0.0) -> Matrix:
        """Return the wrench of parent on child per joint, (n_bodies, 6), world axes."""
        motion = self.joint_motion(q, u, udot, t)
        if not self.mechanism.labels:
            return self.tree.joint_reactions(q, motion.qdot, motion.qddot, wrench,
                                             parameters)
        force = self._joint_forces(q, motion, wrench, parameters, t)
        applied = self.shared_torques(q, motion.projected(force), t)
        row_forces = self._row_forces(q, t, motion.N, force - applied)

        # The constraint forces carry a part of the load that a joint has in the tree:
        # their work on a motion of the released joint alone.
        state = self.state(q, t)
        tree_loads = self.tree.joint_reactions(q, motion.qdot, motion.qddot, wrench,
                                               parameters)
        origins = self.tree.joint_origins(q)
        reactions = []
        for body, (origin, load) in enumerate(zip(origins, tree_loads)):
            rows = self.mechanism.rows(ReleasedJointState(state, body, origin))
            reactions.append(load - rows.J.T @ row_forces)
        return np.array(reactions)

    def torque_terms(self, q: Vector, u: Vector, udot: Vector, parameters: Vector,
                     t: Scalar = 0.0) -> Matrix:
        """Return inverse dynamics by source, (5, n), rows as `TORQUE_TERMS`."""
        if self.mechanism.in_joint_speeds:
            return self.tree.torque_terms(q, u, udot, parameters)
        motion = self.joint_motion(q, u, self.zeros, t)
        terms = self.tree.torque_terms(q, motion.qdot, motion.qddot, parameters)
        inertia_at_zero, coriolis, *others = terms
        if self.carries_loads:
            others[1] = self._loaded_friction(q, motion, udot, parameters, t)

        # The accelerations at udot = 0 are quadratic in the speeds:
        # their inertia is Coriolis.
        M = motion.congruent(self.tree.mass_matrix(q, parameters))
        result = [M @ udot]
        for joint_force in (inertia_at_zero + coriolis, *others):
            result.append(motion.projected(joint_force))
        return np.stack(result)

    def _loaded_friction(self, q: Vector, motion: JointMotion, udot: Vector,
                         parameters: Vector, t: Scalar) -> Vector:
        """Return the friction of the joints, (n_j,), in a motion with accelerations."""
        qddot = motion.qddot + motion.T @ udot
        rigid = self.tree.rigid_dynamics(q, motion.qdot, qddot, None, parameters)
        loads = self.drive_torques(q, motion.projected(rigid), t)
        return self.tree.friction_force(motion.qdot, loads)

    def body_torques(self, q: Vector, u: Vector, udot: Vector, parameters: Vector,
                     t: Scalar = 0.0) -> Matrix:
        """Return the contribution of each body to tau, (n_bodies, n)."""
        motion = self.joint_motion(q, u, udot, t)
        torques = self.tree.body_torques(q, motion.qdot, motion.qddot, parameters)
        return motion.by_speeds(torques)

    def regressor(self, q: Vector, u: Vector, udot: Vector, parameters: Vector,
                  t: Scalar = 0.0) -> Matrix:
        """Return the regressor Y, (n, 10 n_bodies): rigid bodies need tau = Y theta."""
        motion = self.joint_motion(q, u, udot, t)
        regressor = self.tree.regressor(q, motion.qdot, motion.qddot, parameters)
        return motion.projected(regressor)

    # Energies and center of mass.

    def kinetic_energy(self, q: Vector, u: Vector, parameters: Vector,
                       t: Scalar = 0.0) -> Scalar:
        """Return the kinetic energy, J."""
        return self.tree.kinetic_energy(q, self.joint_speeds(q, u, t), parameters)

    def potential_energy(self, q: Vector, parameters: Vector, t: Scalar = 0.0) -> Scalar:
        """Return the potential energy of gravity and springs, J."""
        return self.tree.potential_energy(q, parameters)

    def center_of_mass(self, q: Vector, parameters: Vector, t: Scalar = 0.0) -> Vector:
        """Return the center of mass of the moving bodies and the payload, (3,), m."""
        return self.tree.center_of_mass(q, parameters)

    def center_of_mass_jacobian(self, q: Vector, parameters: Vector,
                                t: Scalar = 0.0) -> Matrix:
        """Return the center of mass's velocity per unit of independent speed, (3, n)."""
        J = self.tree.center_of_mass_jacobian(q, parameters)
        return self.at_rest(q, t).by_speeds(J)

    def centroidal_momentum(self, q: Vector, u: Vector, parameters: Vector,
                            t: Scalar = 0.0) -> Vector:
        """Return linear and angular momentum about the center of mass, (6,)."""
        # The momentum of a motion is the impulse, at rest, that changes speeds by its own.
        return self.tree.centroidal_momentum_rate(q, self.tree.zeros,
                                                  self.joint_speeds(q, u, t), parameters)

    def centroidal_momentum_matrix(self, q: Vector, parameters: Vector,
                                   t: Scalar = 0.0) -> Matrix:
        """Return the centroidal momentum per unit of independent speed, (6, n)."""
        A = self.tree.centroidal_momentum_matrix(q, parameters)
        return self.at_rest(q, t).by_speeds(A)

    def centroidal_momentum_rate(self, q: Vector, u: Vector, udot: Vector,
                                 parameters: Vector, t: Scalar = 0.0) -> Vector:
        """Return the time derivative of the centroidal momentum, (6,)."""
        motion = self.joint_motion(q, u, udot, t)
        return self.tree.centroidal_momentum_rate(q, motion.qdot, motion.qddot, parameters)
