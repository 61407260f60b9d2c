"""Declare the parameters of a node from their table, and check their values."""

from array import array
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
import difflib
import math
import re
from typing import Any

from kane_dynamics.control.arm_gravity import ArmGravity
from kane_dynamics.control.terms import NO_TERM, stated_terms, STATEMENT, Terms
from kane_dynamics.errors import InputError
from kane_dynamics.model.inertial import Inertial
from kane_dynamics.ros.parameters.parameter_table import AUTO, CONSTANTS, Kind, Spec
import numpy as np
from numpy.typing import NDArray
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.node import Node

SIMILAR = 0.75  # least similarity of spellings without a common word, as of difflib
# Parameters of ROS and of monitor_node that a parameter file may contain beside those of
# the node.
FOREIGN = ('use_sim_time', 'qos_overrides', 'start_type_description_service', 'estimator',
           'watch')
FRAMES = ('payload.frame', 'wrench.frames', 'cartesian.frame')


def _number(spec: Spec, value: Any) -> float:
    """Return a finite number within the bounds of `spec`."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError
    if math.isnan(value) or (math.isinf(value) and not spec.infinite):
        raise ValueError
    if value < spec.low or value > spec.high or (spec.positive and value == 0.0):
        raise ValueError
    return float(value)


def _names(spec: Spec, value: Any) -> tuple[str, ...]:
    """Return a tuple of distinct names; an empty list may be of any type."""
    names = tuple(value)
    if isinstance(value, str) or not all(isinstance(n, str) and n for n in names) or (
            len(set(names)) < len(names)):
        raise ValueError
    if spec.choices and not set(names) <= set(spec.choices):
        raise ValueError
    return names


def _text(spec: Spec, value: Any) -> str:
    """Return a string; if `spec` has choices, one of these."""
    if not isinstance(value, str) or (spec.choices and value not in spec.choices):
        raise ValueError
    return value


def _flag(spec: Spec, value: Any) -> bool:
    """Return true or false; ValueError for anything else."""
    if not isinstance(value, bool):
        raise ValueError
    return value


def _count(spec: Spec, value: Any) -> int:
    """Return an integer within the bounds of `spec`."""
    if not isinstance(value, int):
        raise ValueError
    return int(_number(spec, value))


def _vector(spec: Spec, value: Any) -> NDArray[np.float64]:
    """Return three finite numbers, or six for kind `six`."""
    numbers = [_number(spec, item) for item in value]
    if len(numbers) != (6 if spec.kind == 'six' else 3):
        raise ValueError
    return np.array(numbers)


def _numbers(spec: Spec, value: Any) -> tuple[int, ...]:
    """Return integers within the bounds of `spec`."""
    return tuple(_count(spec, item) for item in value)


def _floats(spec: Spec, value: Any) -> NDArray[np.float64]:
    """Return numbers within the bounds of `spec`, (k,)."""
    if isinstance(value, str):
        raise ValueError
    return np.array([_number(spec, item) for item in value])


def _per_joint(spec: Spec, value: Any) -> NDArray[np.float64]:
    """Return one number, shape (), or one per joint, shape (n,); shape (0,): not set."""
    if isinstance(value, (int, float)):
        return np.array(_number(spec, value))
    if not len(value) and np.size(spec.default):
        raise ValueError
    return np.array([_number(spec, item) for item in value])


def _terms(spec: Spec, value: Any) -> tuple[str, ...]:
    """Return torque terms, or 'none'; empty: not stated."""
    if not isinstance(value, str) and not len(value):
        return ()
    try:
        return stated_terms(value if isinstance(value, str) else list(value), spec.name)
    except InputError:
        raise ValueError from None


_READERS: dict[Kind, Callable[[Spec, Any], Any]] = {
    'text': _text, 'flag': _flag, 'number': _number, 'count': _count, 'names': _names,
    'vector': _vector, 'six': _vector, 'numbers': _numbers, 'floats': _floats,
    'per_joint': _per_joint, 'terms': _terms}


def read(spec: Spec, value: Any) -> Any:
    """Return the checked value of one parameter; raise InputError if it is invalid."""
    try:
        return _READERS[spec.kind](spec, value)
    except (TypeError, ValueError):
        raise InputError(f"parameter '{spec.name}': {parameter_text(value)}; "
                         f'expected {spec.constraint}') from None


def parameter_text(value: Any) -> str:
    """
    Return the text of a parameter's value.

    Arrays are written as lists of plain numbers.
    """
    if isinstance(value, (array, np.ndarray, np.generic)):
        return repr(value.tolist())
    return repr(value)


def declare(node: Node, specs: Sequence[Spec]) -> dict[str, Any]:
    """
    Declare parameters on `node`.

    Return the checked values by name, or raise InputError.
    """
    values = {}
    for spec in specs:
        # Dynamic typing, because `read` checks the type with a clearer error.
        descriptor = ParameterDescriptor(
            description=spec.description,
            additional_constraints=f'expected {spec.constraint}; ' + (
                'may change while the node is active' if spec.live else
                'may change only while the node is unconfigured'),
            read_only=spec.read_only, dynamic_typing=True)
        value = node.declare_parameter(spec.name, spec.default, descriptor).value
        values[spec.name] = read(spec, spec.default if value is None else value)
        # Only now, because rclpy would refuse a first value with an error of its own.
        if spec.slider:
            descriptor.floating_point_range = spec.slider
            node.set_descriptor(spec.name, descriptor)
    return values


def with_prefix(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values and the constants, with `prefix` before the names of frames."""
    prefix = values['prefix']
    result = CONSTANTS | dict(values)
    for name in FRAMES:
        frames = values.get(name)
        if isinstance(frames, str):
            result[name] = frames and prefix + frames  # empty: no frame
        elif frames:
            result[name] = tuple(prefix + frame for frame in frames)
    return result


def unknown_parameters(given: Sequence[str], known: Collection[str]) -> list[str]:
    """Return a warning for each given parameter that is unknown."""
    warnings = []
    for name in given:
        if name in known or name.split('.')[0] in FOREIGN:
            continue
        similar = similar_parameter(name, known)
        expected = f"'{similar}'" if similar else 'a parameter of the node'
        warnings.append(f"parameter '{name}': unknown and ignored; expected {expected}")
    return warnings


def similar_parameter(name: str, known: Collection[str]) -> str:
    """
    Return the known parameter that is most similar to a name; empty if none is similar.

    Names that have all words of `name` in any order come first (``kp``: ``gains.kp``,
    ``effort_limit``: ``limits.effort``), the shortest of them; then those that share
    most words with it, the most similar spelling of them; then similar spellings alone.
    """
    words = _words(name)
    same_words = [candidate for candidate in known if words <= _words(candidate)]
    if same_words:
        return min(same_words, key=len)
    # Group the parameters by the number of words that they share with the name.
    by_shared_words: dict[int, list[str]] = {}
    for candidate in known:
        count = len(words & _words(candidate))
        by_shared_words.setdefault(count, []).append(candidate)
    largest = max(by_shared_words)
    if largest:
        candidates = by_shared_words[largest]
        return difflib.get_close_matches(name, candidates, n=1, cutoff=0.0)[0]
    similar = difflib.get_close_matches(name, known, n=1, cutoff=SIMILAR)
    return similar[0] if similar else ''


def _words(name: str) -> set[str]:
    """Return the stems of the words of a parameter's name."""
    return {word[:6].rstrip('s') for word in re.split(r'[._/-]', name.lower()) if word}


def integrator_of_simulations(values: Mapping[str, Any], name: str) -> str | None:
    """Return the integrator that a parameter names; None for 'auto', the choice by the step."""
    integrator: str = values[name]
    return None if integrator == AUTO else integrator


def per_joint(values: Mapping[str, Any], name: str, joints: Sequence[str],
              empty: NDArray[np.float64] | float) -> NDArray[np.float64]:
    """
    Return a per-joint parameter as an (n,) array, or `empty` if it is not set.

    Raises
    ------
    InputError
        The list is neither empty nor of the length of `joints`.

    """
    value = values[name]
    # An empty list, the default of such parameters.
    if value.shape == (0,):
        value = np.asarray(empty, dtype=np.float64)
    if value.shape not in ((), (len(joints),)):
        entries = f'{value.size} entries'
        hint = ''
        if value.size == 1:
            entries = f'a list of one, {parameter_text(value)}'
            hint = ' without brackets'
        raise InputError(f"parameter '{name}': {entries}; expected one number{hint}, or one "
                         f"for each of the {len(joints)} joints ({', '.join(joints)})")
    return np.broadcast_to(value, (len(joints),)).copy()


def per_joint_of_effort(values: Mapping[str, Any], name: str, joints: Sequence[str],
                        limits: NDArray[np.float64],
                        share: float) -> NDArray[np.float64]:
    """
    Return a per-joint parameter, (n,); if it is not set, a share of the effort limits.

    Raises
    ------
    InputError
        The list has the wrong length, or it is empty and a joint has no effort limit.

    """
    # By default a share of each joint's effort limit.
    result = per_joint(values, name, joints, share * limits)
    if not values[name].size and not np.isfinite(result).all():
        joint = joints[int(np.flatnonzero(~np.isfinite(result))[0])]
        raise InputError(f"parameter '{name}': empty, and joint '{joint}' has no effort "
                         'limit; expected one number or one per joint, N m or N')
    return result


def unstated(hint: str = '') -> InputError:
    """Return the error that parameter arm_compensates is not set, with a hint."""
    return InputError(
        "parameter 'arm_compensates': not stated; expected what the arm adds to "
        f'commanded efforts itself, {STATEMENT}: a wrong one doubles the weight or '
        f'drops the arm{hint}. The table of arms is on the page "Arms with built-in '
        'gravity compensation"; `kane-dynamics doctor URDF --config FILE` compares a '
        'configuration with it')


def terms(values: Mapping[str, Any]) -> Terms:
    """
    Return the terms of the model that the commanded torques contain.

    Raise InputError if arm_compensates is not stated.
    """
    stated = values['arm_compensates']
    if not stated:
        raise unstated()
    arm = arm_gravity(values)
    if arm is None:
        return Terms.beside(stated)
    others = [name for name in stated if name != 'gravity']
    return replace(Terms.beside(others or [NO_TERM]), arm=arm)


def arm_gravity(values: Mapping[str, Any]) -> ArmGravity | None:
    """
    Return the gravity and payload that the arm compensates; None if they are not stated.

    Raises
    ------
    InputError
        They are stated for an arm that does not compensate gravity, or the payload has no
        frame, or another number of values.

    """
    stated = [name for name in ('arm_gravity', 'arm_payload') if values[name].size]
    if not stated:
        return None
    if 'gravity' not in values['arm_compensates']:
        raise InputError(f"parameter '{stated[0]}': given for an arm that does not "
                         'compensate gravity; expected gravity in arm_compensates')
    # Not stated: that of the node, which parameters and an IMU change.
    gravity = values['arm_gravity'] if values['arm_gravity'].size else None
    payload = None
    four = values['arm_payload']
    if four.size and (len(four) != 4 or four[0] < 0.0):
        raise InputError(f"parameter 'arm_payload': {four.tolist()}; expected the mass, kg, "
                         'and three coordinates of its center of mass, m')
    if gravity is not None and len(gravity) != 3:
        raise InputError(f"parameter 'arm_gravity': {gravity.tolist()}; expected three "
                         'numbers, m/s^2')
    if four.size and four[0] > 0.0:
        if not values['payload.frame']:
            raise InputError("parameter 'arm_payload': without payload.frame; expected the "
                             'frame in whose axes it is stated')
        payload = Inertial(float(four[0]), four[1:], np.zeros((3, 3)))
    return ArmGravity.of(gravity, payload)


def controller_settings(values: Mapping[str, Any],
                        joints: Sequence[str]) -> dict[str, Any]:
    """Return the settings of a Controller, as keyword arguments."""
    return {'mode': values['mode'], 'compensate': terms(values),
            'kp': per_joint(values, 'gains.kp', joints, 0.0),
            'kd': per_joint(values, 'gains.kd', joints, 0.0),
            'effort_limit': per_joint(values, 'limits.effort', joints, math.inf),
            'rate_limit': per_joint(values, 'limits.rate', joints, math.inf),
            'blend_time': values['blend_time']}
