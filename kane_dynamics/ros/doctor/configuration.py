"""The checks of `kane-dynamics doctor` for a parameter file of the dynamics node."""

from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from kane_dynamics.analysis.known_arms import EffortKind, words
from kane_dynamics.analysis.model_checks import Finding, listed
from kane_dynamics.control.quasi_static import flexible_robot, QuasiStatic
from kane_dynamics.control.terms import NO_TERM
from kane_dynamics.errors import InputError, KaneError
from kane_dynamics.identification.efforts import Efforts
from kane_dynamics.model.flexible_model import stiffened
from kane_dynamics.model.model import Model
from kane_dynamics.robot.robot import Robot
from kane_dynamics.ros.common.configuration_files import (load_model, PACKAGE,
                                                          resolve_path, robot_options)
from kane_dynamics.ros.common.parameter_files import parameter_blocks, WILDCARD
from kane_dynamics.ros.joint_trajectory_action.action_server import (
    FEEDBACK_MODES, follow_joint_trajectory_type)
from kane_dynamics.ros.loads.gravity_payload import parameter_loads
from kane_dynamics.ros.modes.task_modes import TaskModes
from kane_dynamics.ros.monitors.contact_monitor import UNCALIBRATED
from kane_dynamics.ros.monitors.imu_gravity import GravityFromImu
from kane_dynamics.ros.monitors.optional_topics import check_optional_topics
from kane_dynamics.ros.parameters.arm_statement import examine_statement
from kane_dynamics.ros.parameters.parameter_checks import (controller_settings, FOREIGN,
                                                           FRAMES, per_joint, read,
                                                           unknown_parameters,
                                                           with_prefix)
from kane_dynamics.ros.parameters.parameter_table import BY_NAME, SPECS
from kane_dynamics.ros.plant.plant_parameters import SPECS as PLANT_SPECS
import numpy as np

FILES = ('robot_description', 'urdf', 'supplement', 'constraints')
PLANT_PARAMETERS = frozenset(spec.name for spec in PLANT_SPECS)
# Values that disable the checks of check_optional_topics.
DISABLED: dict[str, Any] = {'wrench.frames': (), 'observer.enabled': False}


class ParameterBlock(NamedTuple):
    """
    The parameters of one node.

    `stated` are those of its block, `effective` those with the wildcard block's.
    """

    node: str
    stated: Mapping[str, Any]
    effective: Mapping[str, Any]


def examine_configuration(path: Path, urdf: str, *, prefix: str = '',
                          namespace: str = '',
                          told: Collection[str] = ()) -> tuple[list[Finding],
                                                               Robot | None]:
    """
    Check a parameter file of the dynamics node; return the findings and the robot.

    Each block of a dynamics node is checked separately, with the robot that this node
    would load.

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
        The robot of the only node in the file, or of the node in the namespace, with
        gravity and payload of the file; None if there is no such node or it cannot be
        loaded.

    Raises
    ------
    InputError
        The file is not a ROS 2 parameter file, or has no block for a dynamics node.

    """
    findings: list[Finding] = []
    robots: dict[str, Robot | None] = {}
    # Parameters of every node count where a file has nothing else.
    blocks = _blocks(path)
    for block in blocks:
        where = path.name if block.node == WILDCARD else f'{path.name}, {block.node}'
        examination = ConfigurationExamination(where, block)
        if block.node != WILDCARD or len(blocks) == 1:
            robots[block.node] = examination.robot(urdf, prefix, told)
        findings += examination.findings
    return findings, robots.get(_chosen_node(list(robots), namespace))


def configured_efforts(path: Path, namespace: str = '') -> Efforts | None:
    """
    Return the meaning of the efforts of joint states, by a parameter file.

    The result is None if the file does not say.

    Parameters
    ----------
    path : Path
        Path of the file.
    namespace : str
        Namespace of the node, if the file is of several.

    Raises
    ------
    InputError
        The file has no block for a dynamics node, or the parameters do not fit each
        other.

    """
    # A file may have blocks of several nodes; the wildcard is that of all others.
    blocks = {block.node: block.effective for block in _blocks(path)}
    if len(blocks) > 1:
        blocks.pop(WILDCARD, None)
    parameters = blocks.get(_chosen_node(list(blocks), namespace), {})
    if not any(name.startswith('efforts.') for name in parameters):
        return None

    def value(name: str) -> Any:
        spec = BY_NAME[name]
        return read(spec, parameters.get(name, spec.default))
    kind = value('efforts.kind')
    constants, scale = value('efforts.constants'), value('efforts.scale')
    if scale.size and kind in (EffortKind.MOTOR_CURRENT, EffortKind.MOTOR_TORQUE):
        # Efforts in another unit are to torques what currents are.
        constants = scale * constants if constants.size else scale
        kind = EffortKind.MOTOR_CURRENT
    return Efforts(kind, value('efforts.gravity'), constants if constants.size else None)


def _chosen_node(nodes: Sequence[str], namespace: str) -> str:
    """Return the only node, or the name of the node in a namespace."""
    if len(nodes) == 1:
        return nodes[0]
    parts = [part for part in namespace.split('/') if part]
    return '/'.join(['', *parts, PACKAGE])


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
    findings : list of Finding

    """

    def __init__(self, where: str, block: ParameterBlock) -> None:
        self._where = where
        self._block = block
        self.findings: list[Finding] = []
        self._loads = True  # whether the node would load the arm
        self._joints_known = True
        self._invalid: set[str] = set()  # parameters with invalid values
        self._check_node_name()
        for warning in unknown_parameters(list(block.stated), BY_NAME):
            self._find('problem', warning)

    def robot(self, urdf: str, prefix: str, told: Collection[str]) -> Robot | None:
        """
        Check the block.

        Return the robot that the node would load, None if it cannot.
        """
        values = self._read_values()
        # As the node reads its parameters, with the prefix of its joints.
        values = with_prefix(values | {'prefix': prefix or values['prefix']})
        gravity = values['gravity']
        if gravity[2] > 0.0 or not np.isclose(np.linalg.norm(gravity), 9.81, 0.01):
            self._find('warning',
                       f'gravity: {gravity.tolist()}; expected [0, 0, -9.81] for an '
                       'upright base')
        warnings: list[str] = []
        model = self._load(values, urdf, warnings)
        robot = None
        stated = values['arm_compensates']
        if model is not None:
            if 'arm_compensates' not in self._invalid:
                for contradiction in self._attempt(examine_statement, values,
                                                   model) or []:
                    self._find('warning', contradiction)
            values['arm_compensates'] = stated or (NO_TERM,)  # for the other checks
            robot = self._fit(values, model)
            self._compare_urdf(values, model, urdf)
        if not self.findings:
            self._find('fine', 'all parameters are known and fit the arm, which adds '
                       f'{words(stated)} to commanded efforts itself')
        self._describe_launch(values)
        self._describe_action(values)
        for warning in warnings:
            if warning not in told:
                self._find('warning', f'URDF: {warning}')
        return robot if self._loads else None

    def _read_values(self) -> dict[str, Any]:
        """
        Return the values of all parameters.

        Invalid ones are reported, and have defaults.
        """
        values = {}
        # A value that is wrong is reported, and the default examined in its place.
        for name, spec in BY_NAME.items():
            value = self._attempt(read, spec,
                                  self._block.effective.get(name, spec.default))
            if value is None:
                self._loads = False
                self._invalid.add(name)
                value = read(spec, spec.default)
            values[name] = value
        return values

    def _load(self, values: dict[str, Any], urdf: str,
              warnings: list[str]) -> Model | None:
        """
        Return the model; clear parameters in `values` whose files do not exist.

        If it cannot be loaded, return that of the whole arm, with which further
        parameters are checked.
        """
        for name in ('urdf', 'supplement', 'constraints'):
            if values[name] and self._attempt(resolve_path, name, values[name]) is None:
                values[name] = ''
                self._loads = False
        source: str | Path = values['robot_description'] or (
            resolve_path('urdf', values['urdf']) if values['urdf'] else urdf)
        model: Model | None = self._attempt(load_model, source, values, warnings.append)
        if model is not None:
            return model
        # Without what the file names, the URDF alone is examined.
        self._loads = self._joints_known = False
        values.update(joints=(), base='', tip='', root_joint='fixed', supplement='',
                      constraints='')
        try:
            return load_model(source, values, warnings.append)
        except KaneError:  # already reported
            return None

    def _compare_urdf(self, values: Mapping[str, Any], model: Model, urdf: str) -> None:
        """Report an examined URDF that is not the one that the parameters name."""
        parameter = 'robot_description' if values['robot_description'] else 'urdf'
        if not values[parameter]:
            return
        # Both are compared as models: other texts may describe the same arm.
        try:
            same = load_model(urdf, values,
                              lambda warning: None).digest() == model.digest()
        except KaneError:
            same = False
        if not same:
            what = f"'{values['urdf']}'" if parameter == 'urdf' else 'another URDF'
            self._find('problem',
                       f"parameter '{parameter}': {what} is loaded, not the examined "
                       'URDF; expected that of the same arm, or to launch with urdf:=')

    def _describe_launch(self, values: Mapping[str, Any]) -> None:
        """Report what a launch loads, for which node, and the parameters that count."""
        if not self._loads:
            return
        node = f'node {self._block.node}'
        if self._block.node == WILDCARD:
            node = 'every node'
        # The robot's description comes from the first of these.
        if values['robot_description']:
            source = 'the URDF of robot_description'
        elif values['urdf']:
            source = f"'{resolve_path('urdf', values['urdf'])}'"
        else:
            source = 'the URDF of the launch argument urdf or of topic robot_description'
        # Further files of the model, as far as they are stated.
        for name in ('supplement', 'constraints'):
            if values[name]:
                source += f", {name} '{resolve_path(name, values[name])}'"
        # Parameters that differ from their defaults are what a user has chosen.
        changed = []
        for name, value in self._block.effective.items():
            spec = BY_NAME.get(name)
            if spec is None or name in FILES:
                continue
            if not np.array_equal(read(spec, value), read(spec, spec.default)):
                changed.append(name)
        effect = 'all as by default'
        if changed:
            effect = f'other than default: {", ".join(changed)}'
        self._find('fine', f'{node} loads {source}; parameters {effect}')

    def _describe_action(self, values: Mapping[str, Any]) -> None:
        """Report that the action of trajectories is not served, where it could be."""
        if values['mode'] not in FEEDBACK_MODES:
            return
        try:
            follow_joint_trajectory_type()
        except InputError as error:
            self._find('fine', str(error))

    def _fit(self, values: dict[str, Any], model: Model) -> Robot:
        """Check the parameters against the robot; return it, with rigid links."""
        # Options first: without a valid robot, the rest is checked with a plain one.
        rigid = stiffened(model)
        self._check_frames(values, rigid)
        options = self._attempt(robot_options, values) or {}
        robot: Robot = self._attempt(Robot, rigid, **options) or Robot(rigid)
        # Each part of the node checks its own parameters, as at a start.
        if model.flexible:
            self._attempt(lambda: QuasiStatic(flexible_robot(model, options)))
        if self._joints_known:
            self._check_lists(values, robot.joint_names)
            self._attempt(TaskModes, robot, values)
        for name in DISABLED:
            self._attempt(check_optional_topics,
                          {**values, **DISABLED, name: values[name]}, robot)
        if values['observer.enabled'] and not values['observer.threshold'].size:
            self._find('warning', UNCALIBRATED)
        if values['imu.topic']:
            self._attempt(GravityFromImu, rigid,
                          float(np.linalg.norm(values['gravity'])),
                          values['imu.time_constant'], lambda gravity: None)
        loads = self._attempt(parameter_loads, rigid, values)
        if loads is not None:
            loads.apply(robot)
        return robot

    def _check_node_name(self) -> None:
        """Report a block that takes no effect because of its name."""
        name = self._block.node.rpartition('/')[2]
        if self._block.node != WILDCARD and name != PACKAGE:
            self._find('warning',
                       f'takes effect only for a node of this name (-r __node:={name})'
                       f'; expected {PACKAGE}, the name in the launch file')

    def _check_lists(self, values: Mapping[str, Any], joints: Sequence[str]) -> None:
        """Report lists that do not have an entry for every joint."""
        for spec in SPECS:
            part = spec.name.partition('.')[0]
            if spec.kind == 'per_joint' and values.get(f'{part}.enabled', True):
                self._attempt(per_joint, values, spec.name, joints, 0.0)
        self._attempt(controller_settings, values, joints)

    def _check_frames(self, values: dict[str, Any], model: Model) -> None:
        """Report frames that do not exist, and replace them for the further checks."""
        replacement = {'payload.frame': model.bodies[-1].name, 'wrench.frames': ()}
        known = sorted(frame.name for frame in model.frames)
        for name in FRAMES:
            frames = values[name]
            if isinstance(frames, str):
                frames = [frames]
            unknown = [frame for frame in frames if frame and frame not in known]
            if unknown:
                self._find('problem', f"parameter '{name}': {listed(unknown)}; expected "
                           f'frames of {", ".join(known)}')
                values[name] = replacement.get(name, '')

    def _attempt(self, check: Callable[..., Any], *arguments: Any,
                 **keywords: Any) -> Any:
        """
        Return the result of a check of parameters.

        Report its error as a finding and return None.
        """
        try:
            return check(*arguments, **keywords)
        except KaneError as error:
            self._find('problem', str(error))
            return None

    def _find(self, level: Any, words: str) -> None:
        """Add a finding."""
        finding = Finding(level, f'{self._where}: {words}')
        if finding not in self.findings:  # two checks may give the same finding
            self.findings.append(finding)


def _blocks(path: Path) -> list[ParameterBlock]:
    """Return the parameter blocks of dynamics nodes, merged as in ROS 2."""
    every_block = parameter_blocks(path)
    shared = every_block.get(WILDCARD, {})
    blocks = []
    # Entries of the wildcard hold for every node that does not state its own.
    for node, stated in every_block.items():
        if _is_ours(node, stated):
            blocks.append(ParameterBlock(node, stated, {**shared, **stated}))
    if not blocks:
        raise InputError(f'{path}: ros__parameters of {listed(every_block)}; expected '
                         f'ros__parameters of a dynamics node, such as {PACKAGE}, or '
                         f'{WILDCARD}')
    return blocks


def _is_ours(node: str, stated: Mapping[str, Any]) -> bool:
    """Return whether a block is of a dynamics node, by name or by its parameters."""
    node_name = node.rpartition('/')[2]
    if node == WILDCARD or node_name == PACKAGE:
        return True
    if node_name == 'plant_node':
        return False
    # By its parameters: more than half are known, and not more are those of a plant.
    names = {name for name in stated if name.partition('.')[0] not in FOREIGN}
    known = len(names & BY_NAME.keys())
    return 2 * known > len(names) and known >= len(names & PLANT_PARAMETERS)
