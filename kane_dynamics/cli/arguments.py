"""Arguments of the subcommands; modules that only one of them needs are imported for it."""

from argparse import ArgumentParser, ArgumentTypeError
from collections.abc import Callable
import math
from typing import Any

KINDS = ('trajectory', 'torque-by-source', 'energy', 'reactions', 'phase')  # of pictures
WITHIN = 'zeros, or the middle of limits that exclude 0'
STEP = 0.01  # s, between samples of a motion given by points


def _torque(sub: ArgumentParser) -> None:
    _add_model(sub)
    _add_constraints(sub)
    # A single state; a motion takes its place.
    for name, text, default in (('q', 'positions, rad or m', WITHIN),
                                ('u', 'speeds', 'zeros'),
                                ('udot', 'accelerations', 'zeros')):
        sub.add_argument(f'--{name}', nargs='+', metavar='X',
                         help=f'{text} (default: {default})')
    _add_motion(sub, 'CSV or YAML file; prints the torques of every row')
    sub.add_argument('--step', type=float, metavar='S', help='time between samples of '
                     f'the motion (default: {STEP:g} between points of a YAML file; '
                     'rows of a CSV file)')
    sub.add_argument('-o', '--out', metavar='CSV',
                     help='write the torques of the motion to this file')
    add_plot(sub, 'torque-by-source',
             *(kind for kind in KINDS if kind != 'torque-by-source'))


def _simulate(sub: ArgumentParser) -> None:
    from kane_dynamics.mechanics.integrators import INTEGRATORS
    _add_model(sub)
    _add_constraints(sub)
    sub.add_argument('--q0', nargs='+', metavar='X',
                     help='initial positions (default: those of the motion, else '
                          f'{WITHIN})')
    sub.add_argument('--u0', nargs='+', metavar='X',
                     help='initial speeds (default: those of the motion, else zeros)')
    sub.add_argument('--duration', type=float, metavar='S',
                     help='simulated time in s (default: that of the motion, else 1)')
    sub.add_argument('--step', type=float, default=1e-3, metavar='S',
                     help='integration step in s; default: 0.001')
    sub.add_argument('--integrator', choices=INTEGRATORS,
                     help='implicit: for stiff friction, springs and beams (default: '
                     'rk4 where the step is stable, else implicit)')
    sub.add_argument('--stops', action='store_true',
                     help='joints hit rigid, inelastic stops at their position limits')
    sub.add_argument('--sticking', action='store_true',
                     help='joints stick below breakaway friction (exact Coulomb friction)')
    sub.add_argument('--contacts', metavar='YAML',
                     help='rigid contacts of points with surfaces, with friction')
    # What drives the motion: one of these at most.
    source = sub.add_mutually_exclusive_group()
    _add_motion(source, 'CSV or YAML file; followed by computed torque')
    source.add_argument('--torque', nargs='+', metavar='X',
                        help='constant torques, or a CSV file')
    # Gains of computed torque, which only --motion has.
    sub.add_argument('--kp', type=float, nargs='+', default=[100.0], metavar='X',
                     help='for --motion, one value or one per joint, 1/s^2; default: '
                          '100')
    sub.add_argument('--kd', type=float, nargs='+', default=[20.0], metavar='X',
                     help='for --motion, one value or one per joint, 1/s; default: 20')
    sub.add_argument('-o', '--out', metavar='FILE',
                     help='.npz or .csv file for the trajectory')
    add_plot(sub, *KINDS, 'tracking')


def _sweep(sub: ArgumentParser) -> None:
    sub.add_argument('sweep', metavar='YAML', help='description of the sweep; see below')
    sub.add_argument('-o', '--out', required=True, metavar='FOLDER',
                     help='folder of the parquet files: new, or that of this sweep')
    sub.add_argument('--workers', type=int, metavar='N',
                     help='processes (default: all cores)')
    add_plot(sub, 'torques and errors over the values that vary')
    _add_output(sub)


def _inspect(sub: ArgumentParser) -> None:
    _add_model(sub)
    _add_constraints(sub)
    sub.add_argument('--against', choices=['pinocchio'],
                     help='compare inverse dynamics at random states')
    sub.add_argument('--frames', action='store_true', help='also print the frames: the '
                     'body that carries each, and its pose there')
    sub.add_argument('--operations', action='store_true',
                     help='also print the operation count of each compiled function')


def _export(sub: ArgumentParser) -> None:
    # Modules of options are imported by the command that has them, so that others start
    # fast.
    from kane_dynamics.robot.export_c import DEFAULT_KERNELS
    _add_model(sub)
    _add_constraints(sub)
    sub.add_argument('-o', '--out', required=True, metavar='FILE.c',
                     help='C source; the header is written beside it')
    sub.add_argument('--kernel', nargs='+', default=DEFAULT_KERNELS, metavar='NAME',
                     help='functions to export, also frame_pose:LINK, jacobian:LINK; '
                          'default: '
                          + ' '.join(DEFAULT_KERNELS))
    sub.add_argument('--float32', action='store_true', help='single precision')
    sub.add_argument('--no-self-test', action='store_true', help='export no self-test')
    sub.add_argument('--wrench-frames', nargs='+', default=(), metavar='LINK',
                     help='links on which external wrenches act')
    sub.add_argument('--payload-frame', metavar='LINK',
                     help='link that carries a payload')


def _equations(sub: ArgumentParser) -> None:
    _add_model(sub)
    _add_constraints(sub)
    sub.add_argument('--numbers', action='store_true',
                     help='use numbers instead of symbols for the parameters')
    sub.add_argument('--axes', default='own', metavar='FRAME',
                     help="axes of vectors: 'own' of each body (default), 'world', or a "
                     'frame')
    sub.add_argument('--points', nargs='+', default=(), metavar='FRAME',
                     help='frames whose origins are in the tables of velocities')
    sub.add_argument('--auxiliary', nargs='+', default=(), metavar='FORCE',
                     help='constraint forces to derive: constraint rows, or '
                     'JOINT:DIRECTION with x, y, z, rx, ry or rz')
    sub.add_argument('--energy', action='store_true',
                     help='derive inertia forces by variations of vectors, too')
    form = sub.add_mutually_exclusive_group()
    for name in ('latex', 'markdown', 'c', 'python'):
        form.add_argument(f'--{name}', dest='format', action='store_const', const=name)
    sub.set_defaults(format='text')
    sub.add_argument('-o', '--out', metavar='FILE',
                     help='write to this file instead of printing')


def _add_efforts(sub: ArgumentParser) -> None:
    """Add the options that state what efforts are."""
    from kane_dynamics.analysis.known_arms import EffortKind
    sub.add_argument('--efforts', choices=[str(kind) for kind in EffortKind],
                     metavar='KIND',
                     help='what the efforts are: motor_current, motor_torque (default), '
                     'joint_torque of a sensor, external_torque')
    sub.add_argument('--efforts-without-gravity', action='store_true',
                     help='the weight of the arm is no part of the efforts')
    sub.add_argument('--torque-constants', type=float, nargs='+', metavar='C',
                     help='torque on the joint per current, one or one per joint, N '
                     'm/A, negative where the motor turns the other way; with --efforts '
                     'motor_current')


def _identify(sub: ArgumentParser) -> None:
    from kane_dynamics.identification.friction_laws import LAW_NAMES
    from kane_dynamics.identification.recordings.recording import STANDSTILL
    _add_model(sub, friction=False)
    _add_constraints(sub)
    _add_recording(sub)
    _add_efforts(sub)
    # Options of the fit of the whole model.
    sub.add_argument('--as-recorded', action='store_true',
                     help='also fit a recording that contradicts the model')
    sub.add_argument('--friction-only', action='store_true',
                     help='identify friction and armature only')
    sub.add_argument('--friction', choices=('select', *LAW_NAMES), default='select',
                     help='law of friction of all joints; default: the simplest one whose '
                          'error on rows that fits leave out is the least within its noise '
                          '(coulomb with --friction-only)')
    sub.add_argument('--without-effort', nargs='+', metavar='JOINT',
                     help='leave out the efforts of these joints, such as of dead sensors')
    sub.add_argument('--coupled', nargs=2, action='append', metavar='JOINT',
                     help='a motor turns with the sum or difference of these two joints, as '
                          'of some wrists; may be given several times')
    sub.add_argument('--test', metavar='RECORDING',
                     help='judge the fit on this recording; default: a fit to the first '
                          'half on the second')
    sub.add_argument('--unbounded', action='store_true',
                     help='with --friction-only: plain least squares, whose friction '
                          'may be negative where the inertial parameters are wrong')
    sub.add_argument('--standstill', type=float, default=STANDSTILL, metavar='SPEED',
                     help='ignore rows in which a joint is slower; rad/s or m/s; '
                     'default: %(default)g')
    sub.add_argument('--weight', type=float, metavar='W',
                     help="weight of the URDF's inertials as prior; default: the one with "
                          'the least error on rows that fits leave out')
    sub.add_argument('--base-parameters', action='store_true',
                     help='print the base parameters: the combinations that torques determine')
    # Other kinds of fits, each with options of its own.
    sub.add_argument('--payload', metavar='LINK',
                     help='identify the payload of this link; the arm is known')
    sub.add_argument('--drives', action='store_true',
                     help='identify stiffness, damping and rotor inertia of elastic '
                          'joints; columns theta.<joint> of the motors, and q.<joint>, '
                          'motor_torque.<joint>, gear_torque.<joint> as far as measured')
    sub.add_argument('--ratio', type=float, nargs='+', metavar='R',
                     help='with --drives: motor revolutions per joint revolution, one '
                          'or one per joint; default: motor values are joint-side')
    sub.add_argument('--skew', type=float, metavar='S',
                     help='with --drives: how late the positions of the links are after '
                          'those of the motors, s; default: identified')
    sub.add_argument('-o', '--out', metavar='FILE',
                     help='write the identified model: a URDF, or MJCF with the ending .xml; '
                          'with --payload or --drives a supplement')
    sub.add_argument('--report', metavar='FILE',
                     help='write what is printed, with the picture of --plot, as Markdown')
    add_plot(sub, 'measured torques, those of the identified model and of the given one')


def _length_or_none(text: str) -> float | None:
    """Return a number, or None for 'none'."""
    try:
        return None if text == 'none' else float(text)
    except ValueError:
        raise ArgumentTypeError(f"'{text}'; expected a number of m, or none") from None


def _excite(sub: ArgumentParser) -> None:
    _add_model(sub, friction=False)
    sub.add_argument('-o', '--out', metavar='CSV', required=True,
                     help='write the motion')
    # Options of motions of harmonics; slow reversals have those after `--friction`.
    for name, kind, default, text in (
            ('duration', float, 10.0, 'duration in s'),
            ('periods', int, 1,
             'number of equal periods in the duration'),
            ('harmonics', int, 5,
             'number of harmonics of each joint'),
            ('share', float, 0.9, 'fraction of the limits to use'),
            ('seed', int, 0, 'seed of the random initial motions'),
            ('starts', int, 2, 'number of initial motions'),
            ('rate', float, 100.0, 'rows per second')):
        sub.add_argument(f'--{name}', type=kind, default=default, metavar='X',
                         help=f'{text}; default: %(default)s')
    # Limits beside those of the model.
    for name, unit in (('velocity', 'rad/s or m/s'),
                       ('acceleration', 'rad/s^2 or m/s^2')):
        sub.add_argument(f'--{name}', type=float, nargs='+',
                         default=[math.inf], metavar='X',
                         help=f'further limit, one value or one per joint, {unit}')
    sub.add_argument('--friction', action='store_true',
                     help='slow reversals under several loads, to identify friction with '
                          'known inertias; of the options above it takes --share, --seed '
                          'and --rate')
    sub.add_argument('--loads', type=int, metavar='N',
                     help='with --friction: number of configurations with different '
                          'loads; default: 3')
    sub.add_argument('--floor', type=_length_or_none, default=0.0, metavar='X',
                     help='lowest height of any link, m, or none; default: %(default)g')
    sub.add_argument('--distance', type=_length_or_none, metavar='X',
                     help='smallest distance between links, m, or none; default: 0.05, '
                          'or less for links that are near each other at rest')


def _replay(sub: ArgumentParser) -> None:
    _add_model(sub)
    _add_recording(sub)
    _add_efforts(sub)
    sub.add_argument('--reference', nargs='+', metavar='RECORDING',
                     help='recording of the sound arm with the same payload: name what has '
                          'changed since; several ones, as of other days, state by how much '
                          'a sound arm changes')
    sub.add_argument('--smallest', type=float, metavar='SHARE',
                     help='with --reference: smallest torque of a change that is an alarm, '
                          "relative to a joint's friction and the error of the model; "
                          'default: 1.5 times the largest change between references, 0.42 '
                          'with one')
    sub.add_argument('-o', '--out', metavar='CSV',
                     help='write the motion and its torques')
    add_plot(sub, 'measured and computed torques')


def _calibrate(sub: ArgumentParser) -> None:
    from kane_dynamics.identification.collision_calibration import DRIFT, MARGIN
    _add_model(sub)
    _add_constraints(sub)
    sub.add_argument('recording', metavar='POSES', nargs='?',
                     help='table of held poses without times, or a recording or ROS 2 '
                     'bag of an arm that is held in poses; with --collision a recording '
                     'of motion without contact, unfiltered')
    sub.add_argument('--live', type=int, metavar='N',
                     help='lead the running arm through N proposed poses and record how '
                     'it holds them; from both sides where friction matters')
    sub.add_argument('--move', metavar='TOPIC',
                     help='with --live: let the controller that takes JointTrajectory on '
                     'TOPIC reach the poses; default: a person does, by hand')
    sub.add_argument('--floor', type=_length_or_none, default=0.0, metavar='X',
                     help='with --live: lowest height of any link, m, or none; default: '
                     '%(default)g')
    sub.add_argument('--save', metavar='CSV', help='with --live: only write the poses as a '
                     'table, for example those with a load, for --loaded')
    sub.add_argument('--loaded', metavar='POSES',
                     help='the same of poses in which the arm carries a known load')
    sub.add_argument('--load', metavar='FRAME', help='frame that carries the load')
    sub.add_argument('--load-mass', type=float, default=0.0, metavar='M',
                     help='mass of the load, kg')
    sub.add_argument('--load-com', type=float, nargs=3, default=[0.0, 0.0, 0.0],
                     metavar=('X', 'Y', 'Z'), help='center of mass of the load in the axes '
                     'of the frame, m; default: its origin')
    sub.add_argument('--collision', action='store_true',
                     help='thresholds of collision detection instead of gravity')
    sub.add_argument('--topic',
                     help='topic of joint states: in a bag (default: the only one), or '
                     'with --live (default: joint_states)')
    _add_efforts(sub)
    sub.add_argument('--commands', action='store_true', help='the torques are commands '
                     'that act until the next row (default: they are measured)')
    for name, default, text in (
            ('gain', 50.0, 'of the observer, 1/s'),
            ('margin', MARGIN, 'threshold over the largest error, at least 1.25'),
            ('drift', DRIFT, 'relative change of friction that raises no alarm')):
        sub.add_argument(f'--{name}', type=float, default=default, metavar='X',
                         help=f'{text}; default: %(default)g')
    sub.add_argument('-o', '--out', metavar='YAML',
                     help='write a supplement and a parameter file that loads it '
                     '(NAME.node.yaml); with --collision a parameter file')
    # The calibration needs unfiltered torques, so that the recording is read as it is.
    sub.set_defaults(derive_speeds=False, cutoff=None, resample=None)


def _feasible(sub: ArgumentParser) -> None:
    from kane_dynamics.feasibility.samples import STEP as FINE
    _add_model(sub)
    _add_constraints(sub)
    _add_motion(sub, 'CSV or YAML file', required=True)
    sub.add_argument('--speed', type=float, default=1.0, metavar='S',
                     help='check the motion at S times its speed; default: %(default)g')
    sub.add_argument('--power', type=float, nargs='+', default=[math.inf], metavar='W',
                     help='largest mechanical power, one value or one per joint '
                          '(default: none)')
    # Further questions about the same motion.
    sub.add_argument('--time-optimal', action='store_true',
                     help='compute the fastest timing of the path of the motion')
    for name, what, unit in (('acceleration', 'acceleration', 'rad/s^2 or m/s^2'),
                             ('jerk', 'jerk', 'rad/s^3 or m/s^3'),
                             ('torque-rate', 'torque rate (without Coulomb friction)',
                              'N m/s')):
        sub.add_argument(f'--{name}', type=float, nargs='+', default=[math.inf],
                         metavar='L',
                         help=f'largest {what} with --time-optimal, one value or one '
                         f'per joint, {unit} (default: none)')
    sub.add_argument('--payload-frame', metavar='LINK',
                     help='compute the largest payload of this link')
    sub.add_argument('--payload-com', type=float, nargs=3, default=(0.0, 0.0, 0.0),
                     metavar=('X', 'Y', 'Z'),
                     help='center of mass of the payload in that link, m')
    sub.add_argument('--step', type=float, default=FINE, metavar='S',
                     help='time between samples in s; default: %(default)g')
    sub.add_argument('-o', '--out', metavar='CSV',
                     help='write the motion at the highest feasible speed, or with its '
                     'fastest timing')
    add_plot(sub, 'torque, speed and power')


def _fill(sub: ArgumentParser) -> None:
    _add_model(sub)
    _add_constraints(sub)
    _add_motion(sub, 'YAML, CSV or npz file, or a ROS 2 bag', required=True)
    sub.add_argument('--topic',
                     help='topic of the trajectories in a bag (default: the only one)')
    sub.add_argument('--tolerance', type=float, nargs='+', metavar='X',
                     help='insert points where the interpolated effort is wrong by '
                     'more, one value or one per joint, N m or N (default: insert none)')
    sub.add_argument('--rest', dest='pose', type=float, nargs='+', metavar='X',
                     help='positions of all joints; joints that the trajectory lacks '
                          'rest there')
    sub.add_argument('--without', nargs='+', default=(), metavar='TERM',
                     choices=('gravity', 'coriolis', 'inertia', 'friction'),
                     help='terms that the arm adds itself: gravity, coriolis, inertia, '
                          'friction')
    sub.add_argument('--feedforward-friction', metavar='CHOICE', type=_number_or_word,
                     default='desired_speed',
                     help='friction at rest and at reversals: that of the desired_speed '
                          '(default); ahead, as a motion begins, or a number, the time '
                          'ahead, s; none')
    sub.add_argument('--clip', action='store_true',
                     help='clamp efforts to their limits instead of exiting with an '
                          'error')
    sub.add_argument('-o', '--out', metavar='FILE',
                     help='.yaml or .csv file; for a bag the folder of the new bag')


def _number_or_word(text: str) -> str | float:
    """Return a number, or a word that is checked later."""
    try:
        return float(text)
    except ValueError:
        return text


def _doctor(sub: ArgumentParser) -> None:
    _add_model(sub, friction=False)
    _add_constraints(sub)
    sub.add_argument('--config', metavar='YAML', help='parameters of the dynamics node')
    _add_efforts(sub)
    sub.add_argument('--live', type=float, metavar='S',
                     help='examine the ROS graph for S seconds after its nodes are '
                          'found')
    sub.add_argument('--namespace', default='',
                     help='namespace of the arm in the ROS graph')
    sub.add_argument('--prefix', default='',
                     help='prefix of its joint names in the ROS graph')
    # Topics of the arm in the graph, by the names of the node's own.
    for name, what in (('commands', 'torques'), ('joint_states', 'joint states')):
        sub.add_argument(f'--{name.replace("_", "-")}', default=name, metavar='TOPIC',
                         help=f'topic of the {what}; default: %(default)s')


def _send(sub: ArgumentParser) -> None:
    _add_model(sub)
    _add_constraints(sub)
    motion = sub.add_mutually_exclusive_group(required=True)
    _add_motion(motion, 'CSV or YAML file; it starts at the measured positions')
    motion.add_argument('--by', type=float, nargs='+', metavar='X',
                        help='move by so much from the measured positions, and back, rad '
                        'or m; one per joint, or one value, which is smaller or turned '
                        'round for joints that would leave their limits')
    sub.add_argument('--duration', type=float, default=2.0, metavar='S',
                     help='duration of the motion of --by in s; default: %(default)g')
    sub.add_argument('--namespace', default='',
                     help='namespace of the arm in the ROS graph')
    sub.add_argument('--node', default='kane_dynamics', metavar='NAME',
                     help='name of the dynamics node; default: %(default)s')


def _view(sub: ArgumentParser) -> None:
    _add_model(sub)
    _add_constraints(sub)
    _add_motion(sub, '.npz, CSV or YAML file; shown with a time slider')
    sub.add_argument('--host', default='127.0.0.1', help='address to serve at; the '
                     'default is reachable from this machine only')
    sub.add_argument('--port', type=int, default=8080,
                     help='port, or the next free one; default: 8080')
    sub.add_argument('--no-open', action='store_true', help='do not open a browser')
    sub.add_argument('--export', metavar='FILE.html',
                     help='write a page instead of serving one')


def add_plot(parser: ArgumentParser, *kinds: str) -> None:
    """Add --plot, and --plot-of for several kinds, of which the first is the default."""
    default = kinds[0]
    parser.set_defaults(plot_of=None, plot_default=default)
    if len(kinds) == 1:
        parser.add_argument('--plot', metavar='FILE',
                            help=f'picture of {default}, .png, .svg or .pdf')
    else:
        parser.add_argument('--plot', metavar='FILE', help='picture, .png, .svg or .pdf')
        parser.add_argument('--plot-of', choices=kinds, metavar='WHAT',
                            help=f'{", ".join(kinds)}; default: {default}')


def _add_motion(sub: Any, text: str, **options: Any) -> None:
    """Add --motion."""
    sub.add_argument('--motion', metavar='FILE', help=text, **options)


def _add_recording(parser: ArgumentParser) -> None:
    parser.add_argument('recording', metavar='RECORDING',
                        help='CSV or npz file, or a ROS 2 bag')
    parser.add_argument('--topic',
                        help='topic of joint states in a bag (default: the only one)')
    parser.add_argument('--derive-speeds', action='store_true',
                        help='derive speeds and accelerations from q, also where they '
                             'are recorded')
    parser.add_argument('--cutoff', type=float, metavar='HZ',
                        help='filter q, tau and measured u without delay; differentiate '
                             'the rest')
    parser.add_argument('--resample', type=float, metavar='HZ',
                        help='resample at this rate (default: with --cutoff, the mean '
                             'rate)')


def _add_model(sub: ArgumentParser, *, friction: bool = True) -> None:
    """
    Add the arguments that choose the robot, and --json.

    `friction` adds --no-friction.
    """
    sub.add_argument('urdf', metavar='URDF',
                     help="path of the URDF or .xacro file, or '-' for "
                     'standard input')
    sub.add_argument('--xacro', nargs='+', metavar='NAME:=VALUE',
                     help='arguments of a .xacro file')
    from kane_dynamics.model.model import GRAVITY
    # The part of the URDF that moves, and what belongs to it.
    group = sub.add_argument_group('robot')
    group.add_argument('--joints', nargs='+', metavar='NAME',
                       help='moving joints; fixes the order of all values')
    group.add_argument('--base', metavar='LINK', help='base link of the moving part')
    group.add_argument('--tip', metavar='LINK', help='last link of the moving part')
    group.add_argument('--root-joint', choices=('fixed', 'free', 'floating', 'planar'),
                       default='fixed', help='joint between the world and the base; '
                       'free: a floating base with a quaternion, floating: with three '
                       'angles')
    group.add_argument('--gravity', nargs=3, type=float, default=GRAVITY,
                       metavar=('X', 'Y', 'Z'),
                       help='m/s^2; default: 0 0 -9.81')
    group.add_argument('--supplement', metavar='YAML',
                       help='springs, armature and friction, which URDF lacks')
    sub.set_defaults(no_friction=False)
    if friction:
        group.add_argument('--no-friction', action='store_true',
                           help='ignore damping and friction')
    group.add_argument('--no-strict', action='store_true',
                       help='accept impossible inertias with a warning')
    _add_output(sub)


def _add_constraints(sub: ArgumentParser) -> None:
    """Add --constraints."""
    sub.add_argument('--constraints', metavar='YAML', help='loop closures and other '
                     'constraints, which URDF lacks; states and motions are those of '
                     'its independent joints')


def _add_output(sub: ArgumentParser) -> None:
    """Add the options of all commands that print results and warnings."""
    sub.add_argument('--json', action='store_true', help='print JSON')
    sub.add_argument('-v', '--verbose', action='store_true',
                     help='print all warnings in full')


ADD: dict[str, Callable[[ArgumentParser], None]] = {
    'torque': _torque,
    'simulate': _simulate,
    'sweep': _sweep,
    'inspect': _inspect,
    'export': _export,
    'equations': _equations,
    'identify': _identify,
    'excite': _excite,
    'replay': _replay,
    'calibrate': _calibrate,
    'feasible': _feasible,
    'fill': _fill,
    'doctor': _doctor,
    'send': _send,
    'view': _view,
}
