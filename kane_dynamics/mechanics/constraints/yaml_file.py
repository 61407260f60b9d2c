"""
Constraints from one YAML file, for robots whose URDF can only describe a tree.

Schema; frames and joints are named as in the URDF, lengths in m, angles in rad::

    constraints:                # at least one; each has a name of its own, for its forces
      pin:
        closure: {first: rocker_end, second: base_pin, kind: revolute, axis: [0, 1, 0]}
                                # or weld, prismatic, cylindrical, spherical, planar, inline;
                                # universal with second_axis, distance with length
      gear:
        coupling: {joint: wrist, ratios: {elbow: -1.5}, offset: 0.0}
      blade:
        knife_edge: {frame: skate, direction: [0, 1, 0]}
      wheel:
        rolling: {frame: hub, radius: 0.1, axis: [0, 1, 0], normal: [0, 0, 1], height: 0.0}
      planet:
        rolling: {frame: planet, radius: 0.1, axis: [0, 0, 1], surface: cylinder,
                  surface_frame: sun, surface_radius: 0.3, surface_axis: [0, 0, 1],
                  inside: false}
      drift:
        point_velocity: {frame: tool, direction: [1, 0, 0], axes: tool, relative_to: base,
                         value: 0.0, angular: false}
    independent: [crank]        # the joints whose rates are independent; default: chosen well
"""

from collections.abc import Callable, Mapping
import os
from typing import Any

from kane_dynamics._util.yaml_io import mapping, read_yaml
from kane_dynamics.errors import ConstraintError
from kane_dynamics.mechanics.constraints import (Closure, Constraint, Coupling, knife_edge,
                                                 PointVelocity, Rolling)

FRAMES = ('first', 'second', 'axes', 'relative_to', 'frame', 'surface_frame')
# For each kind: its constructor, required keys, optional keys.
KINDS: dict[str, tuple[Callable[..., Constraint], tuple[str, ...], tuple[str, ...]]] = {
    'closure': (Closure, ('first', 'second'), ('kind', 'axis', 'second_axis', 'length')),
    'coupling': (Coupling, ('joint', 'ratios'), ('offset',)),
    'knife_edge': (knife_edge, ('frame', 'direction'), ()),
    'rolling': (Rolling, ('frame', 'radius'),
                ('axis', 'normal', 'height', 'surface_frame', 'surface', 'surface_radius',
                 'surface_axis', 'inside')),
    'point_velocity': (PointVelocity, ('frame', 'direction'),
                       ('axes', 'relative_to', 'value', 'angular')),
}
NUMBERS = ('offset', 'radius', 'height', 'value', 'length', 'surface_radius')


def load_constraints(source: str | os.PathLike[str] | Mapping[str, Any], *,
                     prefix: str = '') -> dict[str, Any]:
    """
    Return the arguments `constraints` and `independent` of `Robot` from a YAML file.

    ``Robot(load_urdf('press.urdf'), **load_constraints('press.constraints.yaml'))``. The schema
    is in the docstring of `kane_dynamics.mechanics.constraints.yaml_file`.

    Parameters
    ----------
    source : path or dict
        The file, or its content.
    prefix : str
        Prefix of every joint and frame name (`Model.prefixed`).

    Raises
    ------
    ConstraintError
        Names the constraint, the key, its value and what is expected. `Robot` checks whether the
        joints and frames exist.

    """
    data = source if isinstance(source, Mapping) else read_yaml(source, 'constraints',
                                                                ConstraintError)
    top = mapping(data, 'constraints file', ('constraints', 'independent'), ConstraintError)
    given = mapping(top.get('constraints', {}), 'constraints', None, ConstraintError)
    if not given:
        raise ConstraintError('constraints file: no constraint; expected at least one '
                              'under the key constraints')
    independent = top.get('independent')
    if independent is not None:
        if not isinstance(independent, list) or not all(
                isinstance(name, str) for name in independent):
            raise ConstraintError(f'constraints file: independent: {independent!r}; expected a '
                                  'list of joint names')
        independent = tuple(prefix + name for name in independent)
    return {'constraints': tuple(_constraint(name, entry, prefix)
                                 for name, entry in given.items()),
            'independent': independent}


def _constraint(name: str, data: Any, prefix: str) -> Constraint:
    """Return one constraint; its class checks the numbers."""
    what = f"constraint '{name}'"
    entry = mapping(data, what, tuple(KINDS), ConstraintError)
    if len(entry) != 1:
        raise ConstraintError(f'{what}: {list(entry)}; expected one of {", ".join(KINDS)}')
    (kind, content), = entry.items()
    make, required, optional = KINDS[kind]
    values = dict(mapping(content, f'{what}: {kind}', required + optional, ConstraintError))
    for key in required:
        if key not in values:
            raise ConstraintError(f'{what}: {kind} without {key}; expected {", ".join(required)}')
    for key in (*FRAMES, 'joint'):
        if values.get(key) is not None:
            values[key] = prefix + _of_type(values[key], (str,), f'{what}: {key}', 'a name')
    for key in NUMBERS:
        if key in values:
            values[key] = float(_of_type(values[key], (int, float), f'{what}: {key}', 'a number'))
    if 'ratios' in values:
        ratios = mapping(values['ratios'], f'{what}: ratios', None, ConstraintError)
        values['ratios'] = {prefix + joint: float(_of_type(
            ratio, (int, float), f"{what}: ratio of '{joint}'", 'a number'))
            for joint, ratio in ratios.items()}
    for key in ('angular', 'inside'):
        if key in values:
            _of_type(values[key], (bool,), f'{what}: {key}', 'true or false')
    return make(**values, name=name)


def _of_type(value: Any, types: tuple[type, ...], what: str, expected: str) -> Any:
    """Return the value if it has one of these types (bool is not a number)."""
    if not isinstance(value, types) or (isinstance(value, bool) and bool not in types):
        raise ConstraintError(f'{what}: {value!r}; expected {expected}')
    return value
