"""The arguments of each subcommand; what the parser of one needs is imported for that one."""

from argparse import ArgumentParser, ArgumentTypeError
from collections.abc import Callable
import math
from typing import Any

from kane_dynamics.cli.plot_arguments import add_plot, KINDS

STEP = 0.01  # s, between samples of a motion given by points


def _torque(sub: ArgumentParser) -> None:
    _add_model(sub)
    for name, text in (('q', 'positions, rad or m'), ('u', 'speeds'), ('udot', 'accelerations')):
        sub.add_argument(f'--{name}', nargs='+', metavar='X', help=f'{text} (default: zeros)')
    _add_motion(sub, 'CSV or YAML file: its torques, row by row')
    sub.add_argument('--step', type=float, metavar='S', help='between samples of the motion '
                     f'(default: {STEP:g} between points of a YAML file; rows of a CSV file)')
    sub.add_argument('--out', metavar='CSV', help='file for the torques of a motion')
    add_plot(sub, 'torque-by-source', *(kind for kind in KINDS if kind != 'torque-by-source'))


def _simulate(sub: ArgumentParser) -> None:
    from kane_dynamics.mechanics.integrators import INTEGRATORS
    _add_model(sub)
    sub.add_argument('--q0', nargs='+', metavar='X',
                     help="positions at the start (default: the motion's, else zeros)")
    sub.add_argument('--u0', nargs='+', metavar='X', help='speeds at the start (default: zeros)')
    sub.add_argument('--duration', type=float, metavar='S',
                     help="simulated seconds (default: the motion's, else 1)")
    sub.add_argument('--step', type=float, default=1e-3, metavar='S', help='default: 0.001')
    sub.add_argument('--integrator', choices=INTEGRATORS, default='rk4',
                     help='implicit: for friction, springs and beams that take a very short step')
    source = sub.add_mutually_exclusive_group()
    _add_motion(source, 'follow it by computed torque')
    source.add_argument('--torque', nargs='+', metavar='X', help='constant torques, or a CSV file')
    sub.add_argument('--kp', type=float, nargs='+', default=[100.0], metavar='X',
                     help='for --motion, one value or one per joint, 1/s^2; default: 100')
    sub.add_argument('--kd', type=float, nargs='+', default=[20.0], metavar='X',
                     help='for --motion, one value or one per joint, 1/s; default: 20')
    sub.add_argument('--out', metavar='FILE', help='.npz or .csv file for the trajectory')
    add_plot(sub, *KINDS, 'tracking')


def _sweep(sub: ArgumentParser) -> None:
    sub.add_argument('sweep', metavar='YAML', help='what to simulate; see below')
    sub.add_argument('-o', '--out', required=True, metavar='FOLDER',
                     help='for the parquet files; new, or of this sweep')
    sub.add_argument('--workers', type=int, metavar='N', help='processes (default: all cores)')
    sub.add_argument('--dask', metavar='ADDRESS', help='of a Dask scheduler, to compute there')
    sub.add_argument('--json', action='store_true', help='print JSON')


def _inspect(sub: ArgumentParser) -> None:
    _add_model(sub)
    sub.add_argument('--against', choices=['pinocchio'],
                     help='compare inverse dynamics at random states')
    sub.add_argument('--operations', action='store_true',
                     help='also the arithmetic operations of each compiled function')


def _bench(sub: ArgumentParser) -> None:
    _add_model(sub)


def _export(sub: ArgumentParser) -> None:
    from kane_dynamics.robot.export_c import DEFAULT_KERNELS
    _add_model(sub)
    sub.add_argument('-o', '--out', required=True, metavar='FILE.c',
                     help='the source; the header goes beside it')
    sub.add_argument('--kernel', nargs='+', default=DEFAULT_KERNELS, metavar='NAME',
                     help='also frame_pose:LINK, jacobian:LINK; default: '
                          + ' '.join(DEFAULT_KERNELS))
    sub.add_argument('--float32', action='store_true', help='single precision')
    sub.add_argument('--no-self-test', action='store_true', help='leave the self-test out')
    sub.add_argument('--wrench-frames', nargs='+', default=(), metavar='LINK',
                     help='links on which the environment may push')
    sub.add_argument('--payload-frame', metavar='LINK', help='link that carries a payload')


def _equations(sub: ArgumentParser) -> None:
    _add_model(sub)
    sub.add_argument('--numbers', action='store_true',
                     help="the model's numbers instead of symbols for them")
    form = sub.add_mutually_exclusive_group()
    for name in ('latex', 'markdown', 'csv'):
        form.add_argument(f'--{name}', dest='format', action='store_const', const=name)
    sub.set_defaults(format='text')
    sub.add_argument('-o', '--out', metavar='FILE', help='write there instead of printing')


def _identify(sub: ArgumentParser) -> None:
    from kane_dynamics.identification.regression import STANDSTILL
    _add_model(sub)
    _add_recording(sub)
    sub.add_argument('--as-recorded', action='store_true',
                     help='fit a recording that does not fit the model, too')
    sub.add_argument('--friction-only', action='store_true',
                     help='leave the inertials as they are')
    sub.add_argument('--unbounded', action='store_true',
                     help='with --friction-only: let friction come out negative, by plain least '
                          'squares, where the rigid bodies leave something unexplained')
    sub.add_argument('--standstill', type=float, default=STANDSTILL, metavar='SPEED',
                     help='a slower joint says nothing; rad/s or m/s, default: %(default)g')
    sub.add_argument('--weight', type=float, metavar='W',
                     help="of the URDF's inertials as a prior (default: by cross-validation)")
    sub.add_argument('--base-parameters', action='store_true',
                     help='only what torques tell for certain, by plain least squares')
    sub.add_argument('--payload', metavar='LINK',
                     help='find what this link carries, the rest being known')
    sub.add_argument('-o', '--out', metavar='FILE',
                     help='write the identified model, a URDF; with --payload a supplement')


def _length_or_none(text: str) -> float | None:
    """Return a number, or None for 'none'."""
    try:
        return None if text == 'none' else float(text)
    except ValueError:
        raise ArgumentTypeError(f"'{text}'; expected a number of m, or none") from None


def _excite(sub: ArgumentParser) -> None:
    _add_model(sub)
    sub.add_argument('-o', '--out', metavar='CSV', required=True, help='write the motion')
    for name, kind, default, text in (
            ('duration', float, 10.0, 's'),
            ('periods', int, 1, 'number of equal periods in the duration'),
            ('harmonics', int, 5, 'sines and cosines of each joint'),
            ('share', float, 0.9, 'fraction of the limits to use'),
            ('seed', int, 0, 'of the motions that the search starts from'),
            ('starts', int, 2, 'how many of these'), ('rate', float, 100.0, 'rows a second')):
        sub.add_argument(f'--{name}', type=kind, default=default, metavar='X',
                         help=f'{text}; default: %(default)s')
    for name, unit in (('velocity', 'rad/s or m/s'), ('acceleration', 'rad/s^2 or m/s^2')):
        sub.add_argument(f'--{name}', type=float, nargs='+', default=[math.inf], metavar='X',
                         help=f'further limit, one value or one per joint, {unit}')
    for name, default, text in (
            ('floor', 0.0, 'lowest height of any link, m'),
            ('distance', 0.05, 'smallest distance between links, m')):
        sub.add_argument(f'--{name}', type=_length_or_none, default=default, metavar='X',
                         help=f'{text}, or none; default: %(default)g')


def _replay(sub: ArgumentParser) -> None:
    _add_model(sub)
    _add_recording(sub)
    sub.add_argument('-o', '--out', metavar='CSV', help='write the motion and its torques')
    add_plot(sub, 'measured and computed torques')


def _feasible(sub: ArgumentParser) -> None:
    from kane_dynamics.feasibility.samples import STEP as FINE
    _add_model(sub)
    _add_motion(sub, 'CSV or YAML file', required=True)
    sub.add_argument('--speed', type=float, default=1.0, metavar='S',
                     help='judge the motion S times as fast as in the file')
    sub.add_argument('--power', type=float, nargs='+', default=[math.inf], metavar='W',
                     help='largest mechanical power, one value or one per joint (default: none)')
    sub.add_argument('--payload-frame', metavar='LINK', help='find the largest payload there')
    sub.add_argument('--payload-com', type=float, nargs=3, default=(0.0, 0.0, 0.0),
                     metavar=('X', 'Y', 'Z'), help='its mass centre in that frame, m')
    sub.add_argument('--step', type=float, default=FINE, metavar='S',
                     help='between samples, default: %(default)g')
    sub.add_argument('-o', '--out', metavar='CSV',
                     help='write the motion at the highest speed that fits')
    add_plot(sub, 'torque, speed and power')


def _doctor(sub: ArgumentParser) -> None:
    _add_model(sub)
    sub.add_argument('--config', metavar='YAML', help='parameters of the dynamics node')
    sub.add_argument('--live', type=float, metavar='S',
                     help='listen to the graph for so long, once its nodes are found')
    sub.add_argument('--namespace', default='', help='of the arm in the graph')
    sub.add_argument('--prefix', default='', help="of the arm's joints in the graph")
    for name, what in (('commands', 'torques'), ('joint_states', 'joint states')):
        sub.add_argument(f'--{name.replace("_", "-")}', default=name, metavar='TOPIC',
                         help=f'of the {what} in the graph; default: %(default)s')


def _view(sub: ArgumentParser) -> None:
    _add_model(sub)
    _add_motion(sub, '.npz, CSV or YAML file: a slider over time')
    sub.add_argument('--host', default='127.0.0.1', help='address to serve at; by default only '
                     'this machine sees the page')
    sub.add_argument('--port', type=int, default=8080, help='or the next free one; default: 8080')
    sub.add_argument('--no-open', action='store_true', help='open no browser')
    sub.add_argument('--export', metavar='FILE.html', help='write a page instead of serving one')


def _add_motion(sub: Any, text: str, **options: Any) -> None:
    """Add --motion, and --trajectory as another name of it."""
    sub.add_argument('--motion', '--trajectory', metavar='FILE', help=text, **options)


def _add_recording(parser: ArgumentParser) -> None:
    parser.add_argument('recording', metavar='RECORDING', help='CSV or npz file, or a ROS 2 bag')
    parser.add_argument('--topic', help='of the joint states in a bag (default: its only one)')
    parser.add_argument('--cutoff', type=float, metavar='HZ',
                        help='filter q, tau and measured u without delay, and derive the rest')
    parser.add_argument('--resample', type=float, metavar='HZ',
                        help='evenly spaced rows (default: with --cutoff as many as there are)')


def _add_model(sub: ArgumentParser) -> None:
    """Add the arguments that choose the robot, and --json."""
    sub.add_argument('urdf', metavar='URDF', help="path of the URDF, or '-' for standard input")
    from kane_dynamics.model.model import GRAVITY
    group = sub.add_argument_group('robot')
    group.add_argument('--joints', nargs='+', metavar='NAME',
                       help='joints that move, in the order of all numbers')
    group.add_argument('--base', metavar='LINK', help='first link of the part that moves')
    group.add_argument('--tip', metavar='LINK', help='last link of the part that moves')
    group.add_argument('--gravity', nargs=3, type=float, default=GRAVITY, metavar=('X', 'Y', 'Z'),
                       help='m/s^2; default: 0 0 -9.81')
    group.add_argument('--supplement', metavar='YAML',
                       help='springs, armature and friction that a URDF cannot say')
    group.add_argument('--no-friction', action='store_true', help='leave damping and friction out')
    group.add_argument('--no-strict', action='store_true',
                       help='warn of impossible inertias instead of refusing them')
    sub.add_argument('--json', action='store_true', help='print JSON')
    sub.add_argument('-v', '--verbose', action='store_true',
                     help='print all warnings, with every name')


ADD: dict[str, Callable[[ArgumentParser], None]] = {
    'torque': _torque,
    'simulate': _simulate,
    'sweep': _sweep,
    'inspect': _inspect,
    'bench': _bench,
    'export': _export,
    'equations': _equations,
    'identify': _identify,
    'excite': _excite,
    'replay': _replay,
    'feasible': _feasible,
    'doctor': _doctor,
    'view': _view,
}
