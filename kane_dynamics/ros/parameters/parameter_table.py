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
from kane_dynamics.mechanics.friction import DESIRED_SPEED, FEEDFORWARD
from kane_dynamics.mechanics.integrators import INTEGRATORS

LAW_MODES = (Mode.JOINT_IMPEDANCE, Mode.CARTESIAN_IMPEDANCE, Mode.HAND_GUIDING,
             Mode.ARM_COUPLING)
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
         'configure the node as soon as it has the URDF, then activate '
         'it as `activation` says', read_only=True),
    Spec('activation', 'text', 'simulated',
         'when a node with autostart activates itself: '
         'simulated: once only simulated robots subscribe to `commands`, or with '
         'use_sim_time; at_once: always; on_request: never',
         choices=('simulated', 'at_once', 'on_request'), read_only=True),
    Spec('bond', 'flag', False,
         'keep a bond with a lifecycle manager, as that of Nav2, while active: it notices '
         'when this node hangs or dies; needs the package bond'),
    Spec('robot_description', 'text', '', 'URDF as text; overrides `urdf` and the topic '
         'robot_description'),
    Spec('urdf', 'text', '', 'path of the URDF or xacro file; overrides the topic '
         'robot_description'),
    Spec('xacro_arguments', 'names', [],
         'arguments of the xacro file that `urdf` names, each as '
         'name:=value'),
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
    live('closure.tolerance', 'number', 0.02,
         'largest deviation of further measured joints from '
         'the closed loops, rad or m; beyond it a state is dropped', positive=True,
         low=0.0, high=1.0),
    live('closure.max_conditioning', 'number', 200.0,
         'largest conditioning figure of the closed '
         'loops, about one over the distance from a singular configuration in rad; '
         'beyond it a state is dropped', low=1.0, high=1e4),
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
    live('payload.max_distance', 'number', 2.0,
         'largest accepted distance of its center of mass '
         'from the frame, m', positive=True, low=0.0),
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
    Spec('imu.frame', 'text', '',
         'frame of the IMU, fixed to the base; empty: frame_id of its '
         'messages'),
    live('imu.time_constant', 'number', 1.0,
         'time constant of the low-pass filter of the '
         'direction, s; the direction is used after this time at rest', positive=True,
         low=0.0, high=3600.0),
    Spec('wrench.frames', 'names', [],
         'frames at which ~/wrench gives the wrench that the '
         'environment exerts on the robot; the torques of the modes inverse_dynamics and '
         'computed_torque compensate it; empty: none'),
    live('wrench.timeout', 'number', 0.1,
         'age, s, above which a wrench is stale and its frame '
         'unloaded', positive=True, low=0.0, high=3600.0),
    live('wrench.max_force', 'number', 0.0,
         'largest accepted component of a force, N; 0: the force that the effort limits '
         'hold in every configuration', low=0.0),
    live('wrench.max_moment', 'number', 0.0,
         'largest accepted component of a moment, N m; 0: the moment that the effort limits '
         'hold in every configuration', low=0.0),
    live('wrench.rise_time', 'number', 0.5,
         'shortest time, s, in which the wrench of ~/wrench or ~/target_wrench grows from '
         'zero to the largest accepted one; 0: at once', low=0.0, high=60.0),
    Spec('tf.enabled', 'flag', False,
         'find frames of wrenches, targets and the IMU that the URDF lacks by the transforms '
         'of /tf and /tf_static; needs the package tf2_msgs'),
    live('tf.timeout', 'number', 0.5,
         'age, s, above which a transform of /tf is stale, and messages in its frames are '
         'refused', positive=True, low=0.0, high=3600.0),
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
         'its damping, N m s/rad or N s/m; empty: by joint_impedance.damping_ratio',
         low=0.0),
    live('joint_impedance.damping_ratio', 'per_joint', 0.7,
         'damping ratio of the modes of the arm on these springs, at each state, if '
         'joint_impedance.damping is empty', low=0.0, high=10.0),
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
         'the controlled frame of mode cartesian_impedance, that of the planes of '
         'hand_guiding and of ~/task_state; empty: `tip`, or else the last link'),
    Spec('cartesian.axes', 'text', 'world',
         'axes of cartesian.stiffness: world, frame (those of the target), or a frame '
         'that is fixed to the world or to the body of cartesian.frame'),
    live('cartesian.stiffness', 'six', [600.0, 600.0, 600.0, 30.0, 30.0, 30.0],
         'mode cartesian_impedance: stiffness along and about the axes, N/m and N m/rad; '
         'not negative'),
    live('cartesian.damping_ratio', 'number', 0.7,
         'damping ratio of the frame on its spring, for the inertia at each state',
         low=0.0, high=10.0),
    live('cartesian.max_force', 'number', 60.0,
         'largest force of the spring, and of ~/target_wrench, N', positive=True,
         infinite=True, low=0.0),
    live('cartesian.max_moment', 'number', 12.0,
         'largest moment of the spring, and of ~/target_wrench, N m', positive=True,
         infinite=True, low=0.0),
    live('cartesian.posture', 'per_joint', [],
         'positions towards which joints are drawn where that does not move the frame, '
         'rad or m; empty: those at which the mode begins'),
    live('cartesian.posture_stiffness', 'per_joint', 5.0,
         'stiffness of that, N m/rad or N/m; 0: none', low=0.0),
    live('cartesian.null_damping', 'number', 2.0,
         'rate at which motion that does not move the frame decays, 1/s', low=0.0,
         high=1000.0),
    live('walls.margin', 'per_joint', [],
         'modes cartesian_impedance and hand_guiding: distance from the position limits at '
         'which soft walls begin, rad or m; empty: 0.1, at most 5 % of the range',
         positive=True, low=0.0),
    live('walls.stiffness', 'per_joint', [],
         'stiffness of the walls, N m/rad or N/m; 0: none; empty: the effort limit at the '
         'position limit', low=0.0),
    live('hand_guiding.friction', 'number', 0.8,
         'mode hand_guiding: fraction of the friction of the model and of '
         'observer.friction.* that is compensated',
         low=0.0, high=1.0),
    live('hand_guiding.damping', 'per_joint', 0.0,
         'further damping of the joints, N m s/rad or N s/m', low=0.0),
    live('hand_guiding.max_speed', 'per_joint', [],
         'speed of a joint above which it is braked, rad/s or m/s; empty: half of the '
         'limits of the URDF', positive=True, infinite=True, low=0.0),
    live('hand_guiding.max_frame_speed', 'number', math.inf,
         'speed of cartesian.frame above which the arm is braked, m/s', positive=True,
         infinite=True, low=0.0),
    live('hand_guiding.planes', 'floats', [],
         'soft walls: for each plane a normal of length 1 and a distance d, world axes, '
         'm; the origin of cartesian.frame stays where normal . position >= d. Their '
         'number is fixed'),
    live('hand_guiding.plane_stiffness', 'number', 2000.0,
         'stiffness of the planes, N/m', low=0.0),
    Spec('coupling.partner', 'text', '',
         'mode arm_coupling: topic of the other arm, the ~/coupling_state of its node'),
    live('coupling.engaged', 'flag', False,
         'whether the arm follows its partner, from the first state of it on; after a loss '
         'false, then true again'),
    Spec('coupling.stiffness', 'per_joint', [],
         'stiffness of the joints towards those of the partner, N m/rad or N/m; empty: '
         'twice the effort limit per rad or m, and at most 2500 1/s^2 times the inertia of '
         'the joint as for the damping', low=0.0),
    Spec('coupling.damping', 'per_joint', [],
         'damping, N m s/rad or N s/m; empty: damping ratio 0.7 for the inertia of each '
         'joint at zero positions, with the others free. A delay between the arms should '
         'be shorter than damping over stiffness', low=0.0),
    Spec('coupling.reflection', 'number', 0.8,
         "the part of the partner's external torque that is added", low=0.0, high=1.0),
    Spec('coupling.scale', 'per_joint', 1.0,
         'motion of a joint over that of the partner; negative: mirrored; not 0'),
    Spec('coupling.max_force', 'per_joint', [],
         'largest torque of the coupling beside that of the model, N m or N; empty: none',
         positive=True, infinite=True, low=0.0),
    Spec('coupling.max_speed', 'per_joint', [],
         'largest speed at which a joint follows, rad/s or m/s; empty: the limits of the '
         'URDF', positive=True, infinite=True, low=0.0),
    Spec('coupling.alone', 'text', 'hold',
         'what the arm does without its partner: hold its position, or yield freely',
         choices=('hold', 'free')),
    Spec('coupling.timeout', 'number', 0.1,
         "age of the partner's state, s, above which it is lost", positive=True, low=0.0,
         high=10.0),
    Spec('coupling.ramp', 'number', 0.5,
         'time, s, in which rates and torques of the partner fade in and out',
         positive=True, low=0.0, high=60.0),
    Spec('coupling.align_speed', 'number', 0.2,
         'speed at which the distance at engagement vanishes, rad/s or m/s; 0: it stays',
         low=0.0, high=100.0),
    Spec('coupling.observer_gain', 'per_joint', 100.0,
         'gain of the observer of the external torque that the partner receives, 1/s',
         positive=True, low=0.0),
    live('target.max_speed', 'number', 0.25,
         'largest speed of the target of mode cartesian_impedance, m/s', positive=True,
         low=0.0, high=100.0),
    live('target.max_angular_speed', 'number', 1.0,
         'largest angular speed of the target, rad/s', positive=True, low=0.0,
         high=100.0),
    live('target.max_acceleration', 'number', 2.0,
         'largest acceleration of the target, m/s^2', positive=True, low=0.0, high=1e4),
    live('target.max_angular_acceleration', 'number', 8.0,
         'largest angular acceleration of the target, rad/s^2', positive=True, low=0.0,
         high=1e4),
    live('target.max_distance', 'number', 0.5,
         'largest distance of ~/target_pose from the measured pose, m; ~/target_twist '
         'moves the target no farther from it', positive=True, infinite=True, low=0.0),
    live('target.max_angle', 'number', 1.6,
         'likewise, angle in rad', positive=True, infinite=True, low=0.0),
    live('target.timeout', 'number', 0.5,
         'age, s, above which a target message is stale; without a further one in this '
         'time a target that moves by ~/target_twist is held, and ~/target_wrench ends',
         positive=True, low=0.0, high=60.0),
    Spec('task_state.rate', 'number', 50.0,
         'rate of ~/task_state in the modes joint_impedance, cartesian_impedance, '
         'hand_guiding and arm_coupling, 1/s; 0: not published', low=0.0, high=1000.0),
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
         'docs/node.md lists); auto, native where that is possible, else python',
         choices=('python', 'native', 'auto')),
    Spec('stamped_commands', 'flag', False, 'also publish the commands as '
         'control_msgs/JointCommand on topic stamped_commands, with joint names and the '
         'stamp of the joint state; needs the package control_msgs with that message'),
    live('feedforward.tolerance', 'per_joint', [], 'largest error of the effort that is '
         'interpolated between the points of ~/trajectory_with_effort, N m or N; points '
         'are inserted where it is larger; empty: none are', positive=True,
         infinite=True, low=0.0),
    live('feedforward.clip', 'flag', False,
         'clamp the efforts of ~/trajectory_with_effort to '
         'their limits; false: reject a trajectory that exceeds them'),
    live('feedforward.rest', 'per_joint', [],
         'positions at which joints rest that ~/trajectory '
         'lacks, rad or m; empty: the measured ones'),
    Spec('feedforward.friction', 'text', DESIRED_SPEED,
         'friction that commands and ~/trajectory_with_effort compensate at rest and at '
         'reversals, where it may have any value of an interval: that of the desired '
         'speed; of the desired speed ahead, so that breakaway friction is there as a '
         'motion begins; none up to friction_speed of a joint', choices=FEEDFORWARD),
    Spec('feedforward.friction_lead', 'number', 0.0,
         'feedforward.friction ahead: the time ahead, s; 0: friction_speed of a joint '
         'over 1 rad/s^2', low=0.0, high=1.0),
    Spec('efforts.kind', 'text', 'motor_torque',
         'what the efforts of joint states are: the '
         'current of the motor; its torque, behind the gear; the torque of a sensor at '
         'the joint, which lacks friction and rotor; the torque of the environment',
         choices=tuple(EffortKind)),
    Spec('efforts.gravity', 'flag', True,
         'whether the weight of the arm is part of the efforts '
         'of joint states; if not, observer and estimator add the gravity of the model'),
    Spec('efforts.constants', 'per_joint', [],
         'torque on the joint per motor current, N m/A or N/A, gears included, negative '
         'where the motor turns the other way; for motor_current only'),
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
         'friction speed of that Coulomb '
         'friction, rad/s or m/s', positive=True, low=0.0),
    live('observer.friction.memory', 'number', 20.0,
         'time constant in which that friction '
         'follows the estimate while the arm moves, s; infinite: never', positive=True,
         infinite=True, low=0.0),
    live('observer.confirm', 'number', 0.005,
         'time above a threshold that confirms a collision, '
         's', low=0.0, high=10.0),
    live('observer.action', 'text', 'report',
         'what follows a collision beside ~/collision: report, nothing; stop: the desired '
         'motion ends in a stop of state_check.stop_time, and motions are refused until the '
         'collision ends', choices=('report', 'stop')),
    live('observer.release', 'number', 0.8,
         'fraction of the thresholds below which a collision '
         'ends', positive=True, low=0.0, high=1.0),
    live('observer.clear', 'number', 0.2,
         'time below it after which a collision ends, s', low=0.0, high=60.0),
    Spec('observer.frame', 'text', '',
         'frame of ~/external_wrench; empty: `tip`, or else the '
         'last link'),
    live('observer.rate', 'number', 100.0, 'largest rate of ~/external_torques and '
         '~/external_wrench, 1/s', low=1e-3, high=1e4),
    Spec('estimator.enabled', 'flag', False,
         'estimate the payload by recursive least squares and '
         'publish it; the torques do not use the estimate'),
    Spec('estimator.rate', 'number', 2.0, 'rate of ~/payload_estimate, 1/s', low=1e-3,
         high=100.0),
    Spec('estimator.memory', 'number', 20.0,
         'time in which the estimator forgets measurements '
         '(time constant), s', positive=True, low=0.0, high=1e5),
    Spec('estimator.torque_deviation', 'per_joint', [],
         'standard deviation of the torque '
         'residual of the model, N m or N; empty: 1 % of the effort limits',
         positive=True, low=0.0),
    Spec('watch.reference', 'text', '',
         'recording of the sound arm (CSV, npz or bag) in motion, with which the arm is '
         'compared while it works, without payload but that of the model; empty: no watch '
         'over the model'),
    Spec('watch.window', 'number', 30.0,
         'time in motion after which ~/model_watch says what has changed, s', low=2.0,
         high=60.0),
    Spec('watch.false_alarms', 'number', 1e-3,
         'share of the windows of a sound arm that may have an alarm', positive=True,
         low=0.0, high=0.4),
    Spec('explanation.rate', 'number', 0.0,
         'rate of ~/torque_by_source, 1/s; 0: not published', low=0.0, high=100.0),
    Spec('guard.enabled', 'flag', False,
         'work with torque_guard, which holds the arm when this '
         'node dies or hangs; the launch file sets it'),
    Spec('guard.lease', 'number', 0.012,
         'time without a command, s, after which torque_guard '
         'takes over; also the lease of liveliness of `commands` and ~/joint_torques',
         low=2e-3, high=10.0),
    live('guard.damping', 'per_joint', 20.0,
         'damping by torque_guard: the rate at which it slows '
         'a joint, 1/s; the torque is this times speed times inertia', low=0.0,
         high=1000.0),
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
    live('state_check.noise', 'number', 0.01,
         'jump of a position that is no fault, rad or m: '
         'noise and resolution of the sensor', positive=True, low=0.0, infinite=True),
    live('state_check.position_margin', 'number', 0.2,
         'distance, rad or m, by which a measured '
         'position may lie outside the position limits of its joint; beyond it the '
         'state is dropped, as it is for degrees; infinite: no such check', low=0.0,
         infinite=True),
    live('state_check.grace', 'number', 0.05,
         'time, s, in which the last command goes on while '
         'joint states are dropped as impossible; then state_check.action', low=0.0,
         high=10.0),
    live('state_check.action', 'text', 'zero',
         'torques after state_check.grace: zero, or hold: '
         'the arm is brought to rest by its model, without feedback, and then gravity is '
         'compensated there, until states are valid again or stop',
         choices=('zero', 'hold')),
    live('state_check.stop_time', 'number', 0.25,
         'time, s, in which hold brings the arm to rest; it moves by half of this time '
         'times its speed', low=0.01, high=10.0),
    live('diagnostics_rate', 'number', 1.0, 'rate of /diagnostics, 1/s', low=1e-3,
         high=100.0),
    live('trajectory.max_points', 'count', 10_000,
         'largest accepted number of points of a '
         'desired motion', low=1.0, high=1e6),
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
    live('trajectory.stopped_speed', 'number', 0.05,
         'largest speed of a joint at the end of such a goal, rad/s or m/s; infinite: '
         'any', positive=True, infinite=True, low=0.0),
    live('trajectory.goal_time', 'number', 1.0,
         'time after the end of its motion in which such a goal must be reached, s; '
         'infinite: any', low=0.0, infinite=True),
    live('simulation.max_duration', 'number', 3600.0,
         'largest accepted duration of a simulation, '
         's', positive=True, low=0.0),
    live('simulation.max_steps', 'count', 1_000_000,
         'largest accepted number of steps of a '
         'simulation', low=1.0, high=1e8),
    live('simulation.max_points', 'count', 2000,
         'largest number of points in a simulated '
         'trajectory; the torque path is blocked while thousands of points are '
         'converted', low=2.0,
         high=1e6),
    Spec('simulation.integrator', 'text', AUTO,
         'integrator of simulations; auto: rk4, or implicit where friction, springs or '
         'beams need shorter steps with rk4 than the requested one',
         choices=(AUTO, *INTEGRATORS)),
    live('simulation.stops', 'flag', False,
         'put rigid, inelastic stops at the position limits in '
         'simulations'),
    live('simulation.sticking', 'flag', False,
         'simulate exact Coulomb friction: joints stick below '
         'breakaway friction'),
    live('simulation.max_waiting', 'count', 8,
         'largest number of queued simulations; further '
         'requests are answered as busy', low=1.0, high=1000.0),
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
    Spec('realtime.collect_rarely', 'flag', False,
         'run the garbage collector of Python only when '
         'diagnostics are published, so that it delays no torque'),
)
BY_NAME = {spec.name: spec for spec in SPECS}
