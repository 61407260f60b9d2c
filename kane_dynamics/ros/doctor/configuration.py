"""What `kane-dynamics doctor` finds in a parameter file of the dynamics node."""

from collections.abc import Callable, Collection, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from kane_dynamics.analysis.model_checks import Finding, listed
from kane_dynamics.control.quasi_static import QuasiStatic
from kane_dynamics.errors import InputError, KaneError
from kane_dynamics.model.flexible_model import stiffened
from kane_dynamics.model.model import Model
from kane_dynamics.robot.robot import Robot
from kane_dynamics.ros.common.configuration_files import load, load_choices, located, OURS
from kane_dynamics.ros.monitors.contact_monitor import observed_frame
from kane_dynamics.ros.monitors.imu_gravity import GravityFromImu
from kane_dynamics.ros.monitors.optional_topics import check_optional_topics
from kane_dynamics.ros.parameters.parameter_checks import (controller_settings, FOREIGN, FRAMES,
                                                           in_messages, misspelt, per_joint, read)
from kane_dynamics.ros.parameters.parameter_table import BY_NAME, SPECS
from kane_dynamics.ros.plant.plant_parameters import SPECS as PLANT_SPECS
from kane_dynamics.ros.torque_path.gravity_payload import start_loads
import numpy as np
import yaml

EVERY = '/**'  # the block of every node
OF_PLANT = frozenset(spec.name for spec in PLANT_SPECS)
# What turns off each part that check_optional_topics looks at.
OFF: dict[str, Any] = {'wrench.frames': (), 'observer.enabled': False,
                       'estimator.enabled': False, 'explanation.rate': 0.0}


class Block(NamedTuple):
    """The parameters of one node: those under its name, and with those of every node below."""

    node: str
    own: Mapping[str, Any]
    given: Mapping[str, Any]


def examine_configuration(path: Path, urdf: str, *, prefix: str = '', namespace: str = '',
                          told: Collection[str] = ()) -> tuple[list[Finding], Robot | None]:
    """
    Return what is wrong with a parameter file of the dynamics node, and the robot it describes.

    Each block for a dynamics node is examined by itself, with the robot that the node would load.

    Parameters
    ----------
    path : Path
        Of the file.
    urdf : str
        Text of the URDF for the blocks that name none.
    prefix : str
        Wins over that of the file where it is not empty, as the launch file has it.
    namespace : str
        In which the node runs whose robot is wanted.
    told : collection of str
        Remarks about the URDF that need not be repeated.

    Returns
    -------
    findings : list of Finding
    robot : Robot or None
        Of the only node in the file, or of the one in the namespace; None if there is no such, or
        if it cannot be loaded. It has the gravity and the payload of the file.

    Raises
    ------
    InputError
        The file is no parameter file of ROS 2, or has nothing for a dynamics node.

    """
    found: list[Finding] = []
    robots: dict[str, Robot | None] = {}
    blocks = _blocks(path)
    for block in blocks:
        where = path.name if block.node == EVERY else f'{path.name}, {block.node}'
        examination = ConfigurationExamination(where, block)
        if block.node != EVERY or len(blocks) == 1:
            robots[block.node] = examination.robot(urdf, prefix, told)
        found += examination.found
    wanted = next(iter(robots)) if len(robots) == 1 else (
        '/'.join(['', *filter(None, namespace.split('/')), OURS]))
    return found, robots.get(wanted)


class ConfigurationExamination:
    """
    Looks at one block of parameters.

    Parameters
    ----------
    where : str
        What to name in the findings: the file, and the node.
    block : Block

    Attributes
    ----------
    found : list of Finding

    """

    def __init__(self, where: str, block: Block) -> None:
        self._where, self._block = where, block
        self.found: list[Finding] = []
        for remark in misspelt(list(block.own), BY_NAME):
            self._find('problem', remark)

    def robot(self, urdf: str, prefix: str, told: Collection[str]) -> Robot | None:
        """Examine all; return the robot that the node would load, None if it would not."""
        values = {name: self._attempt(read, spec, self._block.given.get(name, spec.default))
                  for name, spec in BY_NAME.items()}
        if any(value is None for value in values.values()):
            return None
        values = in_messages(values | {'prefix': prefix or values['prefix']})
        gravity = values['gravity']
        if gravity[2] > 0.0 or not np.isclose(np.linalg.norm(gravity), 9.81, 0.01):
            self._find('doubt', f'gravity is {gravity.tolist()}; on the ground, with the base '
                       'upright, it is [0, 0, -9.81]')
        remarks: list[str] = []
        model = self._load(values, urdf, remarks)
        robot = None if model is None else self._fit(values, model)
        if not self.found:
            self._find('fine', 'every parameter is known and fits the arm')
        for remark in remarks:
            if remark not in told:
                self._find('doubt', f'URDF: {remark}')
        return robot

    def _load(self, values: dict[str, Any], urdf: str, remarks: list[str]) -> Model | None:
        """Return the model; files that do not exist are left out of `values`."""
        for name in ('urdf', 'supplement', 'constraints'):
            if values[name] and self._attempt(located, name, values[name]) is None:
                values[name] = ''
        source: str | Path = values['robot_description'] or (
            located('urdf', values['urdf']) if values['urdf'] else urdf)
        model: Model | None = self._attempt(load, source, values, remarks.append)
        return model

    def _fit(self, values: dict[str, Any], model: Model) -> Robot:
        """Return the robot, its beams rigid; say what of the parameters does not fit it."""
        rigid = stiffened(model)
        self._check_frames(values, rigid)
        choices = self._attempt(load_choices, values) or {}
        robot: Robot = self._attempt(Robot, rigid, **choices) or Robot(rigid)
        if model.flexible:
            self._attempt(lambda: QuasiStatic(Robot(model, **choices)))
        joints = robot.joint_names
        for spec in SPECS:
            part = spec.name.partition('.')[0]
            if spec.kind == 'per_joint' and values.get(f'{part}.enabled', True):
                self._attempt(per_joint, values, spec.name, joints, 0.0)
        self._attempt(controller_settings, values, joints)
        for name in OFF:
            self._attempt(check_optional_topics, {**values, **OFF, name: values[name]}, robot)
        if values['imu.topic']:
            self._attempt(GravityFromImu, rigid, values['imu.frame'],
                          float(np.linalg.norm(values['gravity'])), values['imu.time_constant'],
                          lambda gravity: None)
        loads = self._attempt(start_loads, rigid, values)
        if loads is not None:
            loads.apply(robot)
        return robot

    def _check_frames(self, values: dict[str, Any], model: Model) -> None:
        """Say which frames do not exist, and put others in their place for what follows."""
        unused = {'observer.frame': not values['observer.enabled'],
                  'imu.frame': not values['imu.topic']}
        stand_in = {'payload.frame': model.bodies[-1].name, 'wrench.frames': ()}
        for name in FRAMES:
            value = values[name]
            frames = [value] if isinstance(value, str) else value
            strangers = [frame for frame in frames
                         if frame and frame not in {each.name for each in model.frames}]
            if strangers and not unused.get(name):
                self._find('problem', f"parameter '{name}' names {listed(strangers)}; valid: "
                           + ', '.join(sorted(each.name for each in model.frames)))
                values[name] = stand_in.get(name, '')
        if values['observer.enabled']:
            self._attempt(model.frame, observed_frame(values, model))

    def _attempt(self, check: Callable[..., Any], *arguments: Any, **keywords: Any) -> Any:
        """Return what `check` does; None if it raised, which is a finding then."""
        try:
            return check(*arguments, **keywords)
        except KaneError as error:
            self._find('problem', str(error))
            return None

    def _find(self, level: Any, words: str) -> None:
        finding = Finding(level, f'{self._where}: {words}')
        if finding not in self.found:  # two checks may see the same
            self.found.append(finding)


def _blocks(path: Path) -> list[Block]:
    """Return the blocks for dynamics nodes, as ROS 2 would give them to these."""
    try:
        data = yaml.safe_load(path.read_text(encoding='utf-8'))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise InputError(f'{path}: {error}') from None
    nodes = dict(_nodes('', data))
    ours = {node: own for node, own in nodes.items() if _is_ours(node, own)}
    if not ours:
        others = f'; it has those of {listed(nodes)}' if nodes else ''
        raise InputError(f'{path}: no ros__parameters under the name of a dynamics node, such as '
                         f'{OURS}, or {EVERY}{others}')
    return [Block(node, own, {**ours.get(EVERY, {}), **own}) for node, own in ours.items()]


def _nodes(node: str, data: Any) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield the parameters in what a file holds, by the full names of the nodes."""
    if not isinstance(data, Mapping):
        return
    for key, value in data.items():
        if key != 'ros__parameters':
            yield from _nodes(f"{node}/{str(key).strip('/')}", value)
        elif node and isinstance(value, Mapping):
            yield node, dict(_flat('', value))


def _flat(prefix: str, block: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """Yield parameters by their dotted names."""
    for key, value in block.items():
        if isinstance(value, Mapping):
            yield from _flat(f'{prefix}{key}.', value)
        else:
            yield f'{prefix}{key}', value


def _is_ours(node: str, own: Mapping[str, Any]) -> bool:
    """Return whether a block is for a dynamics node, by the node's name or by what is in it."""
    name = node.rpartition('/')[2]
    if node == EVERY or name == OURS:
        return True
    given = {each for each in own if each.partition('.')[0] not in FOREIGN}
    known = len(given & BY_NAME.keys())
    return name != 'plant' and 2 * known > len(given) and known >= len(given & OF_PLANT)
