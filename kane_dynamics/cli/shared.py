"""Shared by the commands: loading a robot, warnings, vectors, JSON."""

from argparse import Namespace
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
import json
import math
import re
import sys
from typing import Any
import warnings

from kane_dynamics._util.text import short
from kane_dynamics._util.typing import Array
from kane_dynamics.cli.wording import in_options
from kane_dynamics.control.quasi_static import QuasiStatic, rigid_and_bending
from kane_dynamics.errors import InputError, ModelWarning, UnusedWarning
from kane_dynamics.loop_tracking.loop_tracker import velocity_rows
from kane_dynamics.mechanics.ball_joints import neutral
from kane_dynamics.mjcf import is_mjcf, load_mjcf
from kane_dynamics.model.model import GRAVITY, Model
from kane_dynamics.robot.methods.configuration_methods import (outside_limits,
                                                               suspected_degrees)
from kane_dynamics.robot.robot import Robot
from kane_dynamics.urdf import expand_xacro, load_urdf
from kane_dynamics.urdf.xacro_file import arguments_of
import numpy as np

LONGEST = 180  # characters of a warning
LIST = 4  # entries of a list of names that is shortened
# A name, with a number or a remark in brackets behind it: "joint_1 45.2 rad (limits -1 to 1)".
_NAME = r'(?:joint |link )?[^\s,;()]+(?: -?\d[\d.e+-]*(?: rad| m)?)?(?: \([^()]*\))?'
ENTRY = re.compile(_NAME)
NAMES = re.compile(rf'(?<=: ){_NAME}(?:, {_NAME}){{{LIST - 1},}}')
ROUNDING = 1e-13  # relative to the largest number of a table


def source_of(options: Namespace) -> str | bytes:
    """Return the URDF for load_urdf: a path, or its text from standard input or from xacro."""
    if options.urdf == '-':
        if sys.stdin is None:
            raise InputError("URDF: '-', and standard input is closed; expected a URDF on "
                             'standard input, or the path of a file')
        options.urdf = sys.stdin.buffer.read()  # standard input can be read only once
    if options.xacro:
        if isinstance(options.urdf, str) and '.xacro' not in options.urdf:
            raise InputError(f"--xacro: given with '{options.urdf}'; expected it with a file whose "
                             'name has .xacro')
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


def load(options: Namespace, caught: list[str] | None = None, **choices: Any
         ) -> tuple[Model, Robot]:
    """Return the chosen robot; collect warnings in `caught`, or print them to stderr."""
    with model_warnings(caught, verbose=options.verbose):
        model, given = _chosen(options)
        robot = Robot(model, **given, **choices)
    return model, robot


def load_rigid(options: Namespace, **choices: Any) -> tuple[Robot, QuasiStatic | None]:
    """Return the chosen robot with rigid links, and the flexible arm if the links are beams."""
    with model_warnings(verbose=options.verbose):
        model, given = _chosen(options)
        return rigid_and_bending(model, given | choices)


def _chosen(options: Namespace) -> tuple[Model, dict[str, Any]]:
    """Return the model and the arguments of Robot."""
    if is_mjcf(options.urdf):
        return _chosen_mjcf(options)
    model = load_urdf(source_of(options), supplement=options.supplement, **selection(options))
    return model, {'friction': not options.no_friction, **constraints_of(options)}


def _chosen_mjcf(options: Namespace) -> tuple[Model, dict[str, Any]]:
    """Return the model of an MJCF file and the arguments of Robot."""
    for name in ('base', 'tip', 'joints', 'supplement', 'xacro', 'constraints', 'root_joint'):
        if getattr(options, name, None) not in (None, 'fixed'):
            option = name.replace('_', '-')
            raise InputError(f"--{option}: given with the MJCF file '{options.urdf}'; expected it "
                             'with a URDF only')
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
    from kane_dynamics.mechanics.constraints.yaml_file import load_constraints  # imports yaml
    return load_constraints(path, prefix=prefix)


def every_joint(options: Namespace) -> tuple[str, ...] | None:
    """Return the joints of the whole robot, from its base; None if no part is chosen."""
    if not (options.base or options.tip or options.joints):
        return None
    with model_warnings([]):
        return load_urdf(source_of(options), supplement=options.supplement,
                         strict=not options.no_strict).joint_names


@contextmanager
def model_warnings(caught: list[str] | None = None, *, verbose: bool = False) -> Iterator[None]:
    """
    Collect model warnings in `caught`, or print them to stderr, also if an error follows.

    Each is printed on one line with long lists of names shortened; warnings of unused URDF
    elements are not printed. `verbose` prints everything.
    """
    with warnings.catch_warnings(record=True) as records:
        warnings.simplefilter('always', ModelWarning)
        try:
            yield
        finally:
            for record in records:
                text = in_options(str(record.message))
                if caught is not None:
                    caught.append(text)
                elif verbose or not issubclass(record.category, UnusedWarning):
                    print(f'kane-dynamics: warning: {text if verbose else brief(text)}',
                          file=sys.stderr)


def brief(text: str) -> str:
    """
    Return a message whose long lists of names are shortened; its sentences stay whole.

    A list follows a colon and has at least `LIST` entries. The last list is shortened first,
    until the message has at most `LONGEST` characters.
    """
    for names in reversed(list(NAMES.finditer(text))):
        if len(text) <= LONGEST:
            break
        entries = ENTRY.findall(names[0])
        room = len(names[0]) - (len(text) - LONGEST)
        kept = 1
        while kept < len(entries) and len(', '.join(entries[:kept + 1])) <= room:
            kept += 1
        if len(entries) - kept < 2:
            continue
        shorter = f'{", ".join(entries[:kept])} and {len(entries) - kept} more '
        text = (text[:names.start()] + shorter + '(--verbose names all)'
                + text[names.end():])
    return text


def without_rounding(values: Array, size: float = 0.0) -> Array:
    """Return numbers with 0 in place of rounding errors of the largest, or of a larger size."""
    largest = max(size, float(np.abs(values).max(initial=0.0)))
    return np.where(np.abs(values) < ROUNDING * largest, 0.0, values)


def torque_size(model: Model) -> float:
    """Return the weight of all bodies at the length of all links in one line, N m."""
    length = sum(float(np.linalg.norm(body.joint.translation)
                       + np.linalg.norm(body.inertial.com)) for body in model.bodies)
    mass = sum(body.inertial.mass for body in model.bodies)
    return mass * float(np.linalg.norm(model.gravity)) * length


def warn_degrees(robot: Robot, q: Array, what: str) -> None:
    """Print a warning if positions of all joints, or the independent ones, look like degrees."""
    if q.shape[-1] != robot.n_q:
        every = np.zeros((*q.shape[:-1], robot.n_q))
        every[..., [robot.coordinate_names.index(name) for name in robot.speed_names]] = q
        q = every
    warning = suspected_degrees(robot, q)
    if warning:
        print(f'kane-dynamics: warning: {what}: {brief(warning)}', file=sys.stderr)


def warn_outside(robot: Robot, q: Array, what: str) -> None:
    """Print a warning if positions of all joints, (n_q,), are outside their limits."""
    outside = outside_limits(robot, q) if q.shape == (robot.n_q,) else []
    if outside:
        print(f'kane-dynamics: warning: {what}: outside the limits: {short(outside)}',
              file=sys.stderr)


def say_start(robot: Robot, q: Array, what: str) -> None:
    """Print the coordinates that do not start at 0 because their limits exclude it."""
    moved = np.flatnonzero(q != neutral(robot.model))
    if len(moved):
        values = [f'{robot.coordinate_names[k]} {q[k]:.4g}' for k in moved]
        print(f'kane-dynamics: {what}: 0 is outside the limits of these joints; they start in '
              f'the middle of their limits: {short(values)}', file=sys.stderr)


def vector(options: Namespace, name: str, robot: Robot) -> Array:
    """Return an argument as one number per independent speed; zeros by default."""
    return np.zeros(robot.n) if getattr(options, name) is None else _numbers(
        options, name, [robot.speed_names])


def positions(options: Namespace, name: str, robot: Robot, default: Array | None = None) -> Array:
    """
    Return an argument as the positions of all joints, (n_q,).

    With constraints, positions of the independent joints are enough: the loops are closed from the
    configuration of the constraints file. `default` are positions of the independent joints; its
    default is that configuration, and `Robot.feasible_configuration` for a tree.
    """
    missing = getattr(options, name) is None
    if not robot.constraint_names and missing and default is not None:
        q = default
    elif not robot.constraint_names and missing:
        q = robot.feasible_configuration()
        say_start(robot, q, f'--{name}')
    elif not robot.constraint_names:
        q = _numbers(options, name, [robot.coordinate_names])
    elif missing and default is not None:
        q = _closed_near(robot, robot.speed_names, default)
    elif missing:
        q = _closed_near(robot, () if robot.configuration is None else robot.speed_names)
    else:
        independent = [] if velocity_rows(robot) else [robot.speed_names]
        q = _numbers(options, name, [*independent, robot.coordinate_names])
    if name == 'q':
        warn_degrees(robot, q, f'--{name}')
        warn_outside(robot, q, f'--{name}')
    return q if len(q) == robot.n_q else _closed_near(robot, robot.speed_names, q)


def _closed_near(robot: Robot, names: Sequence[str], values: Any = ()) -> Array:
    """Return the closed configuration with these joints, else at the file's values."""
    q = np.zeros(robot.n_q) if robot.configuration is None else np.array(robot.configuration)
    places = [robot.coordinate_names.index(name) for name in names]
    q[places[:len(values)]] = values
    return robot.closed_posture(q, fixed=names)


def _numbers(options: Namespace, name: str, orders: Sequence[Sequence[str]]) -> Array:
    """Return an argument as numbers, as many as one of the given lists of names has."""
    def expected(unit: str = '') -> str:
        return ', or '.join(f'{len(names)}{unit}, in the order {", ".join(names)}'
                            for names in orders)
    try:
        values = np.array([float(part) for part in split(getattr(options, name))])
    except ValueError as error:
        part = str(error).partition(': ')[2]
        raise InputError(f'--{name}: {part}; expected {expected(" numbers")}') from None
    if len(values) not in [len(names) for names in orders]:
        raise InputError(f'--{name}: {len(values)} numbers; expected {expected()}')
    return values


def split(tokens: Iterable[str]) -> list[str]:
    """Return arguments that are separated by spaces or commas."""
    return [part.strip() for token in tokens for part in token.split(',') if part.strip()]


def print_json(value: Any) -> None:
    """Print JSON on one line."""
    print(as_json(value))


def as_json(value: Any) -> str:
    """Return JSON on one line; infinite and missing numbers become null."""
    return json.dumps(plain(value), allow_nan=False)


def plain(value: Any) -> Any:
    """Return plain data for arrays, and for lists and mappings of arrays."""
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, dict):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
