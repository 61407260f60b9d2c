"""The robot that the options choose, and states of its joints."""

from argparse import Namespace
from collections.abc import Iterable, Sequence
from dataclasses import replace
import os
import sys
from typing import Any

from kane_dynamics._util.text import short
from kane_dynamics._util.typing import Array
from kane_dynamics.cli.printing import brief, model_warnings, warn
from kane_dynamics.control.quasi_static import QuasiStatic, rigid_and_bending
from kane_dynamics.errors import InputError
from kane_dynamics.loop_tracking.loop_tracker import velocity_rows
from kane_dynamics.mechanics.ball_joints import neutral
from kane_dynamics.mjcf import is_mjcf, load_mjcf
from kane_dynamics.model.model import GRAVITY, Model
from kane_dynamics.model.plausible_sizes import upward_gravity
from kane_dynamics.robot.methods.configuration_methods import (outside_limits,
                                                               suspected_degrees)
from kane_dynamics.robot.robot import Robot
from kane_dynamics.urdf import expand_xacro, load_urdf
from kane_dynamics.urdf.xacro_file import arguments_of
import numpy as np

CLOSED = 1e-9  # rad or m, to which loops are closed


def source_of(options: Namespace) -> str | bytes:
    """Return the URDF for load_urdf: a path, or its text from standard input or from xacro."""
    if options.urdf == '-':
        if sys.stdin is None:
            raise InputError("URDF: '-', and standard input is closed; expected a URDF "
                             'on standard input, or the path of a file')
        options.urdf = sys.stdin.buffer.read()  # standard input can be read only once
    if options.xacro:
        if isinstance(options.urdf, str) and '.xacro' not in options.urdf:
            raise InputError(f"--xacro: given with '{options.urdf}'; expected it with a "
                             'file whose name has .xacro')
        options.urdf = expand_xacro(options.urdf, arguments_of(options.xacro))
        options.xacro = None
    source: str | bytes = options.urdf
    return source


def selection(options: Namespace) -> dict[str, Any]:
    """Return the arguments of load_urdf that choose the moving part and gravity."""
    joints = None if options.joints is None else split(options.joints)
    return {'base': options.base, 'tip': options.tip, 'joints': joints,
            'gravity': tuple(options.gravity), 'strict': not options.no_strict,
            'root_joint': getattr(options, 'root_joint', 'fixed')}


def load_robot(options: Namespace, collected: list[str] | None = None, **choices: Any
               ) -> tuple[Model, Robot]:
    """Return the chosen robot; collect warnings in a list, or print them to stderr."""
    with model_warnings(collected, verbose=options.verbose):
        model, robot_options = _chosen(options)
        robot = Robot(model, **robot_options, **choices)
    if collected is None:
        _warn_of_gravity(model)
    return model, robot


def load_rigid(options: Namespace, **choices: Any) -> tuple[Robot, QuasiStatic | None]:
    """Return the chosen robot with rigid links, and the flexible arm if the links are beams."""
    with model_warnings(verbose=options.verbose):
        model, robot_options = _chosen(options)
        _warn_of_gravity(model)
        return rigid_and_bending(model, robot_options | choices)


def _warn_of_gravity(model: Model) -> None:
    """Print a warning if gravity points upwards."""
    upward = upward_gravity(model.gravity)
    if upward:
        warn(upward)


def _chosen(options: Namespace) -> tuple[Model, dict[str, Any]]:
    """Return the model and the arguments of Robot."""
    if is_mjcf(options.urdf):
        return _chosen_mjcf(options)
    _note_unused_files(options)
    model = load_urdf(source_of(options), supplement=options.supplement,
                      **selection(options))
    return model, {'friction': not options.no_friction, **constraints_of(options)}


def _note_unused_files(options: Namespace) -> None:
    """Print the supplement and the constraints that lie next to the URDF and are not used."""
    urdf = options.urdf
    if not isinstance(urdf, str) or urdf.lstrip().startswith('<'):
        return
    if getattr(options, 'config', None):
        return  # the configuration of a node names its files itself
    stem = urdf.removesuffix('.urdf')
    for name in ('supplement', 'constraints'):
        path = f'{stem}.{name}.yaml'
        if getattr(options, name, path) is None and os.path.exists(path):
            print(f"kane-dynamics: note: '{path}' is not used; --{name} {path} uses it",
                  file=sys.stderr)


def _chosen_mjcf(options: Namespace) -> tuple[Model, dict[str, Any]]:
    """Return the model of an MJCF file and the arguments of Robot."""
    for name in ('base', 'tip', 'joints', 'supplement', 'xacro', 'constraints',
                 'root_joint'):
        if getattr(options, name, None) not in (None, 'fixed'):
            option = name.replace('_', '-')
            raise InputError(f"--{option}: given with the MJCF file '{options.urdf}'; "
                             'expected it with a URDF only')
    mechanism = load_mjcf(options.urdf, strict=not options.no_strict)
    model = mechanism.model
    if tuple(options.gravity) != GRAVITY:
        model = replace(model, gravity=np.array(options.gravity))
    return model, {'friction': not options.no_friction, **mechanism.options}


def constraints_of(options: Namespace, prefix: str = '') -> dict[str, Any]:
    """Return the arguments of Robot that --constraints states; none for a tree."""
    path = getattr(options, 'constraints', None)
    if path is None:
        return {}
    from kane_dynamics.mechanics.constraints.yaml_file import (
        load_constraints)  # imports yaml
    return load_constraints(path, prefix=prefix)


def every_joint(options: Namespace) -> tuple[str, ...] | None:
    """Return the joints of the whole robot, from its base; None if no part is chosen."""
    if not (options.base or options.tip or options.joints):
        return None
    with model_warnings([]):
        return load_urdf(source_of(options), supplement=options.supplement,
                         strict=not options.no_strict).joint_names


def torque_size(model: Model) -> float:
    """Return the weight of all bodies at the length of all links in one line, N m."""
    length = mass = 0.0
    for body in model.bodies:
        length += float(np.linalg.norm(body.joint.translation)
                        + np.linalg.norm(body.inertial.com))
        mass += body.inertial.mass
    return mass * float(np.linalg.norm(model.gravity)) * length


def warn_degrees(robot: Robot, q: Array, what: str) -> None:
    """Print a warning if positions of all joints, or the independent ones, look like degrees."""
    if q.shape[-1] != robot.n_q:
        independent = list(map(robot.coordinate_names.index, robot.speed_names))
        all_joints = np.zeros((*q.shape[:-1], robot.n_q))
        all_joints[..., independent] = q
        q = all_joints
    warning = suspected_degrees(robot, q)
    if warning:
        warn(f'{what}: {brief(warning)}')


def warn_outside(robot: Robot, q: Array, what: str) -> None:
    """Print a warning if positions of all joints, (n_q,), are outside their limits."""
    if q.shape != (robot.n_q,):
        return
    outside = outside_limits(robot, q)
    if outside:
        warn(f'{what}: outside the limits: {short(outside)}')


def say_start(robot: Robot, q: Array, what: str) -> None:
    """Print the coordinates that do not start at 0, because limits or loops exclude it."""
    # A stated configuration is no surprise.
    if robot.configuration is not None:
        return
    lower, upper = robot.limits.lower, robot.limits.upper
    zero = neutral(robot.model)
    places = np.flatnonzero((zero < lower) | (zero > upper))
    reason = ('0 is outside the limits of these joints; they start in the middle of '
              'their limits')
    # Loops that are open at 0, or closed outside the limits, are closed elsewhere: near
    # it, or anywhere.
    starts = np.flatnonzero(np.abs(q - zero) > CLOSED)
    if len(starts) > 0 and closes_loops(robot):
        places = starts
        reason = ('0 is no closed configuration within the limits; these joints start '
                  'elsewhere')
    if len(places) > 0:
        values = [f'{robot.coordinate_names[k]} {q[k]:.4g}' for k in places]
        print(f'kane-dynamics: {what}: {reason}: {short(values)}', file=sys.stderr)


def closes_loops(robot: Robot) -> bool:
    """Return whether constraints determine positions of some joints."""
    return len(velocity_rows(robot)) < len(robot.mechanism.labels)


def speed_vector(options: Namespace, name: str, robot: Robot) -> Array:
    """Return an argument as one number per independent speed; zeros by default."""
    if getattr(options, name) is None:
        return np.zeros(robot.n)
    return _numbers(options, name, [robot.speed_names])


def positions(options: Namespace, name: str, robot: Robot,
              default: Array | None = None) -> Array:
    """
    Return an argument as the positions of all joints, (n_q,).

    Positions of the joints whose rates are the independent speeds are enough: the loops
    are closed from the configuration of the constraints file. `default` are positions of
    these joints; its default is `Robot.feasible_configuration`.
    """
    stated = getattr(options, name)
    if stated is not None:
        q = _numbers(options, name, _orders(robot))
    elif default is not None:
        q = default
    else:
        q = robot.feasible_configuration()
        say_start(robot, q, f'--{name}')
    # Positions in degrees would close other loops, or none.
    if name == 'q':
        warn_degrees(robot, q, f'--{name}')
    if len(q) < robot.n_q:
        q = _closed_near(robot, robot.speed_names, q)
    if name == 'q':
        warn_outside(robot, q, f'--{name}')
    return q


def _orders(robot: Robot) -> list[Sequence[str]]:
    """Return the lists of names by which positions may be stated, the shortest first."""
    every = robot.coordinate_names
    independent = robot.speed_names
    # Speeds that are no joint rates have no positions, and constraints of velocities
    # leave those of the other joints open.
    are_joint_rates = set(independent) < set(every)
    if are_joint_rates and not velocity_rows(robot):
        return [independent, every]
    return [every]


def _closed_near(robot: Robot, names: Sequence[str], values: Any = ()) -> Array:
    """
    Return a closed configuration in which the named coordinates have given values.

    Coordinates without a value begin at that of the constraints file, or at 0.
    """
    q = np.zeros(robot.n_q)
    if robot.configuration is not None:
        q[:] = robot.configuration
    places = list(map(robot.coordinate_names.index, names))
    q[places[:len(values)]] = values
    return robot.closed_configuration(q, fixed=names)


def _numbers(options: Namespace, name: str, orders: Sequence[Sequence[str]]) -> Array:
    """Return an argument as numbers, as many as one of the given lists of names has."""
    parts = split(getattr(options, name))
    values = np.zeros(len(parts))
    # Each part is a number; then their count says which list they follow.
    for k, part in enumerate(parts):
        try:
            values[k] = float(part)
        except ValueError:
            raise InputError(f'--{name}: {part!r}; expected '
                             f'{_in_orders(orders, " numbers")}') from None
    if len(values) not in [len(names) for names in orders]:
        raise InputError(f'--{name}: {len(values)} numbers; expected '
                         f'{_in_orders(orders)}')
    return values


def _in_orders(orders: Sequence[Sequence[str]], unit: str = '') -> str:
    """Return how many numbers are expected, and of which joints, as text."""
    texts = [f'{len(names)}{unit}, in the order {", ".join(names)}' for names in orders]
    return ', or '.join(texts)


def split(tokens: Iterable[str]) -> list[str]:
    """Return arguments that are separated by spaces or commas."""
    parts = ','.join(tokens).split(',')
    return [part.strip() for part in parts if part.strip()]


def one_or_all(values: list[float]) -> float | list[float]:
    """Return one number for all joints, or one for each."""
    return values[0] if len(values) == 1 else values
