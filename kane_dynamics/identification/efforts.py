"""The meaning of reported efforts, and the torques on the joints that follow from them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from kane_dynamics._util.checks import per_joint
from kane_dynamics._util.typing import Array
from kane_dynamics.analysis.known_arms import EffortKind
from kane_dynamics.errors import InputError
from kane_dynamics.identification.recordings.recording import Recording
from kane_dynamics.mechanics.friction import refuse_load_friction
from kane_dynamics.robot.robot import Robot
import numpy as np
from numpy.typing import ArrayLike

LITTLE, MOST = 0.3, 0.7  # share of the weight that efforts at rest hold, without and with gravity
WEIGHTLESS = 1e-3  # N m or N: gravity forces below this tell nothing


@dataclass(frozen=True, eq=False)
class Efforts:
    """
    The meaning of reported efforts.

    motor_current
        Current of the motor, A; times `constants` it is a motor torque.
    motor_torque
        Torque of the motor behind its gear: it overcomes friction and accelerates the
        rotor.
    joint_torque
        Measured at the joint, behind friction and rotor: these are added from the model.
    external_torque
        Torque of the environment on the joints, as the arm estimates it with a model of
        its own.

    Attributes
    ----------
    kind : EffortKind or str
    gravity : bool
        Whether the weight of the arm and of its payload is part of the efforts; without
        effect on external torques. If not, the gravity of the model is added.
    constants : (n,) array, optional
        Torque on the joint per current, N m/A or N/A, gears included; needed for
        currents only.

    Raises
    ------
    InputError
        The kind is unknown, `gravity` is no truth value, or constants are missing or not
        needed.

    """

    kind: EffortKind | str = EffortKind.MOTOR_TORQUE
    gravity: bool = True
    constants: ArrayLike | None = None

    def __post_init__(self) -> None:
        """Check the kind, and that there are constants for currents."""
        if self.kind not in list(EffortKind):
            raise InputError(f'efforts: {self.kind!r}; expected one of '
                             f'{", ".join(EffortKind)}')
        object.__setattr__(self, 'kind', EffortKind(self.kind))
        if not isinstance(self.gravity, bool):
            raise InputError(f'gravity: {self.gravity!r}; expected True or False')
        currents = self.kind is EffortKind.MOTOR_CURRENT
        if currents and self.constants is None:
            raise InputError('efforts: motor_current without constants; expected the '
                             'torque constants of the joints, N m/A')
        if self.constants is not None and not currents:
            raise InputError(f'efforts: {self.kind} with constants; expected these with '
                             'motor_current only')

    @property
    def plain(self) -> bool:
        """Return whether the efforts are the torques of the equations of motion as they stand."""
        return self.kind is EffortKind.MOTOR_TORQUE and self.gravity

    def torque(self, robot: Robot, q: ArrayLike, u: ArrayLike, effort: ArrayLike,
               udot: ArrayLike | None = None) -> Array:
        """
        Return the torque that acts on the joints, tau of M(q) udot + bias(q, u) = tau.

        Parameters
        ----------
        robot : Robot
            Its gravity, payload, friction and armature supply what the efforts lack.
        q, u : (n,) or (N, n) array_like
            rad or m; rad/s or m/s.
        effort : (n,) or (N, n) array_like
            As reported: N m or N, or A.
        udot : (n,) or (N, n) array_like, optional
            Accelerations; needed for external torques. Joint torques lack the inertia of
            the rotors without it.

        Returns
        -------
        (n,) or (N, n) array, N m or N.

        Raises
        ------
        InputError
            The robot has constraints and efforts are not motor torques with gravity, or
            accelerations are missing.

        """
        tau = np.array(effort, dtype=np.float64)
        if self.plain:
            return tau
        if robot.constraint_names:
            raise InputError(f'efforts: {self}, of a robot with constraints; expected '
                             'motor torques with gravity, since the others need the '
                             'torques of single joints')
        if self.constants is not None:
            constants = per_joint(self.constants, 'constants', robot.joint_names)
            if not constants.all():
                joint = robot.joint_names[int(np.argmin(constants))]
                raise InputError(f"constants of joint '{joint}': 0; expected a positive "
                                 'number, N m/A or N/A')
            tau = tau * constants
        if self.kind is EffortKind.EXTERNAL_TORQUE:
            if udot is None:
                raise InputError('udot: missing; expected the accelerations, which '
                                 'external torques lack')
            return np.asarray(robot.inverse_dynamics(q, u, udot) - tau)
        if self.kind is EffortKind.JOINT_TORQUE:
            if robot.friction:
                refuse_load_friction(robot.model, f'efforts: {self}')
            tau = tau + robot.friction_force(u)
            if udot is not None:
                tau = tau + _armature(robot) * np.asarray(udot)
        if not self.gravity:
            tau = tau + robot.gravity_force(q)
        return np.asarray(tau)

    def applied(self, robot: Robot, recording: Recording) -> Recording:
        """Return the recording with the torques on the joints in place of its efforts."""
        if self.plain:
            return recording
        r = recording
        return replace(r, tau=self.torque(robot, r.q, r.u, r.tau, r.udot))

    def contradiction(self, robot: Robot, q: ArrayLike, effort: ArrayLike) -> str:
        """
        Return how efforts at rest contradict their stated meaning; empty if they do not.

        Parameters
        ----------
        robot : Robot
            Its gravity and payload are compared with the efforts.
        q, effort : (n,) array_like
            At rest, without contact: rad or m; N m, N or A.

        """
        share = self.share_of_weight(robot, q, effort)
        if share is None or not np.asarray(effort).any():  # brakes hold the arm
            return ''
        weighty = self.gravity and self.kind is not EffortKind.EXTERNAL_TORQUE
        words = f'efforts at rest: they hold {share:.0%} of the weight; expected '
        if not weighty:
            return '' if share < MOST else (
                f'{words}none of {self}: do they contain gravity (efforts.gravity)?')
        if share < -MOST:
            return f'{words}about 100% of {self}: their sign is reversed'
        if share < LITTLE:
            return (f'{words}about 100% of {self}: do they lack gravity '
                    '(efforts.gravity), or are they of another kind (efforts.kind)?')
        if share > 1.0 / LITTLE:
            return (f'{words}about 100% of {self}: are they currents, or in another '
                    'unit (efforts.kind, efforts.constants)?')
        return ''

    def share_of_weight(self, robot: Robot, q: ArrayLike,
                        effort: ArrayLike) -> float | None:
        """Return the share of the weight that efforts at rest hold; None where nothing weighs."""
        weight = robot.gravity_force(q)
        if np.abs(weight).max(initial=0.0) < WEIGHTLESS:
            return None
        held = np.asarray(effort, dtype=np.float64)
        if self.constants is not None:
            held = held * per_joint(self.constants, 'constants', robot.joint_names)
        return float(held @ weight / (weight @ weight))

    def __str__(self) -> str:
        """Return the meaning in words."""
        name = EffortKind(self.kind).replace('_', ' ') + 's'
        if self.kind is EffortKind.EXTERNAL_TORQUE:
            return name
        return f'{name} {"with" if self.gravity else "without"} gravity'


def _armature(robot: Robot) -> Array:
    """Return the armature of each joint, (n,) kg m^2 or kg."""
    joints: Sequence[object] = robot.model.coordinate_joints
    return np.array([getattr(joint, 'armature', 0.0) for joint in joints])


MOTOR_TORQUES = Efforts()
