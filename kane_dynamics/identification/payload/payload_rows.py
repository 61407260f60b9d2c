"""
The rows of a payload's estimate: one for each actuator, linear in the payload's parameters.

Inverse dynamics is linear in the ten parameters of a payload, so its derivative by them
is the regressor of the payload, for every kind of mechanism: generalized forces F_r of
the independent speeds. Torques are measured at actuators. With `Robot(actuated=)` these
are joints: with q' = T u + X and the rows a of the actuated joints, the generalized
force is T_a^T times their torques, and the rows are those of T_a^-T. With more actuated
joints than speeds, which may work against each other, they are the torques of least norm
with that force, by the pseudoinverse, and the estimate combines them to as many rows as
speeds. Without `actuated` each independent speed has its own actuator.

Friction with presliding counts as the smooth law, which is uncertain at rest.
"""

from typing import Any, NamedTuple

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.equations import Equations
from kane_dynamics.mechanics.friction import (coulomb, coulomb_levels, load_fractions,
                                              stribeck_excess)
from kane_dynamics.mechanics.recursive.regressor import pseudo_inertia_of
from kane_dynamics.model.model import Joint, Model, WORLD
from kane_dynamics.native.runtime.kernel import Kernel
from kane_dynamics.robot.derivative_kernels import Derivative
from kane_dynamics.robot.robot import Robot
import numpy as np
from numpy.typing import ArrayLike


class ActuatorRows(NamedTuple):
    """
    Equations of one or N samples: left = Y x + error, one row for each actuator.

    Attributes
    ----------
    Y : (m, 10) or (N, m, 10) array
        Torque of the actuators per parameter of the payload.
    rates : (m,) or (N, m) array
        Rates of the actuators, rad/s or m/s.
    left : (m,) or (N, m) array
        Measured torque minus that of the robot alone, N m or N.
    held : (m,) or (N, m) array
        Torque that friction may hold at these rates beyond the smoothed friction, N m or
        N.
    acting : (m, n) or (N, m, n) array or None
        Rates of the actuators per unit of each speed, if there are more actuators than
        speeds.

    """

    Y: Array
    rates: Array
    left: Array
    held: Array
    acting: Array | None = None


class PayloadRegressor:
    """
    The torque of a payload as a linear function of its ten parameters.

    Parameters
    ----------
    model : Model or Robot
        Without the payload; its friction counts as known. A robot has its own speeds and
        constraints; its payload is left out.
    frame : str
        In whose axes the payload is described, about whose origin.

    Raises
    ------
    InputError
        There is no such frame, or no joint moves it.

    """

    def __init__(self, model: Model | Robot, frame: str) -> None:
        """Prepare a robot with a payload at the frame."""
        bare = model if isinstance(model, Robot) else Robot(model)
        if bare.model.frame(frame).body == WORLD:
            raise InputError(f"frame '{frame}': fixed in the world; expected a frame "
                             'that joints move')
        options = {**bare.options, 'payload_frame': frame, 'wrench_frames': ()}
        self.robot = Robot(bare.model, **options)
        self.robot.parameters.gravity = bare.parameters.gravity

        # Kernels take second moments where parameters are moments of inertia: the linear
        # map from one to the other, column by column.
        columns = []
        for unit in np.eye(10):
            columns.append(_second_moments(pseudo_inertia_of(unit)))
        self._moments = np.column_stack(columns)

    def __call__(self, q: ArrayLike, u: ArrayLike, udot: ArrayLike,
                 t: ArrayLike = 0.0) -> Array:
        """Return Y, (n, 10) or (N, n, 10): the payload's torque is Y times its parameters."""
        Y = self.robot.derivative('inverse_dynamics', q, u, udot, by='payload', t=t)
        return np.asarray(Y @ self._moments)


class PayloadRows:
    """
    The equations of samples, one row for each actuator.

    Parameters
    ----------
    model, frame
        As of `PayloadRegressor`.

    Attributes
    ----------
    names : tuple of m str
        The actuators: actuated joints, or independent speeds.
    shared : int
        The number of independent speeds if there are more actuators; else 0.
    friction, friction_speed : (m,) arrays
        Coulomb friction that may hold an actuator at rest, N m or N, and the speed at
        which it sets in, rad/s or m/s.

    Raises
    ------
    InputError
        As `PayloadRegressor`.

    """

    def __init__(self, model: Model | Robot, frame: str) -> None:
        """Find the actuators; kernels compile on first use."""
        bare = model if isinstance(model, Robot) else Robot(model)
        self.regressor = PayloadRegressor(bare, frame)
        self.robot = self.regressor.robot
        self.names = actuators(self.robot)
        self.shared = self.robot.n if len(self.names) > self.robot.n else 0

        # Friction of the joints, in the order of their coordinates.
        joints = bare.model.coordinate_joints
        self._joint_friction = np.empty(len(joints))  # N m or N
        self._load_fraction = np.empty(len(joints))
        self._joint_speed = np.empty(len(joints))  # at which friction sets in
        for k, joint in enumerate(joints):
            self._joint_friction[k] = _holding_level(joint)
            self._load_fraction[k] = max(load_fractions(joint))
            self._joint_speed[k] = joint.friction_speed

        # In joint rates the joints are the actuators.
        self.friction = self._joint_friction
        self.friction_speed = self._joint_speed
        self._places: list[int] | None = None
        self._transmission: Kernel | None = None
        if not self.robot.equations.in_joint_rates:
            self._through_mechanism()

    def _through_mechanism(self) -> None:
        """Find the actuators of chosen speeds or constraints, and their friction."""
        robot = self.robot
        # Friction of all joints may hold an actuator.
        self.friction = np.full(len(self.names), self._joint_friction.sum())
        speed_of = dict(zip(robot.joint_names, self._joint_speed, strict=True))
        # An independent speed need not be the rate of a joint.
        self.friction_speed = np.array([speed_of.get(name, Joint.friction_speed)
                                        for name in self.names])
        self._places = robot.equations.actuated
        self._transmission = _transmission_kernel(robot, robot.equations)

    def __call__(self, q: Array, u: Array, udot: Array, tau: Array,
                 t: Any = 0.0) -> ActuatorRows:
        """
        Return the rows of one sample or of N in a row.

        Parameters
        ----------
        q, u, udot, tau : (n_q,), (n,), (n,), (n,) or (N, ...) arrays
            As of `Robot.inverse_dynamics` and its result; rad or m, s, N m or N.
        t : float or (N,) array
            Time, s.

        Raises
        ------
        ConstraintError
            The constraints are not met, or the actuators do not determine the motion
            there.

        """
        robot = self.robot
        Y = self.regressor(q, u, udot, t)
        residual = tau - robot.inverse_dynamics(q, u, udot, t=t)
        if self._transmission is None:
            return ActuatorRows(Y, u, residual, self._slack(u, tau))

        # One result holds T, (n_j, n), and, as its last column, the rates of all joints.
        times = robot.equations.time_inputs(np.broadcast_to(t, np.shape(q)[:-1]))
        transmission = self._transmission(q, u, *times)
        T = transmission[..., :-1]
        joint_rates = transmission[..., -1]
        # With constraints the torques do not determine the load on each drive.
        slack = self._slack(joint_rates, 0.0)

        # From independent speeds to the rates of the actuators T_a u, if these are
        # others.
        actuator_partials = None
        if self._places is not None:
            # Refuses configurations where the actuators do not determine the motion.
            torques = robot.joint_torques(residual, q, t=t)
            T_a = T[..., self._places, :]
            if self.shared:
                actuator_partials = T_a
                speeds_per_rate = np.linalg.pinv(T_a)
                residual = np.einsum('...na,...n->...a', speeds_per_rate, residual)
            else:
                speeds_per_rate = np.linalg.inv(T_a)
                residual = torques[..., self._places]
            Y = np.swapaxes(speeds_per_rate, -1, -2) @ Y
            T = T @ speeds_per_rate
            u = joint_rates[..., self._places]
        held = np.einsum('...ja,...j->...a', np.abs(T), slack)
        return ActuatorRows(Y, u, residual, held, actuator_partials)

    def compile(self) -> None:  # noqa: A003
        """Compile the kernels of single samples now instead of at the first one."""
        robot = self.robot
        robot.compile('inverse_dynamics',
                      *([] if self._places is None else ['joint_torques']))
        robot.kernels.kernel('inverse_dynamics', '',
                             Derivative('derivative', ('payload',)))

    def _slack(self, rates: Array, torque: Array | float) -> Array:
        """
        Return the most that friction may hold beyond the law.

        The torque of a joint stands for the load on its drive; they differ by friction.
        """
        slip = np.abs(coulomb(rates, self._joint_speed))
        level = self._joint_friction + self._load_fraction * np.abs(torque)
        return np.asarray((1.0 - slip) * level)


def _holding_level(joint: Joint) -> float:
    """Return the largest friction without load that may hold a joint at rest, N m or N."""
    forward, backward = coulomb_levels(joint)
    return float(max(forward, backward) + max(stribeck_excess(joint), 0.0))


def actuators(robot: Robot) -> tuple[str, ...]:
    """Return the names of the actuators: joints, or the independent speeds."""
    equations = robot.equations
    if equations.actuated is None:
        return robot.speed_names
    return robot.actuated_names


def _second_moments(P: Array) -> Array:
    """Return a payload of `Parameters` of a pseudo-inertia (4, 4), (10,)."""
    return np.array([P[3, 3], *P[:3, 3], *P[:3, :3][np.triu_indices(3)]])


def _transmission_kernel(robot: Robot, equations: Equations) -> Kernel:
    """Return the kernel of T and, as its last column, the joint rates, (n_j, n + 1)."""
    def rows(q: Any, u: Any, t: Any) -> Any:
        motion = equations.joint_motion(q, u, equations.zeros, t)
        return np.concatenate([motion.T, motion.qdot[:, None]], axis=1)
    return robot.compiled(rows, name='transmission', q=(robot.n_q,), u=(robot.n,),
                          shape=(robot.model.n, robot.n + 1))
