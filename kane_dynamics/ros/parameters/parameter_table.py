"""
The table of the node's parameters: name, kind, default, meaning, valid values.

Numbers and lists are declared with dynamic typing, so that ``100`` is valid for
``100.0`` and one number is valid for a list with one number per joint.
"""

from dataclasses import dataclass
import math
from typing import Any, Literal

from kane_dynamics.analysis.known_arms import EffortKind
from kane_dynamics.control.friction_error import FRICTION_SPEED
from kane_dynamics.control.terms import Mode, STATEMENT
import numpy as np
from rcl_interfaces.msg import FloatingPointRange

LAW_MODES = (Mode.JOINT_IMPEDANCE, Mode.CARTESIAN_IMPEDANCE, Mode.HAND_GUIDING)
Kind = Literal['text', 'flag', 'number', 'count', 'names', 'vector', 'six', 'numbers',
               'floats', 'per_joint', 'terms']

AUTO = 'auto'  # of an integrator: chosen by the step, as `simulate` does


@dataclass(frozen=True)
class Spec:
    """
    The specification of one parameter.

    `live` parameters may change while the node is active; the others may change only
    while the node is unconfigured. Numbers lie between `low` and `high`; `positive`
    excludes zero, and only `infinite` permits infinity.
    """

    name: str
    kind: Kind
    default: Any
    description: str
    live: bool = False
    low: float = -math.inf
    high: float = math.inf
    positive: bool = False
    infinite: bool = False
    choices: tuple[str, ...] = ()
    read_only: bool = False

    @property
    def constraint(self) -> str:
        """Return a description of the valid values."""
        if self.choices:
            words_of_kind = 'a list of some of' if self.kind == 'names' else 'one of'
            return f'{words_of_kind} {", ".join(self.choices)}'
        if self.kind == 'vector' and self.high < math.inf:
            return f'three numbers, each {self._range}'
        # Words for each kind, which appear in the description and in errors.
        words = {'text': 'a string',
                 'flag': 'true or false',
                 'names': 'a list of names, each once',
                 'vector': 'three finite numbers',
                 'six': 'six finite numbers',
                 'floats': 'a list of finite numbers',
                 'numbers': f'a list of integers, each {self._range}',
                 'number': f'a number, {self._range}',
                 'count': f'an integer, {self._range}',
                 'terms': STATEMENT,
                 'per_joint': f'one number or one per joint, each {self._range}'}
        return words[self.kind]

    @property
    def slider(self) -> list[FloatingPointRange]:
        """Return the bounds of a number that has both, as tools show them."""
        if self.kind != 'number' or not math.isfinite(self.high - self.low):
            return []
        return [FloatingPointRange(from_value=self.low, to_value=self.high)]

    @property
    def _range(self) -> str:
        """Return a description of the range of numbers."""
        # The lower bound, then the upper one.
        if self.positive:
            words = 'positive'
        elif self.low == -math.inf:
            words = 'finite'
        else:
            words = f'at least {self.low:g}'
        if self.high < math.inf:
            words += f', at most {self.high:g}'
        if self.infinite:
            words += ' or infinite'
        return words


def live(name: str, kind: Kind, default: Any, description: str, **bounds: Any) -> Spec:
    """Return the Spec of a parameter that may change while the node is active."""
    return Spec(name, kind, default, description, live=True, **bounds)


SPECS = (
    Spec('autostart', 'flag', True,
         'configure the node as soon as it has the URDF', read_only=True),
    Spec('activation', 'text', 'on_request',
         'when the node commands: on_request: once it is activated; at_once: also as soon '
         'as autostart has configured it, for simulated arms',
         choices=('on_request', 'at_once'), read_only=True),
    Spec('bond', 'flag', False,
         'keep a bond with a lifecycle manager, as that of Nav2, while active: it notices '
         'when this node hangs or dies; needs the package bond'),
    Spec('robot_description', 'text', '', 'URDF as text; overrides `urdf` and the topic '
         'robot_description'),
    Spec('urdf', 'text', '', 'path of the URDF or xacro file; overrides the topic '
         'robot_description'),
    Spec('supplement', 'text', '',
         'path of the YAML supplement of the URDF: springs, armature, '
         'friction, payload; empty: none'),
    Spec('base', 'text', '',
         'first link of the part of the robot that moves; empty: the root'),
    Spec('tip', 'text', '',
         'last link of the part of the robot that moves; empty: all branches'),
    Spec('root_joint', 'text', 'fixed',
         'joint between the world and the base link: none, or one '
         'that moves in space (three angles) or in a plane. Joint states then need its '
         'coordinates root_joint/x and so on; `commands` leave them out, as they have '
         'no motors',
         choices=('fixed', 'floating', 'planar')),
    Spec('joints', 'names', [],
         'joints that move, in the order of `commands`; all other joints '
         'are locked; empty: all joints, parents first'),
    Spec('constraints', 'text', '', 'path of a YAML file with loop closures and other '
         'constraints; joint states then need the joints of its key `independent`, and '
         '`commands` are of its `actuated` joints; empty: none'),
    Spec('prefix', 'text', '',
         'prefix of the names of joints and frames in messages, for two '
         'arms with the same URDF; parameters and the supplement use the names of the '
         'URDF'),
    live('gravity', 'vector', [0.0, 0.0, -9.81], 'gravity in world axes, m/s^2',
         low=-100.0, high=100.0),
    Spec('payload.frame', 'text', '',
         'frame in which the payload is given, fixed to the link '
         'that carries it; empty: no payload'),
    live('payload.mass', 'number', 0.0,
         'mass of the payload, kg, until ~/set_payload changes it', low=0.0),
    live('payload.com', 'vector', [0.0, 0.0, 0.0],
         'center of mass of the payload relative to '
         'payload.frame, in its axes, m'),
    live('payload.inertia', 'six', [0.0] * 6,
         'inertia xx, xy, xz, yy, yz, zz of the payload '
         'about its center of mass, kg m^2'),
    live('payload.max_mass', 'number', 50.0, 'largest accepted mass of a payload, kg',
         positive=True, low=0.0),
    Spec('attached_objects.topic', 'text', '',
         "topic (moveit_msgs/PlanningScene) of MoveIt's scene, such as "
         '/monitored_planning_scene: objects that are attached to the link of payload.frame '
         'are added to the payload; needs the package moveit_msgs; empty: none'),
    live('attached_objects.masses', 'names', [],
         'masses of attached objects, kg, each as object:=mass'),
    live('attached_objects.density', 'number', 0.0,
         'density of the other attached objects, kg/m^3; 0: they are refused', low=0.0,
         high=30000.0),
    Spec('imu.topic', 'text', '',
         'topic (sensor_msgs/Imu) of an IMU at rest on the base, which '
         'gives the direction of gravity; the magnitude is that of `gravity`; empty: '
         'none'),
    Spec('wrench.frames', 'names', [],
         'frames at which ~/wrench gives the wrench that the '
         'environment exerts on the robot; the torques of the modes inverse_dynamics and '
         'computed_torque compensate it; empty: none'),
    live('wrench.timeout', 'number', 0.1,
         'age, s, above which a wrench is stale and its frame '
         'unloaded', positive=True, low=0.0, high=3600.0),
    Spec('tf.enabled', 'flag', False,
         'find frames of wrenches, targets and the IMU that the URDF lacks by the transforms '
         'of /tf and /tf_static; needs the package tf2_msgs'),
    live('mode', 'text', 'inverse_dynamics',
         'control mode, which decides what `commands` '
         'contains', choices=tuple(Mode)),
    Spec('modes', 'names', [],
         'further modes to which `mode` may change while the node is configured; their '
         'laws are compiled then', choices=(*LAW_MODES, Mode.MOTOR_SIDE)),
    Spec('arm_compensates', 'terms', [],
         'torque terms that the arm adds to commanded efforts '
         'itself; `commands` leave them out; without this statement the node does not '
         'configure'),
    Spec('arm_gravity', 'floats', [],
         'gravity that the arm compensates, three numbers in the axes of its base, m/s^2; '
         '`commands` have the difference from the gravity of this node; empty: that one, '
         'by parameter or IMU'),
    Spec('arm_payload', 'floats', [],
         'payload that the arm compensates: mass, kg, and three coordinates of its center '
         'of mass in the axes of payload.frame, m; `commands` have the difference from '
         'the payload of this node; [0, 0, 0, 0]: none; empty: none with `arm_gravity`, '
         'else the payload of this node'),
    live('gains.kp', 'per_joint', 100.0,
         'mode computed_torque: gain of position errors, '
         '1/s^2', low=0.0),
    live('gains.kd', 'per_joint', 20.0, 'mode computed_torque: gain of velocity errors, '
         '1/s', low=0.0),
    live('blend_time', 'number', 0.1,
         'time in which the torque goes over to a new control law after a change of mode, '
         'gains or impedance, s; 0: at once, within limits.rate', low=0.0, high=10.0),
    live('joint_impedance.stiffness', 'per_joint', [],
         'mode joint_impedance: stiffness, N m/rad or N/m; empty: five times the effort '
         'limit per rad or m', low=0.0),
    live('joint_impedance.damping', 'per_joint', [],
         'mode joint_impedance: damping, N m s/rad or N s/m; empty: a damping ratio of 0.7 '
         'of the arm on its springs', low=0.0),
    Spec('drives.sensor_side', 'text', 'motor',
         'where the joint states of elastic joints are measured: motor (divided by the '
         'gear ratio) or link; used by mode motor_side', choices=('motor', 'link')),
    live('drives.kp', 'per_joint', [],
         'mode motor_side: gain of position errors, joint-side, N m/rad or N/m; empty: '
         '4 % of the stiffness of the drive', low=0.0),
    live('drives.kd', 'per_joint', [],
         'mode motor_side: gain of velocity errors, N m s/rad or N s/m; empty: critical '
         'damping of the rotor', low=0.0),
    live('drives.lead', 'number', 0.0,
         'mode motor_side: time by which the feedforward is ahead of the state, s: half '
         'of a cycle in which a torque is held, and the delay until it acts', low=0.0,
         high=0.1),
    Spec('cartesian.frame', 'text', '',
         'the controlled frame of mode cartesian_impedance '
         'and of ~/task_state; empty: `tip`, or else the last link'),
    Spec('cartesian.axes', 'text', 'world',
         'axes of cartesian.stiffness: world, frame (those of the target), or a frame '
         'that is fixed to the world or to the body of cartesian.frame'),
    live('cartesian.stiffness', 'six', [600.0, 600.0, 600.0, 30.0, 30.0, 30.0],
         'mode cartesian_impedance: stiffness along and about the axes, N/m and N m/rad; '
         'not negative'),
    live('cartesian.max_force', 'number', 60.0,
         'largest force of the spring, and of ~/target_wrench, N', positive=True,
         infinite=True, low=0.0),
    live('cartesian.max_moment', 'number', 12.0,
         'largest moment of the spring, and of ~/target_wrench, N m', positive=True,
         infinite=True, low=0.0),
    live('cartesian.posture_stiffness', 'per_joint', 5.0,
         'mode cartesian_impedance: stiffness of the posture, which acts where it does not '
         'move the frame, N m/rad or N/m; 0: none', low=0.0),
    live('hand_guiding.friction', 'number', 0.8,
         'mode hand_guiding: fraction of the friction of the model and of '
         'observer.friction.* that is compensated',
         low=0.0, high=1.0),
    live('hand_guiding.max_speed', 'per_joint', [],
         'speed of a joint above which it is braked, rad/s or m/s; empty: half of the '
         'limits of the URDF', positive=True, infinite=True, low=0.0),
    live('target.max_speed', 'number', 0.25,
         'largest speed of the target of mode cartesian_impedance, m/s', positive=True,
         low=0.0, high=100.0),
    live('target.max_angular_speed', 'number', 1.0,
         'largest angular speed of the target, rad/s', positive=True, low=0.0,
         high=100.0),
    live('limits.effort', 'per_joint', [],
         'effort limit, N m or N, at most that of the URDF; one number lowers the larger '
         'limits; empty: only that of the URDF', positive=True, infinite=True, low=0.0),
    live('limits.velocity', 'per_joint', [],
         'speed limit, rad/s or m/s, in addition to that of '
         'the URDF; the smaller one applies to checks of joint states and motions, '
         'which need one; empty: only that of the URDF', positive=True, infinite=True,
         low=0.0),
    live('limits.rate', 'per_joint', [],
         'limit of the rate of effort, N m/s or N/s; empty: 20 '
         'times the effort limit each second',
         positive=True, infinite=True, low=0.0),
    Spec('torque_path', 'text', 'auto', 'what computes the commands: python, the '
         'interpreter; native, a thread that never waits for it (expected: what '
         'docs/node_path.md lists); auto, native where that is possible, else python',
         choices=('python', 'native', 'auto')),
    Spec('stamped_commands', 'flag', False, 'also publish the commands as '
         'control_msgs/JointCommand, or DynamicInterfaceGroupValues in the form mit, on '
         'topic stamped_commands, with joint names and the stamp of the joint state; needs '
         'the package control_msgs with that message'),
    live('feedforward.tolerance', 'per_joint', [], 'largest error of the effort that is '
         'interpolated between the points of ~/trajectory_with_effort, N m or N; points '
         'are inserted where it is larger; empty: none are', positive=True,
         infinite=True, low=0.0),
    live('feedforward.clip', 'flag', False,
         'clamp the efforts of ~/trajectory_with_effort to '
         'their limits; false: reject a trajectory that exceeds them'),
    Spec('efforts.kind', 'text', 'motor_torque',
         'what the efforts of joint states are: the '
         'current of the motor; its torque, behind the gear; the torque of a sensor at '
         'the joint, which lacks friction and rotor; the torque of the environment',
         choices=tuple(EffortKind)),
    Spec('efforts.gravity', 'flag', True,
         'whether the weight of the arm is part of the efforts '
         'of joint states; if not, observer and monitor_node add the gravity of the model'),
    Spec('efforts.constants', 'per_joint', [],
         'torque on the joint per motor current, N m/A or N/A, gears included, negative '
         'where the motor turns the other way; for motor_current only'),
    Spec('efforts.scale', 'per_joint', [],
         'torque on the joint per reported and per commanded effort, negative for the '
         'opposite sign; torques are in N m inside'),
    Spec('commands.form', 'text', 'effort',
         'what `commands` are: effort; position_offset: the desired position plus torque '
         'over commands.stiffness, for position servos; mit: five rows of desired '
         'position, velocity, stiffness, damping and torque',
         choices=('effort', 'mit', 'position_offset')),
    Spec('commands.stiffness', 'per_joint', [],
         'stiffness of the drives, N m/rad or N/m, for the forms mit and position_offset',
         positive=True, low=0.0),
    Spec('commands.damping', 'per_joint', [],
         'damping of the drives, N m s/rad or N s/m: in the form mit that of the command',
         low=0.0),
    Spec('observer.enabled', 'flag', False,
         'estimate external torques with a momentum observer '
         'and publish them and a collision flag'),
    live('observer.torque', 'text', 'auto',
         'source of the torque that acts on the arm: the '
         'effort of the joint states, the command of this node (valid only if nothing '
         'else commands the arm), or auto: effort if every joint has one, else command',
         choices=('auto', 'effort', 'command')),
    live('observer.gain', 'per_joint', 50.0,
         'bandwidth of the estimate, 1/s; it reaches 63 % of '
         'a step after 1/gain', positive=True, low=0.0, high=1e4),
    live('observer.threshold', 'per_joint', [], 'external torque above which there is a '
         'collision, N m or N, as of `kane-dynamics calibrate --collision` for a '
         'recording without contact; empty: no collision is detected', positive=True,
         infinite=True, low=0.0),
    live('observer.friction.coulomb', 'per_joint', [],
         'Coulomb friction beyond that of the '
         'model, N m or N, as of `kane-dynamics calibrate --collision`; empty: 0'),
    live('observer.friction.damping', 'per_joint', [],
         'damping beyond that of the model, N m s '
         'or N s/m; empty: 0'),
    live('observer.friction.offset', 'per_joint', [],
         'constant torque beyond the model, N m or '
         'N; empty: 0'),
    live('observer.friction.speed', 'per_joint', FRICTION_SPEED,
         'friction speed of that Coulomb friction, rad/s or m/s', positive=True, low=0.0),
    live('observer.action', 'text', 'report',
         'what follows a collision beside ~/collision: report, nothing; stop: the desired '
         'motion ends in a stop of state_check.stop_time, and motions are refused until the '
         'collision ends', choices=('report', 'stop')),
    Spec('guard.enabled', 'flag', False,
         'work with torque_guard, which holds the arm when this '
         'node dies or hangs; the launch file sets it'),
    Spec('guard.lease', 'number', 0.012,
         'time without a command, s, after which torque_guard '
         'takes over; also the lease of liveliness of `commands` and ~/joint_torques',
         low=2e-3, high=10.0),
    live('state_timeout', 'number', 0.1,
         'age, s, above which joint states are stale: the node '
         'commands zeros and drops the desired motion', low=1e-3, high=3600.0),
    live('state_check.speed_factor', 'number', 2.0,
         'factor on the speed limit above which a '
         'joint cannot move: a joint state with a larger velocity, or whose position '
         'moved farther than this speed allows, is dropped; infinite: no such check',
         low=1.0, infinite=True),
    live('state_check.jitter', 'number', 0.002,
         'uncertainty of the stamps of joint states, s, '
         'which is added to the time between two of them', low=0.0, high=10.0),
    live('state_check.position_margin', 'number', 0.2,
         'distance, rad or m, by which a measured '
         'position may lie outside the position limits of its joint; beyond it the '
         'state is dropped, as it is for degrees; infinite: no such check', low=0.0,
         infinite=True),
    live('state_check.action', 'text', 'zero',
         'torques after state_check.grace: zero, or hold: '
         'the arm is brought to rest by its model, without feedback, and then gravity is '
         'compensated there, until states are valid again or stop',
         choices=('zero', 'hold')),
    live('diagnostics_rate', 'number', 1.0, 'rate of /diagnostics, 1/s', low=1e-3,
         high=100.0),
    live('trajectory.start_tolerance', 'number', 0.1,
         'largest distance of a joint, rad or m, '
         'from where a motion sets out to where the arm is then; infinite: any',
         positive=True, low=0.0, infinite=True),
    live('trajectory.limit_factor', 'number', 1.2,
         'factor on the limits of speed and effort '
         'above which a motion is refused; infinite: none is', low=1.0, infinite=True),
    live('trajectory.path_tolerance', 'per_joint', 0.2,
         'largest position error during a goal of follow_joint_trajectory that states '
         'none, rad or m; infinite: any', positive=True, infinite=True, low=0.0),
    live('trajectory.goal_tolerance', 'per_joint', 0.05,
         'largest position error at the end of such a goal, rad or m; infinite: any',
         positive=True, infinite=True, low=0.0),
    live('simulation.stops', 'flag', False,
         'put rigid, inelastic stops at the position limits in '
         'simulations'),
    live('simulation.sticking', 'flag', False,
         'simulate exact Coulomb friction: joints stick below '
         'breakaway friction'),
    Spec('simulation.contacts', 'text', '',
         'path of a YAML file with contacts of points of the robot with surfaces, which '
         'simulations have; empty: none'),
    Spec('realtime.priority', 'count', 0,
         'real-time priority (SCHED_FIFO) of the threads that '
         'compute torques; 0: ordinary scheduling', low=0.0, high=99.0),
    Spec('realtime.cpus', 'numbers', [],
         'processors of the threads that compute torques; '
         'empty: all', low=0.0),
    Spec('realtime.lock_memory', 'flag', False, 'keep the memory of the process in RAM '
         '(mlockall), so that no torque waits for the disk'),
    Spec('realtime.keep_awake', 'flag', False,
         'keep idle processors of the computer awake '
         '(/dev/cpu_dma_latency), since a sleeping one wakes late; costs power'),
)
BY_NAME = {spec.name: spec for spec in SPECS}
# Numbers without a parameter, under the names with which the rooms read them.
CONSTANTS: dict[str, Any] = {
    'payload.max_distance': 2.0,  # m, of its center of mass from the frame
    'target.max_acceleration': 2.0,  # m/s^2
    'target.max_angular_acceleration': 8.0,  # rad/s^2
    'target.max_angle': 1.6,  # rad, of the target from the measured pose
    'target.max_distance': 0.5,  # m, of it from there
    'efforts.factor': 10.0,  # of the limit, above which a reported effort is dropped
    'observer.rate': 100.0,  # 1/s
    'joint_impedance.damping_ratio': np.array(0.7),  # of the arm on its springs
    'observer.friction.memory': 20.0,  # s, in which the friction follows the estimate
    'observer.confirm': 0.005,  # s above a threshold that confirm a collision
    'observer.release': 0.8,  # of the thresholds, below which it ends
    'observer.clear': 0.2,  # s below that, after which it ends
    'closure.tolerance': 0.02,  # rad or m, of further measured joints from the loops
    'closure.max_conditioning': 200.0,  # one over the distance from a singularity
    'cartesian.null_damping': 2.0,  # 1/s
    'cartesian.damping_ratio': 0.7,  # of the frame on its spring
    'walls.margin': np.zeros(0),  # 0.1 rad or m, at most 5 % of the range
    'walls.stiffness': np.zeros(0),  # the effort limit at the position limit
    'hand_guiding.damping': np.array(0.0),  # N m s/rad or N s/m
    'task_state.rate': 50.0,  # 1/s
    'state_check.noise': 0.01,  # rad or m: a jump of a position that is no fault
    'state_check.grace': 0.05,  # s, in which the last command goes on
    'state_check.stop_time': 0.25,  # s, in which `hold` brings the arm to rest
    'simulation.max_duration': 3600.0,  # s
    'simulation.max_steps': 1_000_000,
    'simulation.max_points': 2000,
    'simulation.max_waiting': 8,  # queued simulations
    'trajectory.max_points': 10_000,
    'trajectory.goal_time': 1.0,  # s, after a motion in which its goal must be reached
    'trajectory.stopped_speed': 0.05,  # rad/s or m/s, at the end of a goal
    'tf.timeout': 0.5,  # s
    'wrench.max_force': 0.0,  # what the effort limits hold
    'wrench.max_moment': 0.0,  # what the effort limits hold
    'wrench.rise_time': 0.5,  # s, from zero to the largest wrench
    'target.timeout': 0.5,  # s
    'imu.time_constant': 1.0,  # s, of the low-pass filter of the direction
    'cartesian.posture': np.zeros(0),  # the positions at which the mode begins
    'guard.damping': np.array(20.0),  # 1/s
    'simulation.integrator': AUTO,
}
