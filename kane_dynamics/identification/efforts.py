"""The meaning of reported efforts, and the torques on the joints that follow from them."""

from dataclasses import dataclass, replace
from typing import Any

from kane_dynamics._util.checks import finite_row, instance, per_joint
from kane_dynamics._util.typing import Array
from kane_dynamics.analysis.known_arms import EffortKind
from kane_dynamics.errors import InputError
from kane_dynamics.identification.payload.recorded_motion import (recorded_joints,
                                                                  recorded_states)
from kane_dynamics.identification.recordings.recording import Recording
from kane_dynamics.mechanics.friction import refuse_load_friction
from kane_dynamics.native.runtime.kernel import Argument, checked, Kernel
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
        Torque on the joint per current, N m/A or N/A, gears included; negative where the
        motor turns the other way. Needed for currents only.

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

        # Constants and currents belong together.
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
               udot: ArrayLike | None = None, *, t: ArrayLike = 0.0) -> Array:
        """
        Return the torque of the actuators, by the model where the efforts lack a part.

        Of robots in joint rates it is tau of M(q) udot + bias(q, u) = tau. Others have an
        effort and a torque for each of `robot.actuated_names`;
        `robot.generalized_force` returns their tau.

        Parameters
        ----------
        robot : Robot
            Its gravity, payload, friction and armature supply what the efforts lack.
        q : (n_q,) or (N, n_q) array_like
            rad or m.
        u : (n,) or (N, n) array_like
            Independent speeds, rad/s or m/s.
        effort : (n_a,) or (N, n_a) array_like
            As reported, of the joints with actuators: N m or N, or A.
        udot : (n,) or (N, n) array_like, optional
            Accelerations; needed for external torques. Joint torques lack the inertia of
            the rotors without it.
        t : float or (N,) array_like
            Time of the states, s, where constraints depend on it.

        Returns
        -------
        (n_a,) or (N, n_a) array, N m or N.

        Raises
        ------
        InputError
            Accelerations are missing, or constants or efforts do not fit the actuators.
        ConstraintError
            A part is missing at a configuration where the actuators cannot move the
            mechanism in every direction.

        """
        instance(robot, Robot, 'robot')
        names = actuated_joints(robot)
        tau = checked(Argument('effort', (len(names),), names), effort)
        if self.plain:
            return tau.copy()
        if self.constants is not None:
            # Currents times constants; then what each kind of effort lacks.
            tau = tau * _torque_constants(self.constants, names)

        # The efforts lack all that moves the arm by itself.
        if self.kind is EffortKind.EXTERNAL_TORQUE:
            if udot is None:
                raise InputError('udot: missing; expected the accelerations, which '
                                 'external torques lack')
            of_motion = robot.inverse_dynamics(q, u, udot, t=t)
            return _of_actuators(robot, of_motion, q, t) - tau
        if self.kind is EffortKind.JOINT_TORQUE:
            if robot.friction:
                refuse_load_friction(robot.model, f'efforts: {self}')
            # Between the motor and the sensor: friction, and the inertia of the rotor.
            u = checked(Argument('u', (robot.n,), robot.speed_names), u)
            rates = np.zeros_like(u) if udot is None else udot
            losses = _losses_kernel(robot)(q, u, rates, *robot.equations.time_inputs(t))
            friction, rotor = np.moveaxis(losses, -2, 0)
            tau = tau + friction
            if udot is not None:
                tau = tau + rotor
        if not self.gravity:
            tau = tau + _of_actuators(robot, robot.gravity_force(q, t=t), q, t)
        return np.asarray(tau)

    def compile(self, robot: Robot) -> None:  # noqa: A003
        """Compile what `torque` and `contradiction` use, so that no later call does."""
        instance(robot, Robot, 'robot')
        quantities = ['gravity_force', 'inverse_dynamics']
        if not robot.equations.in_joint_rates:
            quantities.append('joint_torques')
        robot.compile(*quantities)
        if self.kind is EffortKind.JOINT_TORQUE:
            _losses_kernel(robot)

    def applied(self, robot: Robot, recording: Recording) -> Recording:
        """
        Return the recording with the torques of the actuators in place of its efforts.

        With constraints it is one of the actuators, as for `identify_payload`.
        """
        instance(robot, Robot, 'robot')
        instance(recording, Recording, 'recording')
        if self.plain:
            return recording
        r = recording

        # The recording has the actuators, whose states give those of all joints.
        recorded = recorded_joints(robot)
        order = list(map(recorded.index, actuated_joints(robot)))
        states = recorded_states(robot, recorded, r)
        tau = np.empty_like(r.tau)
        tau[:, order] = self.torque(robot, states.q, states.u, r.tau[:, order],
                                    states.udot, t=r.t)
        return replace(r, tau=tau)

    def contradiction(self, robot: Robot, q: ArrayLike, effort: ArrayLike) -> str:
        """
        Return how efforts at rest contradict their stated meaning; empty if they do not.

        Parameters
        ----------
        robot : Robot
            Its gravity and payload are compared with the efforts.
        q : (n_q,) array_like
            At rest, without contact, rad or m.
        effort : (n_a,) array_like
            Of the joints with actuators, N m, N or A.

        """
        # The share of the weight that the efforts hold: 1 if they are torques of the
        # actuators.
        share = self.share_of_weight(robot, q, effort)
        if share is None or not np.asarray(effort).any():  # brakes hold the arm
            return ''
        weighty = self.gravity and self.kind is not EffortKind.EXTERNAL_TORQUE
        words = f'efforts at rest: they hold {share:.0%} of the weight; expected '
        if not weighty:
            return '' if share < MOST else (
                f'{words}none of {self}: do they contain gravity (efforts.gravity)?')
        # Each wrong meaning has a share of its own.
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
        instance(robot, Robot, 'robot')
        weight = robot.gravity_force(finite_row(q, 'q', robot.coordinate_names))
        if np.abs(weight).max(initial=0.0) < WEIGHTLESS:
            return None
        # Efforts in the units of the robot, projected on its speeds, then on the
        # weight.
        held = finite_row(effort, 'effort', actuated_joints(robot))
        if self.constants is not None:
            held = held * _torque_constants(self.constants, actuated_joints(robot))
        held = generalized_force(robot, held, q)
        return float(held @ weight / (weight @ weight))

    def __str__(self) -> str:
        """Return the meaning in words."""
        name = EffortKind(self.kind).replace('_', ' ') + 's'
        if self.kind is EffortKind.EXTERNAL_TORQUE:
            return name
        return f'{name} {"with" if self.gravity else "without"} gravity'


def _torque_constants(stated: ArrayLike, names: tuple[str, ...]) -> Array:
    """Return the torque on each joint per current, (n,), N m/A or N/A."""
    constants = per_joint(stated, 'constants', names, signed=True)
    if not constants.all():
        joint = names[int(np.flatnonzero(constants == 0.0)[0])]
        raise InputError(f"constants of joint '{joint}': 0; expected another number, N m/A "
                         'or N/A')
    return constants


def generalized_force(robot: Robot, torque: Array, q: ArrayLike) -> Array:
    """Return the generalized force tau, (n,), of torques of the actuators at one state."""
    names = robot.model.joint_names
    torques = np.zeros(len(names))
    torques[list(map(names.index, actuated_joints(robot)))] = torque
    return robot.generalized_force(torques, q)


def actuated_joints(robot: Robot) -> tuple[str, ...]:
    """Return the joints that have efforts, in the robot's order: all in joint rates."""
    in_joint_rates = robot.equations.in_joint_rates
    return robot.joint_names if in_joint_rates else robot.actuated_names


def _of_actuators(robot: Robot, tau: Array, q: ArrayLike, t: ArrayLike) -> Array:
    """Return the torques of the actuators, (..., n_a), with a generalized force."""
    names = robot.model.joint_names
    torques = robot.joint_torques(tau, q, t=t)
    return np.asarray(torques[..., list(map(names.index, actuated_joints(robot)))])


def _losses_kernel(robot: Robot) -> Kernel:
    """Return the kernel of friction and rotors' inertia at the actuators, (2, n_a)."""
    equations = robot.equations
    names = robot.model.joint_names
    # Losses act at the joints with actuators, whose efforts the recording has.
    places = list(map(names.index, actuated_joints(robot)))

    def losses(q: Any, u: Any, udot: Any, t: Any) -> Any:
        motion = equations.joint_motion(q, u, udot, t)
        friction = equations.tree.friction_force(motion.qdot)
        rotor = equations.tree.rotor_inertia * motion.qddot
        return np.array([friction[places], rotor[places]])

    return robot.compiled(losses, name='losses', q=(robot.n_q,), u=(robot.n,),
                          udot=(robot.n,), shape=(2, len(places)))


MOTOR_TORQUES = Efforts()
