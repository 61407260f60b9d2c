"""
Constraints from one YAML file, for robots whose URDF can only describe a tree.

Schema; frames and joints are named as in the URDF, lengths in m, angles in rad::

    constraints:                # at least one; each has its own name, for its forces
      pin:
        closure: {first: rocker_end, second: base_pin, kind: revolute, axis: [0, 1, 0]}
                                # or weld, prismatic, cylindrical, spherical, planar,
                                # inline; universal with second_axis; distance with length
      gear:
        coupling: {joint: wrist, ratios: {elbow: -1.5}, offset: 0.0}
      blade:
        knife_edge: {frame: skate, direction: [0, 1, 0]}
      wheel:
        rolling: {frame: hub, radius: 0.1, axis: [0, 1, 0], normal: [0, 0, 1],
                  height: 0.0}
      planet:
        rolling: {frame: planet, radius: 0.1, axis: [0, 0, 1], surface: cylinder,
                  surface_frame: sun, surface_radius: 0.3, surface_axis: [0, 0, 1],
                  inside: false}
      drift:
        point_velocity: {frame: tool, direction: [1, 0, 0], axes: tool,
                         relative_to: base, value: 0.0, angular: false}
    independent: [crank]        # joints whose rates are independent; else chosen well
    actuated: [crank]           # joints with actuators, or {crank: 1.0}, with weights
    configuration: {crank: 0.8, coupler: 0.1, rocker: -1.2}
                                # nearly closed: the assembly mode; others are at 0
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
import os
from typing import Any

from kane_dynamics._util.yaml_io import mapping, read_yaml
from kane_dynamics.errors import ConstraintError
from kane_dynamics.mechanics.constraints import (Closure, Constraint, Coupling,
                                                 knife_edge, PointVelocity, Rolling)

FRAMES = ('first', 'second', 'axes', 'relative_to', 'frame', 'surface_frame')
# For each kind: its constructor, required keys, optional keys.
KINDS: dict[str, tuple[Callable[..., Constraint], tuple[str, ...], tuple[str, ...]]] = {
    'closure': (Closure, ('first', 'second'), ('kind', 'axis', 'second_axis', 'length')),
    'coupling': (Coupling, ('joint', 'ratios'), ('offset',)),
    'knife_edge': (knife_edge, ('frame', 'direction'), ()),
    'rolling': (Rolling, ('frame', 'radius'),
                ('axis', 'normal', 'height', 'surface_frame', 'surface',
                 'surface_radius', 'surface_axis', 'inside')),
    'point_velocity': (PointVelocity, ('frame', 'direction'),
                       ('axes', 'relative_to', 'value', 'angular')),
}
OPTIONAL = ('actuated', 'configuration')
NUMBERS = ('offset', 'radius', 'height', 'value', 'length', 'surface_radius')


def load_constraints(source: str | os.PathLike[str] | Mapping[str, Any], *,
                     prefix: str = '') -> dict[str, Any]:
    """
    Return the arguments of `Robot` for constraints from a YAML file.

    ``Robot(load_urdf('press.urdf'), **load_constraints('press.constraints.yaml'))``. The
    schema is in the docstring of `kane_dynamics.mechanics.constraints.yaml_file`.

    Parameters
    ----------
    source : path or dict
        The file, or its content.
    prefix : str
        Prefix of every joint and frame name (`Model.prefixed`).

    Raises
    ------
    ConstraintError
        Names the constraint, the key, its value and what is expected. `Robot` checks
        whether the joints and frames exist.

    """
    if isinstance(source, Mapping):
        data = source
        file = 'constraints file'
    else:
        data = read_yaml(source, 'constraints', ConstraintError)
        file = f"constraints file '{os.fspath(source)}'"
    # Only known keys: a misspelled one must not be ignored.
    top = mapping(data, file, ('constraints', 'independent', *OPTIONAL), ConstraintError)
    entries = mapping(top.get('constraints', {}), f'{file}: constraints', None,
                      ConstraintError)
    if not entries:
        raise ConstraintError(f'{file}: no constraint; expected at least one under the '
                              'key constraints')

    # The arguments of `Robot`, with the prefix of a model that is part of another one.
    constraints = [_constraint(name, entry, prefix) for name, entry in entries.items()]
    options: dict[str, Any] = {'constraints': tuple(constraints)}
    options['independent'] = _joints(top, 'independent', prefix)
    # Actuators are a list of joints, or weights by joint.
    if isinstance(top.get('actuated'), Mapping):
        options['actuated'] = _numbers(top, 'actuated', prefix)
    elif 'actuated' in top:
        options['actuated'] = _joints(top, 'actuated', prefix)
    if 'configuration' in top:
        options['configuration'] = _numbers(top, 'configuration', prefix)
    return options


def _joints(top: Mapping[str, Any], key: str, prefix: str) -> tuple[str, ...] | None:
    """Return a list of joint names, or None if the key is missing."""
    names = top.get(key)
    if names is None:
        return None
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise ConstraintError(f'constraints file: {key}: {names!r}; expected a list of '
                              'joint names')
    return tuple(prefix + name for name in names)


def _numbers(top: Mapping[str, Any], key: str, prefix: str) -> dict[str, float]:
    """Return a number for each joint that is named."""
    entries = mapping(top[key], f'constraints file: {key}', None, ConstraintError)
    numbers = {}
    for joint, value in entries.items():
        what = f"constraints file: {key} of '{joint}'"
        numbers[prefix + joint] = _number(value, what)
    return numbers


def _constraint(name: str, data: Any, prefix: str) -> Constraint:
    """Return one constraint; its class checks the numbers."""
    what = f"constraint '{name}'"
    entry = mapping(data, what, tuple(KINDS), ConstraintError)
    # An entry is one kind with its arguments: '<name>: {rolling: {...}}'.
    if len(entry) != 1:
        raise ConstraintError(f'{what}: {list(entry)}; expected one of '
                              f'{", ".join(KINDS)}')
    (kind, content), = entry.items()
    constructor, required, optional = KINDS[kind]
    values = dict(mapping(content, f'{what}: {kind}', required + optional,
                          ConstraintError))
    for key in required:
        if key not in values:
            raise ConstraintError(f'{what}: {kind} without {key}; expected '
                                  f'{", ".join(required)}')

    # Names of frames and joints, numbers, ratios and flags, each in place.
    for key in (*FRAMES, 'joint'):
        if values.get(key) is not None:
            values[key] = prefix + _of_type(values[key], (str,), f'{what}: {key}',
                                            'a name')
    for key in NUMBERS:
        if key in values:
            values[key] = _number(values[key], f'{what}: {key}')
    if 'ratios' in values:
        entries = mapping(values['ratios'], f'{what}: ratios', None, ConstraintError)
        ratios: dict[str, float | list[float]] = {}
        for joint, ratio in entries.items():
            quantity = f"{what}: ratio of '{joint}'"
            if isinstance(ratio, list):  # of a polynomial
                ratios[prefix + joint] = [_number(c, quantity) for c in ratio]
            else:
                ratios[prefix + joint] = _number(ratio, quantity)
        values['ratios'] = ratios
    # Flags are checked here, since Python would accept any value as one.
    for key in ('angular', 'inside'):
        if key in values:
            _of_type(values[key], (bool,), f'{what}: {key}', 'true or false')
    return constructor(**values, name=name)


def _number(value: Any, what: str) -> float:
    """Return a number as a float; ConstraintError for anything else."""
    return float(_of_type(value, (int, float), what, 'a number'))


def _of_type(value: Any, types: tuple[type, ...], what: str, expected: str) -> Any:
    """Return the value if it has one of these types (bool is not a number)."""
    unwanted_flag = isinstance(value, bool) and bool not in types
    if unwanted_flag or not isinstance(value, types):
        raise ConstraintError(f'{what}: {value!r}; expected {expected}')
    return value
