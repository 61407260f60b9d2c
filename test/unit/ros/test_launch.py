"""The launch file: the nodes that it starts, and their parameters."""

import importlib.util
from pathlib import Path
import re
import sys
from types import ModuleType, SimpleNamespace

from kane_dynamics.ros.common.program_arguments import INVALID
from kane_dynamics.ros.common.transport import without_shared_memory
from kane_dynamics.ros.dynamics_node.manager_bond import TIMEOUT
import pytest
import yaml

ROOT = Path(__file__).parents[3]
PLANT = ROOT / 'config' / 'plant.yaml'
LAUNCH = ROOT / 'launch' / 'kane_dynamics.launch.py'


class Recorder:
    """A replacement of a launch class that keeps its arguments."""

    def __init__(self, *arguments, **keywords):
        self.arguments = arguments
        self.keywords = keywords


class Configuration(Recorder):
    """A replacement of LaunchConfiguration with a dict as context."""

    def perform(self, context):
        return context[self.arguments[0]]


def load():
    spec = importlib.util.spec_from_file_location('launch_file', LAUNCH)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def launch_file(monkeypatch):
    """Return the launch file, loaded with recorders instead of launch."""
    modules = {'launch': {'LaunchDescription': Recorder},
               'launch.actions': dict.fromkeys(
                   ('DeclareLaunchArgument', 'EmitEvent', 'LogInfo', 'OpaqueFunction'),
                   Recorder), 'launch.events': {'matches_action': Recorder},
               'launch.events.process': {'ShutdownProcess': Recorder},
               'launch.substitutions': {'LaunchConfiguration': Configuration},
               'launch_ros': {},
               'launch_ros.actions': {'LifecycleNode': Recorder, 'Node': Recorder},
               'ament_index_python': {}, 'ament_index_python.packages': {
                   'get_package_share_directory': lambda package: str(ROOT)}}
    for name, members in modules.items():
        module = ModuleType(name)
        vars(module).update(members)
        monkeypatch.setitem(sys.modules, name, module)
    return load()


def start(launch_file, **arguments):
    """Return the nodes that start with some arguments."""
    description = launch_file.generate_launch_description().arguments[0]
    context = {action.arguments[0]: action.keywords['default_value']
               for action in description[:-1]}
    assert set(arguments) <= set(context)
    started = description[-1].keywords['function'](context | arguments)
    return [SimpleNamespace(**action.keywords) for action in started]


def test_by_default_it_starts_the_dynamics_node_and_its_guard(launch_file):
    node, guard = start(launch_file, namespace='left', commands='effort/commands')
    assert (node.package, node.executable) == ('kane_dynamics', 'kane_dynamics')
    assert node.parameters == [{'guard.enabled': True}]
    assert (guard.package, guard.executable, guard.namespace) == (
        'kane_dynamics', 'torque_guard', 'left')
    assert guard.parameters == [{'node': node.name}]
    assert guard.remappings == node.remappings == [('commands', 'effort/commands')]
    assert node.additional_env == without_shared_memory()


def test_the_monitor_has_the_parameters_of_the_arm(launch_file):
    node, _, monitor = start(launch_file, params_file='ur10e.yaml', monitor='true')
    assert (monitor.executable, monitor.name) == ('monitor_node', 'monitor_node')
    assert monitor.parameters == [*node.parameters[:-1], {'node': node.name}]


def test_without_guard_the_node_does_not_wait_for_it(launch_file):
    node, = start(launch_file, guard='false')
    assert node.parameters == [{'guard.enabled': False}]
    assert node.additional_env is None
    assert node.remappings == []


@pytest.mark.parametrize('path', sorted(set((ROOT / 'config').glob('*.yaml')) - {PLANT}),
                         ids=lambda path: path.stem)
def test_shipped_configurations_are_found_by_name(launch_file, path):
    node, _ = start(launch_file, params_file=path.name)
    assert Path(node.parameters[0]) == path


def test_a_node_or_guard_that_ends_starts_again(launch_file):
    for started in start(launch_file):
        assert started.respawn and started.respawn_delay == 1.0
        for code in (0, 1, -9, -11):
            ended = SimpleNamespace(returncode=code, action=started,
                                    process_name='node-1')
            assert started.on_exit(ended, None) == []


def test_a_node_with_an_invalid_configuration_does_not_start_again(launch_file):
    for started in start(launch_file):
        ended = SimpleNamespace(returncode=INVALID, action=started,
                                process_name='node-1')
        log, end = started.on_exit(ended, None)
        assert ('node-1: not started again, because its configuration is'
                in log.keywords['msg'])
        matcher = end.keywords['event'].keywords['process_matcher']
        assert matcher.arguments == (started,)


def test_files_of_the_arm_are_arguments_of_node_and_plant(launch_file):
    files = {'supplement': '/my/arm.supplement.yaml', 'constraints': '/my/loops.yaml'}
    node, _, plant = start(launch_file, plant='plant.yaml', **files)
    for name, path in files.items():
        assert {name: path} in node.parameters and {name: path} in plant.parameters
    assert {'activation': 'at_once'} in node.parameters
    assert {'activation': 'at_once'} not in plant.parameters
    node, _ = start(launch_file, params_file='ur10e.yaml')
    assert {'activation': 'at_once'} not in node.parameters


def test_urdf_overrides_the_configuration(launch_file):
    node, _ = start(launch_file, params_file='ur10e.yaml', urdf='/my/arm.urdf',
                    use_sim_time='true')
    assert node.parameters[1:3] == [{'urdf': '/my/arm.urdf'}, {'use_sim_time': True}]


def test_the_statement_of_what_the_arm_adds_holds_for_the_node_and_for_the_simulated_arm(
        launch_file):
    node, _, plant = start(launch_file, params_file='ur10e.yaml', plant='plant.yaml',
                           arm_compensates='gravity,friction')
    assert {'arm_compensates': 'gravity,friction'} in node.parameters
    assert {'arm_compensates': 'gravity,friction'} in plant.parameters


def test_a_lifecycle_manager_configures_the_node_and_keeps_a_bond(launch_file):
    node, _, manager = start(launch_file, params_file='ur10e.yaml', namespace='left',
                             lifecycle_manager='true')
    assert {'autostart': False, 'bond': True} in node.parameters
    assert (manager.package, manager.executable) == ('nav2_lifecycle_manager',
                                                     'lifecycle_manager')
    settings, = manager.parameters
    assert settings['node_names'] == [node.name] and settings['autostart']
    assert settings['bond_timeout'] == TIMEOUT and manager.namespace == 'left'
    with pytest.raises(ValueError, match="activation: 'at_once'; expected none with"):
        start(launch_file, lifecycle_manager='true', activation='at_once')


def test_the_branch_of_the_diagnostics_aggregator_names_what_the_nodes_publish():
    file = ROOT / 'config' / 'diagnostics' / 'aggregator.yaml'
    branch = yaml.safe_load(file.read_text())['/**']['ros__parameters']['analyzers']
    endings = set()
    for analyzer in branch.values():
        for end in analyzer['contains']:
            endings.add(end)
    sources = ''.join(path.read_text()
                      for path in (ROOT / 'kane_dynamics/ros').rglob('*_node.py'))
    sources += (ROOT / 'kane_dynamics/ros/dynamics_node/node.py').read_text()
    published = re.findall(r"get_fully_qualified_name\(\)\}(: [a-z ]+)'", sources)
    assert endings == set(published) and len(endings) == 3


def test_topics_are_remapped_and_namespaced(launch_file):
    node, _ = start(launch_file, commands='effort/commands', namespace='left')
    assert node.remappings == [('commands', 'effort/commands')]
    assert node.namespace == 'left'


def test_the_state_publisher_gets_the_same_urdf(launch_file):
    urdf = ROOT / 'urdf' / 'two_link.urdf'
    _, _, publisher = start(launch_file, urdf=str(urdf), state_publisher='true',
                            namespace='left', joint_states='arm/joint_states')
    assert publisher.package == 'robot_state_publisher'
    assert publisher.parameters == [{'robot_description': urdf.read_text()}]
    assert publisher.namespace == 'left'
    assert ('joint_states', 'arm/joint_states') in publisher.remappings


@pytest.mark.parametrize('sim_time', ['true', 'false'])
def test_the_plant_shares_names_and_publishes_the_clock_if_requested(
        launch_file, sim_time):
    node, _, plant = start(
        launch_file, params_file='ur10e.yaml', plant='plant.yaml', namespace='left',
        commands='effort/commands', use_sim_time=sim_time, prefix='left_')
    assert (plant.executable, plant.name, plant.namespace) == (
        'plant_node', 'plant_node', 'left')
    assert plant.remappings == node.remappings == [('commands', 'effort/commands')]
    path, prefix, clock = plant.parameters
    assert prefix == {'prefix': 'left_'}
    assert prefix in node.parameters
    assert Path(path) == PLANT
    assert clock == {'publish_clock': sim_time == 'true'}


def test_defaults_do_not_override_parameter_files(launch_file):
    node, _, plant, publisher = start(
        launch_file, params_file='ur10e.yaml', plant='plant.yaml',
        urdf=str(ROOT / 'urdf' / 'two_link.urdf'), state_publisher='true')
    for started in (node, plant, publisher):
        assert not any('clock' in name or 'use_sim_time' in name
                       for values in started.parameters if isinstance(values, dict)
                       for name in values)


def test_invalid_arguments_are_refused(launch_file):
    with pytest.raises(FileNotFoundError, match=r'nowhere\.yaml'):
        start(launch_file, params_file='nowhere.yaml')
    with pytest.raises(FileNotFoundError,
                       match=r"plant: no file '/nowhere/p\.yaml'; expected"):
        start(launch_file, plant='/nowhere/p.yaml')
    with pytest.raises(ValueError,
                       match="use_sim_time: 'maybe'; expected true or false"):
        start(launch_file, use_sim_time='maybe')
    with pytest.raises(ValueError, match='expected urdf:='):
        start(launch_file, state_publisher='true')
    with pytest.raises(ValueError, match='no prefix:='):
        start(launch_file, state_publisher='true', urdf='arm.urdf', prefix='left_')


def test_the_launch_file_loads_where_launch_is_installed():
    pytest.importorskip('launch')
    pytest.importorskip('launch_ros')
    assert load().generate_launch_description().entities
