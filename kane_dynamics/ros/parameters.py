"""
The node's parameters: one table that declares, describes and checks each of them.

Numbers and lists are declared with dynamic typing, so that ``100`` does for ``100.0`` and one
number does for a list with one per joint; the checks here then say in words what is wrong.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
import difflib
import math
from typing import Any, Literal

from kane_dynamics.control import Mode, Terms
from kane_dynamics.errors import InputError
import numpy as np
from numpy.typing import NDArray
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.node import Node

Kind = Literal['text', 'flag', 'number', 'count', 'names', 'vector', 'per_joint']
# Parameters that ROS itself puts beside ours in an overrides file.
FOREIGN = ('use_sim_time', 'qos_overrides', 'start_type_description_service')


@dataclass(frozen=True)
class Spec:
    """
    What one parameter is.

    `live` parameters may change while the node is active; the others describe the robot, so they
    may change only while the node is unconfigured. `low` and `high` bound numbers (zero is
    excluded where `positive` holds, infinity unless `infinite` does).
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
        """Say in words which values are valid."""
        if self.choices:
            return 'one of ' + ', '.join(self.choices)
        number = 'positive' if self.positive else f'at least {self.low:g}'
        if self.high < math.inf:
            number += f', at most {self.high:g}'
        number += ' or infinite' if self.infinite else ''
        return {'text': 'text', 'flag': 'true or false', 'names': 'a list of names, each once',
                'vector': 'three finite numbers', 'number': f'a number, {number}',
                'count': f'a whole number, {number}',
                'per_joint': f'one number or one per joint, each {number}'}[self.kind]


def live(name: str, kind: Kind, default: Any, description: str, **bounds: Any) -> Spec:
    """Return the Spec of a parameter that may change while the node is active."""
    return Spec(name, kind, default, description, live=True, **bounds)


SPECS = (
    Spec('autostart', 'flag', True, 'configure and activate as soon as the URDF is known',
         read_only=True),
    Spec('robot_description', 'text', '', 'URDF as text; wins over `urdf` and over the topic'),
    Spec('urdf', 'text', '', 'path of a URDF file; wins over the topic robot_description'),
    Spec('supplement', 'text', '', 'path of the YAML beside the URDF: springs, armature, '
         'friction, payload; empty: none'),
    Spec('base', 'text', '', 'first link of the part that moves; empty: the root'),
    Spec('tip', 'text', '', 'last link of the part that moves; empty: all branches'),
    Spec('joints', 'names', [], 'joints that move, in the order of `commands`; every other one '
         'is locked; empty: all, parents first'),
    live('gravity', 'vector', [0.0, 0.0, -9.81], 'gravity in world axes, m/s^2'),
    live('mode', 'text', 'inverse_dynamics', 'what `commands` holds', choices=tuple(Mode)),
    live('compensate.gravity', 'flag', True, 'let `commands` carry gravity; false for an arm '
         'that adds it itself'),
    live('compensate.coriolis', 'flag', True, 'let `commands` carry Coriolis and centrifugal '
         'terms'),
    live('compensate.inertia', 'flag', True, 'let `commands` carry M(q) udot'),
    live('compensate.friction', 'flag', True, 'let `commands` carry joint friction'),
    live('gains.kp', 'per_joint', 100.0, 'computed torque: position gain, 1/s^2', low=0.0),
    live('gains.kd', 'per_joint', 20.0, 'computed torque: velocity gain, 1/s', low=0.0),
    live('limits.effort', 'per_joint', [], 'largest effort, N m or N; the smaller of this and '
         'of the URDF holds; empty: the URDF alone', positive=True, infinite=True, low=0.0),
    live('limits.rate', 'per_joint', [], 'largest change of effort, N m/s or N/s; empty: none',
         positive=True, infinite=True, low=0.0),
    live('state_timeout', 'number', 0.1, 'age of the joint states, in s, from which on zeros '
         'are commanded', positive=True, low=0.0, high=3600.0),
    live('diagnostics_rate', 'number', 1.0, 'reports on /diagnostics, 1/s', positive=True,
         low=0.0, high=100.0),
    live('trajectory.max_points', 'count', 10_000, 'longest desired motion accepted, points',
         low=1.0, high=1e6),
    live('simulation.max_duration', 'number', 3600.0, 'longest simulation accepted, s',
         positive=True, low=0.0),
    live('simulation.max_steps', 'count', 1_000_000, 'most steps of one simulation', low=1.0,
         high=1e8),
    live('simulation.max_points', 'count', 10_000, 'most points in one simulated trajectory',
         low=2.0, high=1e6),
    live('simulation.max_waiting', 'count', 8, 'simulations that may wait for their turn; '
         'further ones are told that the node is busy', low=1.0, high=1000.0),
)
BY_NAME = {spec.name: spec for spec in SPECS}


def _number(spec: Spec, value: Any) -> float:
    """Return a finite number within the bounds of `spec`."""
    if isinstance(value, bool) or not isinstance(value, (int, float)) or math.isnan(value) or (
            math.isinf(value) and not spec.infinite):
        raise ValueError
    if value < spec.low or value > spec.high or (spec.positive and value == 0.0):
        raise ValueError
    return float(value)


def _names(spec: Spec, value: Any) -> tuple[str, ...]:
    """Return a list of distinct names; an empty one may be of any type."""
    names = tuple(value)
    if isinstance(value, str) or not all(isinstance(n, str) and n for n in names) or (
            len(set(names)) < len(names)):
        raise ValueError
    return names


def _text(spec: Spec, value: Any) -> str:
    """Return text, one of the choices where there are any."""
    if not isinstance(value, str) or (spec.choices and value not in spec.choices):
        raise ValueError
    return value


def _flag(spec: Spec, value: Any) -> bool:
    """Return a truth value."""
    if not isinstance(value, bool):
        raise ValueError
    return value


def _count(spec: Spec, value: Any) -> int:
    """Return a whole number within the bounds of `spec`."""
    if not isinstance(value, int):
        raise ValueError
    return int(_number(spec, value))


def _vector(spec: Spec, value: Any) -> NDArray[np.float64]:
    """Return three finite numbers."""
    numbers = [_number(spec, item) for item in value]
    if len(numbers) != 3:
        raise ValueError
    return np.array(numbers)


def _per_joint(spec: Spec, value: Any) -> NDArray[np.float64]:
    """Return one number, shape (), or one per joint, shape (n,); shape (0,) says nothing."""
    if isinstance(value, (int, float)):
        return np.array(_number(spec, value))
    return np.array([_number(spec, item) for item in value])


_READERS: dict[Kind, Callable[[Spec, Any], Any]] = {
    'text': _text, 'flag': _flag, 'number': _number, 'count': _count, 'names': _names,
    'vector': _vector, 'per_joint': _per_joint}


def read(name: str, value: Any) -> Any:
    """
    Return the checked value of one parameter.

    Raises
    ------
    InputError
        Names the parameter, the value, and what is valid.

    """
    spec = BY_NAME[name]
    try:
        return _READERS[spec.kind](spec, value)
    except (TypeError, ValueError):
        shown = value if isinstance(value, (str, int, float)) or value is None else list(value)
        raise InputError(f"parameter '{name}' is {shown!r}; valid: {spec.constraint}") from None


def declare(node: Node) -> dict[str, Any]:
    """
    Declare every parameter on `node` and return the checked values by name.

    Raises
    ------
    InputError
        A value given at start is not valid.

    """
    values = {}
    for spec in SPECS:
        descriptor = ParameterDescriptor(
            description=spec.description, additional_constraints=spec.constraint,
            read_only=spec.read_only, dynamic_typing=spec.kind not in ('text', 'flag'))
        value = node.declare_parameter(spec.name, spec.default, descriptor).value
        values[spec.name] = read(spec.name, spec.default if value is None else value)
    return values


def misspelt(given: Sequence[str]) -> list[str]:
    """Return a remark for every given parameter that the node does not have."""
    remarks = []
    for name in given:
        if name in BY_NAME or name.split('.')[0] in FOREIGN:
            continue
        near = difflib.get_close_matches(name, BY_NAME, n=1)
        remarks.append(f"parameter '{name}' does not exist and is ignored"
                       + (f"; did you mean '{near[0]}'?" if near else ''))
    return remarks


def per_joint(values: Mapping[str, Any], name: str, joints: Sequence[str],
              empty: NDArray[np.float64] | float) -> NDArray[np.float64]:
    """
    Return a per-joint parameter as an (n,) array; `empty` stands in where it says nothing.

    Raises
    ------
    InputError
        The list is neither empty nor as long as the list of joints.

    """
    value = values[name]
    if value.shape == (0,):
        value = np.asarray(empty, dtype=np.float64)
    if value.shape not in ((), (len(joints),)):
        raise InputError(f"parameter '{name}' has {value.size} entries for {len(joints)} joints "
                         f"({', '.join(joints)}); valid: {BY_NAME[name].constraint}")
    return np.broadcast_to(value, (len(joints),)).copy()


def terms(values: Mapping[str, Any]) -> Terms:
    """Return the term switches that the compensate parameters set."""
    return Terms(**{name: values[f'compensate.{name}']
                    for name in ('gravity', 'coriolis', 'inertia', 'friction')})


def controller_settings(values: Mapping[str, Any], joints: Sequence[str]) -> dict[str, Any]:
    """Return the settings of a Controller."""
    return {'mode': values['mode'], 'compensate': terms(values),
            'kp': per_joint(values, 'gains.kp', joints, 0.0),
            'kd': per_joint(values, 'gains.kd', joints, 0.0),
            'effort_limit': per_joint(values, 'limits.effort', joints, math.inf),
            'rate_limit': per_joint(values, 'limits.rate', joints, math.inf)}
