"""Mode motor_side: the motors of elastic joints follow a motion of the links."""

from collections.abc import Mapping
from typing import Any

from kane_dynamics._util.typing import Array
from kane_dynamics.control.elastic_control import derivatives_of, ElasticArm, LINK
from kane_dynamics.errors import InputError
from kane_dynamics.model.model import Model
from kane_dynamics.motion.motion import Motion
from kane_dynamics.robot.robot import Robot
from kane_dynamics.ros.modes.live_law import LiveLaw, SprungArm
from kane_dynamics.ros.parameters.parameter_checks import per_joint, terms
from kane_dynamics.task_space.sampled_spring import JointSpring
import numpy as np

SHARE = 0.04  # of the stiffness of a drive: the default gain of its motor's position


class MotorSideMode(LiveLaw):
    """
    The law of mode motor_side: elastic feedforward and PD; it holds the first pose.

    Parameters
    ----------
    robot : Robot
        The robot of the torque path, with rigid joints.
    values : mapping
        The node's parameters; drives.* and arm_compensates are used.
    model : Model
        The same arm with its drives.

    Raises
    ------
    InputError
        The arm has no elastic joints, or a parameter does not fit it.

    """

    def __init__(self, robot: Robot, values: Mapping[str, Any], model: Model | None
                 ) -> None:
        if model is None or not model.drives:
            raise InputError('an arm without drives; expected drives in the supplement')
        self._robot = robot
        options = {name: robot.options[name]
                   for name in ('payload_frame', 'feedforward_friction')}
        # The elastic arm for the law; the rigid one of the node stays for all else.
        self._elastic = Robot(model, **options)
        self._arm = ElasticArm(self._elastic)
        self._arm.require_deflections()
        self._side = values['drives.sensor_side']
        n = self._arm.n_links
        inputs: dict[str, tuple[int, ...]] = {
            'measured': (n,), 'rates': (n,), 'desired': (5, n),
            'ahead': (5, n), 'kp': (n,), 'kd': (n,)}
        # Feedback of the side whose encoders the joint states are from.
        law = self._arm.feedback_of_motors
        if self._side == LINK:
            law = self._arm.feedback_of_links
        self._law = self._elastic.compiled(law, name=f'motor_side_{self._side}', shape=(n,),
                                           **inputs)
        self._command = self._elastic.compiled(self._arm.motor_command, motion=(5, n),
                                               name='motor_side_command', shape=(5, n))
        self._gains = self._checked(values)
        self._lead = values['drives.lead']
        self._pose: Array | None = None

    def _checked(self, values: Mapping[str, Any]) -> tuple[Array, Array]:
        """Return the gains, N m/rad and N m s/rad, of the joints."""
        if not terms(values).complete or terms(values).arm is not None:
            raise InputError(f"parameter 'arm_compensates': "
                             f'{list(values["arm_compensates"])}; expected none, as the '
                             'feedforward of elastic joints has all terms')
        names = self._arm.names
        # By default a share of the spring, critically damped with the rotor.
        default_kp = np.full(len(names), np.nan)
        inertia = np.full(len(names), np.nan)
        for k, side in self._arm.drives.items():
            default_kp[k] = SHARE * side.drive.stiffness_at_rest
            inertia[k] = side.drive.rotor_inertia
        kp = per_joint(values, 'drives.kp', names, default_kp)
        kd = per_joint(values, 'drives.kd', names, 2.0 * np.sqrt(kp * inertia))
        # NaN is left where neither a gain nor a drive is given.
        for name, gains in (('drives.kp', kp), ('drives.kd', kd)):
            if not np.isfinite(gains).all():
                joint = names[int(np.isnan(gains).argmax())]
                raise InputError(f"parameter '{name}': empty, and joint '{joint}' has no "
                                 'drive; expected one number or one per joint')
        return kp, kd

    def check(self, values: Mapping[str, Any]) -> None:
        """Raise InputError unless parameters fit the arm."""
        self._checked(values)

    def update(self, values: Mapping[str, Any]) -> bool:
        """Use checked parameters; return whether a setting of the law changes."""
        gains = self._checked(values)
        lead = values['drives.lead']
        changed = lead != self._lead or not all(map(np.array_equal, gains, self._gains))
        self._gains, self._lead = gains, lead
        return changed

    def compile(self) -> None:  # noqa: A003
        """Compile what the path needs: the kernels are compiled with the law."""
        zeros = np.zeros((5, self._arm.n_links))
        self._law(zeros[0], zeros[0], zeros, zeros, *self._gains)
        self._command(zeros)

    def restart(self) -> None:
        """Hold the pose of the next state, unless there is a motion."""
        self._pose = None

    def torque(self, q: Array, u: Array, motion: Motion | None, moment: float,
               t: float) -> Array:
        """Return torques of the motors (n,), joint-side, towards the motion."""
        self._take_loads()
        if motion is not None:
            self._pose = None  # the pose at the end of the motion is held next
            times = np.array([moment, moment + self._lead])
            desired, ahead = derivatives_of(motion, times)
        else:
            if self._pose is None:
                self._pose = self._links_at(q)
            desired = ahead = np.zeros((5, len(q)))
            desired[0] = self._pose
        return np.asarray(self._law(q, u, desired, ahead, *self._gains))

    def _take_loads(self) -> None:
        """Give the elastic arm gravity and payload of the robot of the torque path."""
        physical = self._robot.parameters.physical
        self._elastic.parameters.block[:physical] = self._robot.parameters.block[:physical]

    def springs(self, q: Array) -> dict[str, JointSpring]:
        """Return the feedback of the measured side on the motors."""
        measured = self._arm.links if self._side == LINK else self._arm.motors
        stiffness, damping = np.zeros((2, self._elastic.n, self._elastic.n))
        stiffness[self._arm.motors, measured], damping[self._arm.motors, measured] = (
            self._gains)
        return {'drives.kp and drives.kd': JointSpring(stiffness, damping, False)}

    def sprung_arm(self, robot: Robot, q: Array) -> SprungArm:
        """Return links and motors on the springs and dampers of their drives, undeflected."""
        self._take_loads()
        elastic = self._elastic
        positions = np.zeros(elastic.n)
        positions[self._arm.links] = positions[self._arm.motors] = q
        stiffness, damping = np.zeros((2, elastic.n, elastic.n))
        for k, side in self._arm.drives.items():
            ends = np.ix_(*[[self._arm.links[k], self._arm.motors[k]]] * 2)
            between = np.array([[1.0, -1.0], [-1.0, 1.0]])
            stiffness[ends] += side.drive.stiffness_at_rest * between
            damping[ends] += side.drive.damping * between
        return SprungArm(elastic.mass_matrix(positions), elastic.joint_names,
                         JointSpring(stiffness, damping, False))

    def _links_at(self, q: Array) -> Array:
        """Return the links' positions at rest for measured ones: motors lead links."""
        if self._side == LINK:
            return q.copy()
        at_rest = np.zeros((5, len(q)))
        at_rest[0] = q
        # Gravity changes little over a deflection.
        return np.asarray(2.0 * q - self._command(at_rest)[0])

    @property
    def pose(self) -> Array | None:
        """Return the positions of the links that are held."""
        return self._pose
