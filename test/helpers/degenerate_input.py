"""
Degenerate but finite, and invalid, arguments for everything that users may call.

`valid_calls` has valid arguments for every public function, class and method. `variants`
replaces one of them by others. `outcome` says what is wrong with a call.
"""

from contextlib import contextmanager
from dataclasses import fields, is_dataclass
from functools import cache
import inspect
import re
import signal
import warnings

from kane_dynamics import (box, CollisionDetector, Controller, Drive, ElasticFeedforward,
                           FlexibleLink, FrictionError, HandGuiding, JointImpedance,
                           KaneError, load_urdf, LoopError,
                           LoopTracker, ModelBuilder, ModelWarning, MomentumObserver,
                           Motion, PoseFilter, PoseMotion, PosePath, QuasiStatic, Robot,
                           SmoothMotion, with_drives)
from kane_dynamics._util.resources import resource_path
from kane_dynamics.identification import (DriveRecording, Efforts, HeldPoses,
                                          PayloadEstimator, Recording, rows)
from kane_dynamics.optimal_control import TrajectoryOptimizer
from kinds_of_mechanism import case
import numpy as np
from public_surface import public_classes, public_functions, public_methods

PATIENCE = 20  # s, for one call
EXPECTED = re.compile('expected|Use |use ')  # an error says what is valid
# What users get as results, and what needs a browser, a bag or processes of its
# own.
RESULTS = frozenset((
    'CartesianMotion', 'FilledTrajectory', 'Trajectory',
    'closed_forms.Derivation', 'closed_forms.LinearForm',
    'feasibility.Demand', 'feasibility.PayloadBound', 'feasibility.TimeOptimal',
    'feasibility.TimeScale',
    'identification.BaseFit',
    'identification.BaseParameters', 'identification.CollisionCalibration',
    'identification.Excitation', 'identification.Identification',
    'identification.Payload', 'identification.PoseCalibration',
    'identification.RecordingFault', 'identification.TorqueDelays',
    'identification.DriveIdentification', 'optimal_control.OptimizedMotion',
    'sweep.Summary', 'PosePath', 'Model', 'identification.WatchReport',
    'Motion', 'SmoothMotion', 'Linearization'))
ELSEWHERE = frozenset((
    'identification.ModelWatch',  # of a calibrated recording: its own tests
    'view.Window', 'sweep.run_sweep', 'sweep.read_table',
    'identification.read_drive_recording', 'identification.read_recording',
    'identification.read_poses',
    'expand_xacro', 'load_mjcf', 'load_collision_shapes',
    'plot.plot_demand', 'plot.plot_energy', 'plot.plot_phase', 'plot.plot_reactions',
    'plot.plot_sweep', 'plot.plot_timing', 'plot.plot_torque_by_source',
    'plot.plot_tracking', 'plot.plot_trajectory', 'plot.plot_replay',
    'plot.plot_bending', 'plot.plot_vibrations'))
SLOW = frozenset(
    ('identification.excite', 'identification.identify', 'sweep.Sweep',
     'optimal_control.TrajectoryOptimizer', 'closed_forms.derivation',
     'feasibility.time_optimal', 'identification.diagnose', 'cartesian_motion',
     'identification.calibrate_collision', 'identification.calibrate_poses',
     'identification.torque_delays',
     'identification.identify_drives'))
# Methods without numbers, of processes and files, or of the tracer (`geometry`).
LEFT_OUT = frozenset((
    'Robot.casadi', 'Robot.torch', 'Robot.jax', 'Robot.export_c', 'Robot.compile',
    'Robot.compiled', 'Robot.verify', 'Robot.bind', 'Robot.copy',
    'Robot.operation_count', 'Robot.equals', 'Robot.neutral',
    'Robot.feasible_configuration', 'Robot.constraint_forces',
    'Robot.constraint_residual', 'Robot.constraint_velocity_residual',
    'Robot.generalized_force',
    'Robot.with_payload', 'Robot.derivative', 'Robot.jvp', 'Robot.vjp',
    'Robot.operational_space_inertia', 'Robot.operational_space_bias',
    # Called by loops that have checked their arrays.
    'Controller.torque', 'Controller.gravity_torque', 'Controller.motion_torque',
    'Controller.stopping_motion',
    'Controller.interrupted', 'Controller.predicted_state', 'LoopTracker.update_checked',
    'FrictionError.torque',
    'FrictionError.adapt', 'Motion.positions_at', 'Motion.velocities_at',
    'Motion.velocities_inside', 'CollisionDetector.update', 'MomentumObserver.hold',
    'QuasiStatic.require_drives', 'QuasiStatic.require_rigid_model', 'Model.path',
    'Model.prefixed', 'Model.renamed',
    'identification.Recording.rows', 'identification.Efforts.compile',
    'PosePath.section_limits'))
# Whose numbers are checked where a model or a problem is made of them; `identify`
# returns NaN for what a recording does not determine.
UNCHECKED = frozenset(('identification.identify', 'identification.identify_drives',
                       'Bending', 'Body', 'FlexibleLink', 'Frame', 'Joint', 'Limits',
                       'LinkShape', 'Torsion', 'optimal_control.CostWeights', 'Contact',
                       'PlaneSurface', 'SphereSurface', 'CylinderSurface'))


@cache
def elastic():
    """Return the arm with an elastic joint."""
    return Robot(with_drives(arm().model, {'joint1': Drive(100.0, rotor_inertia=0.1)}))


@cache
def arm():
    """Return an arm of two links with friction, and limits of everything."""
    model = load_urdf(resource_path('urdf', 'two_link.urdf'))
    return Robot(model, wrench_frames=['tip'])


@cache
def all_elastic():
    """Return the arm with two elastic joints."""
    drive = Drive(100.0, rotor_inertia=0.1)
    return Robot(with_drives(arm().model, {'joint1': drive, 'joint2': drive}))


@cache
def loop():
    """Return a four-bar linkage in the speed of its crank."""
    one = case('closed loop')
    options = {**one.robot.options, 'independent': ['crank'], 'actuated': ['crank'],
               'configuration': one.q, 'payload_frame': None}
    return Robot(one.robot.model, **options)


@cache
def beam():
    """Return an arm with a beam."""
    b = ModelBuilder('beam')
    b.beam('arm', 'world',
           FlexibleLink(1.0, 2.0, 80.0, (1, 0), up=(0, 0, 1), damping=0.02),
           axis=(0, -1, 0))
    return b.model()


@cache
def motion():
    """Return a motion of the arm."""
    return Motion.from_points([0.0, 1.0, 2.0], [[0.0, 0.1], [0.4, -0.3], [0.1, 0.2]],
                              joint_names=arm().joint_names)


@cache
def recording():
    """Return a recording of the arm."""
    t = np.linspace(0.0, 4.0, 201)
    q = np.column_stack([0.5 * np.sin(2.0 * t), 0.4 * np.sin(3.1 * t)])
    u = np.column_stack([np.cos(2.0 * t), 1.24 * np.cos(3.1 * t)])
    udot = np.column_stack([-2.0 * np.sin(2.0 * t), -3.844 * np.sin(3.1 * t)])
    return Recording(t, q, u, udot, arm().inverse_dynamics(q, u, udot))


@cache
def loaded_recording():
    """Return the recording of the arm with a payload at its tip."""
    heavy = Robot(arm().model, payload_frame='tip')
    heavy.parameters.payload = box(2.0, (0.1, 0.2, 0.1), at=(0.05, 0.02, 0.01))
    plain = recording()
    tau = heavy.inverse_dynamics(plain.q, plain.u, plain.udot)
    return Recording(plain.t, plain.q, plain.u, plain.udot, tau)


def held(model):
    """Return poses in which the arm is held, with the efforts of its weight."""
    q = np.random.default_rng(0).uniform(-1.0, 1.0, (12, 2))
    return HeldPoses(q, Robot(model).gravity_force(q), np.zeros((12, 2)))


def held_recording(model):
    """Return a recording of these poses, each held for a second."""
    poses = held(model)
    q, tau = (np.repeat(rows, 50, axis=0) for rows in (poses.q, poses.effort))
    rest = np.zeros_like(q)
    return Recording(np.arange(len(q)) * 0.02, q, rest, rest, tau)


@cache
def drive_recording():
    """Return a recording of both sides of elastic joints of the arm."""
    plain = recording()
    return DriveRecording(plain.t, plain.q + plain.tau / 1000.0, plain.q)


def pose(angle=0.3):
    """Return a pose."""
    c = np.cos(angle)
    s = np.sin(angle)
    return np.array([[c, -s, 0, 0.3], [s, c, 0, 0.2], [0, 0, 1, 0.1], [0, 0, 0, 1.0]])


@cache
def path():
    """Return a path of positions."""
    return PosePath.through([[0.3, 0.0, 0.1], [0.4, 0.2, 0.1], [0.3, 0.3, 0.2]],
                            blend=0.01)


Q, U, UDOT, TAU = np.array([[0.3, -0.4], [0.5, 0.2], [1.0, -0.7], [2.0, 1.0]])


def standard():
    """Return valid values of arguments by name, for calls that state no others."""
    return {
        'robot': arm(), 'model': arm().model, 'other': arm().model, 'motion': motion(),
        'recording': recording(), 'frame': 'tip', 'joint': 'joint1', 'name': 'new',
        'mass': 2.0, 'radius': 0.1, 'size': (0.1, 0.2, 0.3), 'at': (0.0, 0.1, 0.0),
        'axis': (0.0, 0.0, 1.0), 'direction': (0.0, 1.0, 0.0), 'rpy': (0.1, 0.2, 0.3),
        'quaternion': (0.0, 0.0, 0.6, 0.8), 'inertial': box(1.0, (0.1, 0.1, 0.1)),
        'q': Q, 'u': U, 'udot': UDOT, 'tau': TAU, 'q0': Q, 'u0': U, 'duration': 0.02,
        'joint_names': arm().joint_names, 'kp': 20.0, 'kd': 3.0, 'gain': 20.0,
        'pose': pose(), 'actual': pose(), 'desired': pose(0.4),
        'rotation': pose()[:3, :3],
        'vector': (0.1, 0.2, 0.3), 'twist': (0.1, 0.2, 0.3, 0.4, 0.5, 0.6),
        'position': (0.1, 0.2, 0.3), 'target': (0.5, 0.3, 0.0), 't': 0.1,
        'stiffness': 80.0, 'length': 1.0, 'density': 2.0, 'inertia': 0.02,
        'threshold': 3.0, 'times': [0.0, 0.5, 1.0], 'measured': ('crank',),
        'path': [[0.0, 0.1], [0.4, -0.3], [0.1, 0.2]], 'torque': (1.0, 2.0),
        'positions': [[0.0, 0.1], [0.4, -0.3], [0.1, 0.2]], 'first': 'tip',
        'second': 'base',
        'on': 'tip', 'source': resource_path('urdf', 'two_link.urdf'), 'damping': 0.5,
        'dt': 0.1, 'q1': Q + 0.1, 'wrench': np.array([[1.0, 2.0, 3.0, 0.1, 0.2, 0.3]]),
        'frames': ('tip',), 'external': (0.1, 0.2), 'moment': 0.1, 'effort': TAU,
        'rates': (0.5,), 'speed': 1.2, 'goal': pose(0.5), 'elapsed': 0.01, 's': 0.1,
        'cutoff': 5.0, 'q_d': Q + 0.1, 'translation': (0.1, 0.2, 0.3), 'prefix': 'left_',
        'new_name': str.upper, 'parameters': box(1.0, (0.1, 0.2, 0.3)).parameters,
        'parent': -1, 'pseudo': np.diag([0.1, 0.2, 0.3, 1.0]), 'confirm': 0.01,
        'release': 0.8, 'clear': 0.2,
        'max_gap': 0.1, 'chosen': slice(0, 3), 'linear': (1.0, 2.0, 20.0),
        'data': rows(arm().model, recording()), 'lowest': np.zeros(4)}


def smooth_motion():
    """Return a motion of the links that laws of elastic joints follow."""
    return SmoothMotion.from_points([0.0, 0.4], [[0.0, 0.0], [0.2, 0.1]],
                                    joint_names=('joint1', 'joint2'))


def stated():
    """Return valid arguments by the call's name, where the standard ones fail."""
    robot = arm()
    model = arm().model
    data = recording()
    return {
        'SphereSurface': {'center': (0, 0, -1)},
        'CylinderSurface': {'point': (0, 0, -1)},
        'rod': {'start': (0, 0, 0), 'end': (0.3, 0.1, 0)},
        'box': {'at': (0.1, 0.2, 0.3)},
        'frame_wrench': {'jacobian': robot.jacobian('tip', Q)},
        'with_beam': {'model': model, 'link': 'link1', 'beam': FlexibleLink(
            0.5, 2.0, 80.0, (1, 0), up=(0, 0, 1))},
        'with_drives': {'drives': {'joint1': Drive(100.0, rotor_inertia=0.1)}},
        'StiffnessCurve': {'deflection': (0.01, 0.03), 'torque': (1.0, 5.0),
                           'rounding': 1e-3},
        'Drive': {'stiffness': 100.0, 'friction': {'damping': 0.1}, 'motor': ''},
        'Drive.from_motor_side': {'stiffness': 100.0, 'friction': {'damping': 0.1}},
        'ElasticFeedforward': {'robot': elastic()}, 'SmoothMotion': {
            'times': np.array([0.0, 1.0]), 'coefficients': np.zeros((1, 8, 2))},
        'MotorSideControl': {'robot': elastic(), 'motion': smooth_motion()},
        'LinkSideControl': {'robot': all_elastic(), 'motion': smooth_motion()},
        'JointTorqueFeedback': {'robot': elastic()},
        'MotorTracking': {'feedforward': ElasticFeedforward(elastic()),
                          'motion': smooth_motion()},
        'with_rigid_joints': {'model': elastic().model},
        'with_locked': {'positions': {'joint1': 0.3}},
        'with_names': {'names': {'link1': 'a'}}, 'with_model': {'prefix': 'left_'},
        'load_constraints': {'source': {'constraints': {'pin': {
            'closure': {'first': 'a', 'second': 'b', 'axis': [0, 0, 1]}}}}},
        'load_contacts': {'source': {'contacts': {'tip': {
            'frame': 'tip', 'plane': {'normal': [0, 0, 1]}}}}},
        'fill_trajectory': {'times': [0.0, 0.5, 1.0], 'tolerance': 0.5, 'rest': None},
        'identification.base_parameters': {'speeds': np.full(2, 0.05), 'states': 40},
        'plot.check_path': {'path': 'a.png'},
        'Bending': {'tip_mass': 0.3}, 'Body': {'joint': arm().model.bodies[0].joint},
        'Joint': {'name': 'a', 'kind': 'revolute', 'axis': (0, 0, 1.0)},
        'Frame': {'body': 0, 'name': 'f'}, 'Closure': {'first': 'tip', 'second': 'base'},
        'Coupling': {'ratios': {'joint2': 2.0}},
        'DependentSpeeds': {'dependent': ['joint2'],
                            'A': lambda q, t: np.array([[2.0]])},
        'Prescribed': {'position': lambda t: 0.1 * t}, 'PointVelocity': {},
        'Speeds': {'Y': lambda q, t: np.eye(2), 'Z': None, 'names': None},
        'Terms': {}, 'Torsion': {'stiffness': 30.0}, 'Limits': {
            'lower': -1.0, 'upper': 1.0, 'velocity': 2.0, 'effort': 3.0},
        'LinkShape': {'link': 'link1', 'kind': 'box'},
        'LoopTracker': {'robot': loop()}, 'Motion': {
            'times': motion().times, 'positions': motion().positions,
            'coefficients': motion().coefficients},
        'JointImpedance': {'damping': 4.0, 'followed': None},
        'CartesianImpedance': {'stiffness': [100.0] * 6, 'damping': None},
        'HybridForce': {'force_directions': ('x',), 'stiffness': [100.0] * 6},
        'cartesian_motion': {'robot': robot, 'path': path(), 'duration': 2.0,
                             'q': (0.3, 1.0)},
        'PoseFilter': {'linear_speed': 1.0, 'angular_speed': 1.0,
                       'linear_acceleration': 2.0, 'angular_acceleration': 2.0},
        'PoseLimits': {'linear': (1.0, 2.0, 20.0)}, 'PoseMotion': {
            'path': path(), 'duration': 2.0}, 'Robot': {'wrench_frames': ['tip']},
        'Inertial': {'com': (0.1, 0, 0), 'inertia': np.diag([0.1, 0.1, 0.1])},
        'FlexibleLink': {'up': (0, 0, 1), 'modes': (1, 0), 'stiffness': 80.0},
        'FrictionError': {'coulomb': 0.1},
        'identification.identify_payload': {'recording': loaded_recording()},
        'identification.calibrate_poses': {'poses': held(model)},
        'identification.HeldPoses': {'q': held(model).q, 'effort': held(model).effort,
                                     'approach': np.zeros((12, 2))},
        'identification.held_poses': {'recording': held_recording(model)},
        'identification.Efforts': {},
        'identification.PayloadEstimator': {'sigma': (0.1, 0.2)},
        'identification.Recording': {name: getattr(data, name)
                                     for name in ('t', 'q', 'u', 'udot', 'tau')},
        'identification.DriveRecording': {name: getattr(drive_recording(), name)
                                          for name in ('t', 'theta', 'q')},
        'identification.DriveRecording.from_motor_side': {
            't': drive_recording().t, 'theta': drive_recording().theta, 'ratio': 1.0,
            'q': drive_recording().q},
        'identification.identify_drives': {'recording': drive_recording()},
        'optimal_control.PredictiveController': {'optimizer': optimizer()},
        'sweep.Sweep': {'samples': 2}, 'QuasiStatic': {'robot': Robot(beam())},
        'inverse_kinematics': {'target': (0.5, 0.3, 0.0), 'starts': 2},
        'identification.excite': {'duration': 4.0, 'harmonics': 2, 'starts': 1},
        'identification.friction_motion': {'loads': 2, 'distance': None},
        'closed_forms.derivation': {}, 'ModelBuilder': {'name': 'a'},
        'simulate': {'duration': 0.01, 'torque': (1.0, 2.0)},
        'feasibility.time_optimal': {'acceleration': 5.0},
        'feasibility.largest_payload': {'robot': Robot(model, payload_frame='tip')},
        'natural_vibration': {'robot': Robot(beam()), 'q': np.zeros(2)},
        'LoopTracker.update': {'measured': (0.8,)}, 'Controller.command': {'u': U},
        'ComputedTorque': {'motion': motion()}, 'Model.frame': {'name': 'tip'},
        'PosePath.through': {'poses': [[0.3, 0, 0], [0.4, 0.1, 0.2]]},
        'PosePath.arc': {'start': (0.3, 0, 0), 'via': (0.4, 0.1, 0),
                         'end': (0.3, 0.2, 0)},
        'PosePath.circle': {'start': (0.3, 0, 0), 'center': (0.2, 0, 0),
                            'axis': (0, 0, 1.0)},
        'PosePath.joined': {'paths': [path()]}, 'Recording.rows': {},
        'QuasiStatic.configuration': {'q': (0.2,)},
        'QuasiStatic.gravity_force': {'q': (0.2,)},
        'QuasiStatic.feedforward_change': {'q': (0.2,), 'u': (0.1,), 'udot': (0.3,)},
        'QuasiStatic.inverse_dynamics': {'q': (0.2,), 'u': (0.1,), 'udot': (0.3,)},
        'QuasiStatic.modes': {'q': (0.2,), 'u': (0.1,), 'udot': (0.3,)},
        'QuasiStatic.torque_terms': {'q': (0.2,), 'u': (0.1,), 'udot': (0.3,)},
        'stiffened': {'model': beam()}, 'body_angular_velocity': {'frame': 'link1'}}


@cache
def optimizer():
    """Return a small problem of optimal control."""
    return TrajectoryOptimizer(arm(), nodes=4, interval=0.05)


def objects():
    """Return objects whose methods are called, by the name of their class."""
    robot = arm()
    observer = MomentumObserver(robot, gain=20.0)
    return {
        'Robot': robot, 'Motion': motion(), 'Inertial': box(1.0, (0.1, 0.2, 0.3)),
        'Model': robot.model,
        'CollisionDetector': CollisionDetector(robot.joint_names, 3.0),
        'Controller': Controller(robot, kp=20.0, kd=3.0),
        'FrictionError': FrictionError(robot.joint_names, coulomb=0.1),
        'MomentumObserver': observer, 'HandGuiding': HandGuiding(robot),
        'JointImpedance': JointImpedance(robot, stiffness=10.0, damping=1.0),
        'LoopTracker': LoopTracker(loop(), ('crank',)), 'PoseMotion': PoseMotion(
            path(), duration=2.0),
        'PoseFilter': PoseFilter(linear_speed=1.0, angular_speed=1.0,
                                 linear_acceleration=2.0, angular_acceleration=2.0),
        'PosePath': path(), 'identification.Efforts': Efforts('joint_torque'),
        'identification.Recording': recording(),
        'identification.DriveRecording': drive_recording(),
        'identification.PayloadEstimator': PayloadEstimator(robot, 'tip', (0.1, 0.2)),
        'QuasiStatic': QuasiStatic(Robot(beam()))}


class Call:
    """A public call with valid arguments."""

    def __init__(self, name, function, signature, arguments):
        self.name = name
        self.function = function
        self.signature = signature
        self.arguments = arguments

    def __call__(self, **changes):
        """Call the function with some arguments replaced."""
        positional = []
        named = {}
        for parameter in self.signature:
            if parameter.name not in self.arguments | changes:
                continue
            value = (self.arguments | changes)[parameter.name]
            if parameter.kind is parameter.VAR_POSITIONAL:
                positional += value
            elif parameter.kind is parameter.POSITIONAL_ONLY:
                positional.append(value)
            else:
                named[parameter.name] = value
        return self.function(*positional, **named)


def valid_calls():
    """Return public calls with valid arguments, and the names of those without any."""
    calls = []
    unknown = []
    named = stated()
    common = standard()
    targets = [(name, call, inspect.signature(call)) for name, call in (
        public_functions() | public_classes()).items()
               if name not in RESULTS | ELSEWHERE]
    for owner, value in objects().items():
        for method in public_methods(type(value)):
            name = f'{owner}.{method}'
            if name not in LEFT_OUT:
                stated_by = inspect.getattr_static(type(value), method)
                bound = getattr(value, method)
                plain = getattr(type(value), method)
                parameters = list(inspect.signature(plain).parameters.values())
                if not isinstance(stated_by, (classmethod, staticmethod)):
                    parameters = parameters[1:]
                targets.append((name, bound, inspect.Signature(parameters)))
    for name, function, signature in targets:
        arguments = {}
        for parameter in signature.parameters.values():
            if parameter.name in named.get(name, {}):
                arguments[parameter.name] = named[name][parameter.name]
            elif parameter.kind in (parameter.VAR_POSITIONAL, parameter.VAR_KEYWORD):
                continue
            elif parameter.default is parameter.empty:
                if parameter.name not in common:
                    unknown.append(f'{name}: {parameter.name}')
                    break
                arguments[parameter.name] = common[parameter.name]
            elif _is_number(parameter.default) or _is_row(parameter.default):
                arguments[parameter.name] = parameter.default
        else:
            calls.append(
                Call(name, function, list(signature.parameters.values()), arguments))
    return calls, unknown


def _is_number(value):
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def _is_row(value):
    if isinstance(value, np.ndarray):
        return value.dtype.kind in 'if'
    return (isinstance(value, (tuple, list)) and len(value) > 0
            and np.asarray(value, dtype=object).dtype.kind in 'Oif'
            and all(_is_number(x) or _is_row(x) for x in value))


def same(value):
    """Return the same numbers in other forms, by name."""
    if isinstance(value, int):
        return {'numpy integer': np.int64(value)}
    if _is_number(value):
        return {'0-d array': np.array(value), 'numpy scalar': np.float64(value)}
    if not _is_row(value):
        return {}
    array = np.array(value, dtype=float)
    spread = np.zeros((*array.shape[:-1], 2 * array.shape[-1]))
    spread[..., ::2] = array
    frozen = array.copy()
    frozen.flags.writeable = False
    return {'list': array.tolist(), 'array': array,
            'Fortran order': np.asfortranarray(array),
            'not contiguous': spread[..., ::2], 'read-only': frozen,
            'reversed twice': array[..., ::-1].copy()[..., ::-1]}


def other(value):
    """Return degenerate and invalid values in the place of a valid one, by name."""
    if isinstance(value, bool):
        return {'None': None, '2': 2, 'text': 'yes'}
    if _is_number(value):
        return {'zero': 0.0, 'negative': -1.0, 'tiny': 1e-300, 'huge': 1e300,
                '1e18': 1e18,
                'NaN': np.nan, 'infinite': np.inf, 'text': 'a', 'complex': 1j,
                'list': [value, value], 'empty': [], 'mapping': {}}
    if _is_row(value):
        array = np.array(value, dtype=float)
        single = array[..., :1]
        return {'zeros': np.zeros_like(array), 'tiny': np.full_like(array, 1e-300),
                'huge': np.full_like(array, 1e300), '1e18': np.full_like(array, 1e18),
                'equal': np.full_like(array, 0.25), 'NaN': np.full_like(array, np.nan),
                'infinite': np.full_like(array, np.inf), 'empty': [], 'one': single,
                'longer': np.concatenate([array, single], axis=-1),
                'no rows': np.zeros((0, *array.shape)), 'one row': array[None],
                'two axes more': array[None, None],
                'integers': np.ones_like(array, dtype=int),
                'float32': array.astype(np.float32), 'complex': array + 1j,
                'objects': array.astype(object), 'ragged': [[1.0], [1.0, 2.0]],
                'text': 'abc', 'texts': ['a'] * len(array), 'truth values': array > 0.0,
                'number': 1.0, 'mapping': {}, 'a function': len}
    if isinstance(value, str):
        return {'empty': '', 'unknown': 'nonsense', 'number': 3, 'bytes': b'a',
                'list': ['a']}
    if isinstance(value, (tuple, list)):
        return {'empty': [], 'twice': [*value, *value], 'numbers': [1, 2], 'text': 'abc',
                'None': None, 'unknown': ['nonsense'], 'number': 3}
    if callable(value) and not isinstance(value, type):
        return {'number': 3, 'text': 'a', 'no arguments': lambda: 0.0,
                'NaN': lambda *_: np.nan, 'None': lambda *_: None,
                'text of it': lambda *_: 'a'}
    return {'None': None, 'number': 3, 'text': 'abc', 'array': np.zeros(3),
            'class': type(value)}


@contextmanager
def patience():
    """Raise TimeoutError in a block that takes longer than `PATIENCE`."""
    def late(*_):
        raise TimeoutError(f'longer than {PATIENCE} s')
    former_handler = signal.signal(signal.SIGALRM, late)
    signal.alarm(PATIENCE)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, former_handler)


def attempted(call, **changes):
    """Return the result of a call, or the error with which it is refused."""
    with patience(), warnings.catch_warnings():
        warnings.simplefilter('error')
        warnings.simplefilter('ignore', ModelWarning)
        try:
            return call(**changes)
        except KaneError as error:
            return error


def numbers_in(value, depth=3):
    """Yield the arrays of numbers in a result: of records and sequences too."""
    if isinstance(value, (float, np.floating, np.ndarray)):
        array = np.asarray(value)
        if array.dtype.kind == 'f':
            yield array
    elif depth and is_dataclass(value) and not isinstance(value, type):
        for field in fields(value):
            yield from numbers_in(getattr(value, field.name, None), depth - 1)
    elif depth and isinstance(value, (tuple, list)):
        for x in value:
            yield from numbers_in(x, depth - 1)


def fault(call, **changes):
    """Return what is wrong with a call; '' if it gives numbers or a clear error."""
    try:
        result = attempted(call, **changes)
    except Exception as error:
        return f'{type(error).__name__}: {str(error)[:150]}'
    if isinstance(result, LoopError):  # of a valid state that the loop does not reach
        return ''
    if isinstance(result, KaneError):
        return '' if EXPECTED.search(
            str(result)) else f'unexplained: {str(result)[:150]}'
    if call.name not in UNCHECKED and any(
            np.isnan(array).any() for array in numbers_in(result)):
        return 'NaN in the result'
    return ''


def differs(result, expected):
    """Return whether two results have different numbers."""
    first = list(numbers_in(result))
    second = list(numbers_in(expected))
    if type(result) is not type(expected) or len(first) != len(second):
        return True
    return any(x.shape != y.shape
               or not np.allclose(x, y, rtol=1e-12, atol=1e-14, equal_nan=True)
               for x, y in zip(first, second))
