"""The checks of `kane-dynamics doctor` for a parameter file of the dynamics node."""

from collections.abc import Callable, Collection, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from kane_dynamics.analysis.model_checks import Finding, listed
from kane_dynamics.control.quasi_static import flexible_robot, QuasiStatic
from kane_dynamics.errors import InputError, KaneError
from kane_dynamics.model.flexible_model import stiffened
from kane_dynamics.model.model import Model
from kane_dynamics.robot.robot import Robot
from kane_dynamics.ros.common.configuration_files import (load_model, PACKAGE, resolve_path,
                                                          robot_options)
from kane_dynamics.ros.monitors.contact_monitor import observed_frame
from kane_dynamics.ros.monitors.imu_gravity import GravityFromImu
from kane_dynamics.ros.monitors.optional_topics import check_optional_topics
from kane_dynamics.ros.parameters.parameter_checks import (controller_settings, FOREIGN, FRAMES,
                                                           per_joint, read, unknown_parameters,
                                                           with_prefix)
from kane_dynamics.ros.parameters.parameter_table import BY_NAME, SPECS
from kane_dynamics.ros.plant.plant_parameters import SPECS as PLANT_SPECS
from kane_dynamics.ros.torque_path.gravity_payload import parameter_loads
import numpy as np
import yaml

WILDCARD = '/**'  # parameters of all nodes
PLANT_PARAMETERS = frozenset(spec.name for spec in PLANT_SPECS)
# Values that disable the checks of check_optional_topics.
DISABLED: dict[str, Any] = {'wrench.frames': (), 'observer.enabled': False,
                            'estimator.enabled': False, 'explanation.rate': 0.0}


class ParameterBlock(NamedTuple):
    """The parameters of one node: `own`, and `given`, which includes the wildcard block."""

    node: str
    own: Mapping[str, Any]
    given: Mapping[str, Any]


def examine_configuration(path: Path, urdf: str, *, prefix: str = '', namespace: str = '',
                          told: Collection[str] = ()) -> tuple[list[Finding], Robot | None]:
    """
    Check a parameter file of the dynamics node; return the findings and the robot.

    Each block of a dynamics node is checked separately, with the robot that this node would load.

    Parameters
    ----------
    path : Path
        Path of the file.
    urdf : str
        URDF as text, for blocks that give none.
    prefix : str
        Overrides parameter prefix if it is not empty, as in the launch file.
    namespace : str
        Namespace of the node whose robot is returned.
    told : collection of str
        Warnings about the URDF that are not repeated.

    Returns
    -------
    findings : list of Finding
    robot : Robot or None
        The robot of the only node in the file, or of the node in the namespace, with gravity and
        payload of the file; None if there is no such node or it cannot be loaded.

    Raises
    ------
    InputError
        The file is not a ROS 2 parameter file, or has no block for a dynamics node.

    """
    found: list[Finding] = []
    robots: dict[str, Robot | None] = {}
    blocks = _blocks(path)
    for block in blocks:
        where = path.name if block.node == WILDCARD else f'{path.name}, {block.node}'
        examination = ConfigurationExamination(where, block)
        if block.node != WILDCARD or len(blocks) == 1:
            robots[block.node] = examination.robot(urdf, prefix, told)
        found += examination.found
    wanted = next(iter(robots)) if len(robots) == 1 else (
        '/'.join(['', *filter(None, namespace.split('/')), PACKAGE]))
    return found, robots.get(wanted)


class ConfigurationExamination:
    """
    Examination of one block of parameters.

    Parameters
    ----------
    where : str
        Prefix of the findings: the file and the node.
    block : ParameterBlock

    Attributes
    ----------
    found : list of Finding

    """

    def __init__(self, where: str, block: ParameterBlock) -> None:
        self._where, self._block = where, block
        self.found: list[Finding] = []
        for warning in unknown_parameters(list(block.own), BY_NAME):
            self._find('problem', warning)

    def robot(self, urdf: str, prefix: str, told: Collection[str]) -> Robot | None:
        """Check the block; return the robot that the node would load, None if it cannot."""
        values = {name: self._attempt(read, spec, self._block.given.get(name, spec.default))
                  for name, spec in BY_NAME.items()}
        if any(value is None for value in values.values()):
            return None
        values = with_prefix(values | {'prefix': prefix or values['prefix']})
        gravity = values['gravity']
        if gravity[2] > 0.0 or not np.isclose(np.linalg.norm(gravity), 9.81, 0.01):
            self._find('warning', f'gravity: {gravity.tolist()}; expected [0, 0, -9.81] for an '
                       'upright base')
        warnings: list[str] = []
        model = self._load(values, urdf, warnings)
        robot = None if model is None else self._fit(values, model)
        if not self.found:
            self._find('fine', 'all parameters are known and fit the arm')
        for warning in warnings:
            if warning not in told:
                self._find('warning', f'URDF: {warning}')
        return robot

    def _load(self, values: dict[str, Any], urdf: str, warnings: list[str]) -> Model | None:
        """Return the model; clear parameters in `values` whose files do not exist."""
        for name in ('urdf', 'supplement', 'constraints'):
            if values[name] and self._attempt(resolve_path, name, values[name]) is None:
                values[name] = ''
        source: str | Path = values['robot_description'] or (
            resolve_path('urdf', values['urdf']) if values['urdf'] else urdf)
        model: Model | None = self._attempt(load_model, source, values, warnings.append)
        return model

    def _fit(self, values: dict[str, Any], model: Model) -> Robot:
        """Check the parameters against the robot; return it, with rigid links."""
        rigid = stiffened(model)
        self._check_frames(values, rigid)
        options = self._attempt(robot_options, values) or {}
        robot: Robot = self._attempt(Robot, rigid, **options) or Robot(rigid)
        if model.flexible:
            self._attempt(lambda: QuasiStatic(flexible_robot(model, options)))
        joints = robot.joint_names
        for spec in SPECS:
            part = spec.name.partition('.')[0]
            if spec.kind == 'per_joint' and values.get(f'{part}.enabled', True):
                self._attempt(per_joint, values, spec.name, joints, 0.0)
        self._attempt(controller_settings, values, joints)
        for name in DISABLED:
            self._attempt(check_optional_topics, {**values, **DISABLED, name: values[name]}, robot)
        if values['imu.topic']:
            self._attempt(GravityFromImu, rigid, values['imu.frame'],
                          float(np.linalg.norm(values['gravity'])), values['imu.time_constant'],
                          lambda gravity: None)
        loads = self._attempt(parameter_loads, rigid, values)
        if loads is not None:
            loads.apply(robot)
        return robot

    def _check_frames(self, values: dict[str, Any], model: Model) -> None:
        """Report frames that do not exist, and replace them for the further checks."""
        unused = {'observer.frame': not values['observer.enabled'],
                  'imu.frame': not values['imu.topic']}
        replacement = {'payload.frame': model.bodies[-1].name, 'wrench.frames': ()}
        for name in FRAMES:
            value = values[name]
            frames = [value] if isinstance(value, str) else value
            unknown = [frame for frame in frames
                       if frame and frame not in {each.name for each in model.frames}]
            if unknown and not unused.get(name):
                self._find('problem', f"parameter '{name}': {listed(unknown)}; expected frames of "
                           + ', '.join(sorted(each.name for each in model.frames)))
                values[name] = replacement.get(name, '')
        if values['observer.enabled']:
            self._attempt(model.frame, observed_frame(values, model))

    def _attempt(self, check: Callable[..., Any], *arguments: Any, **keywords: Any) -> Any:
        """Return the result of `check`; report its error as a finding and return None."""
        try:
            return check(*arguments, **keywords)
        except KaneError as error:
            self._find('problem', str(error))
            return None

    def _find(self, level: Any, words: str) -> None:
        """Add a finding."""
        finding = Finding(level, f'{self._where}: {words}')
        if finding not in self.found:  # two checks may give the same finding
            self.found.append(finding)


def _blocks(path: Path) -> list[ParameterBlock]:
    """Return the parameter blocks of dynamics nodes, merged as in ROS 2."""
    try:
        data = yaml.safe_load(path.read_text(encoding='utf-8'))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise InputError(f'{path}: {error}') from None
    nodes = dict(_nodes('', data))
    ours = {node: own for node, own in nodes.items() if _is_ours(node, own)}
    if not ours:
        others = f'ros__parameters of {listed(nodes)}' if nodes else 'no ros__parameters'
        raise InputError(f'{path}: {others}; expected ros__parameters of a dynamics node, such as '
                         f'{PACKAGE}, or {WILDCARD}')
    shared = ours.get(WILDCARD, {})
    return [ParameterBlock(node, own, {**shared, **own}) for node, own in ours.items()]


def _nodes(node: str, data: Any) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield the full names of nodes and their parameters."""
    if not isinstance(data, Mapping):
        return
    for key, value in data.items():
        if key != 'ros__parameters':
            yield from _nodes(f"{node}/{str(key).strip('/')}", value)
        elif node and isinstance(value, Mapping):
            yield node, dict(_flat('', value))


def _flat(prefix: str, block: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """Yield the dotted names and the values of parameters."""
    for key, value in block.items():
        if isinstance(value, Mapping):
            yield from _flat(f'{prefix}{key}.', value)
        else:
            yield f'{prefix}{key}', value


def _is_ours(node: str, own: Mapping[str, Any]) -> bool:
    """Return whether a block is of a dynamics node, by name or by its parameters."""
    name = node.rpartition('/')[2]
    if node == WILDCARD or name == PACKAGE:
        return True
    given = {each for each in own if each.partition('.')[0] not in FOREIGN}
    known = len(given & BY_NAME.keys())
    return name != 'plant' and 2 * known > len(given) and known >= len(given & PLANT_PARAMETERS)
