"""
Start the node, its guard and, optionally, a robot and robot_state_publisher.

    ros2 launch kane_dynamics kane_dynamics.launch.py params_file:=ur10e.yaml
    ros2 launch kane_dynamics kane_dynamics.launch.py params_file:=/my/arm.yaml namespace:=left
    ros2 launch kane_dynamics kane_dynamics.launch.py urdf:=/my/arm.urdf arm_compensates:=none
    ros2 launch kane_dynamics kane_dynamics.launch.py params_file:=ur10e.yaml plant:=plant.yaml
"""

import os

from ament_index_python.packages import get_package_share_directory
from kane_dynamics.ros.common.program_arguments import INVALID
from kane_dynamics.ros.common.transport import without_shared_memory
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, EmitEvent, LogInfo, OpaqueFunction
from launch.events import matches_action
from launch.events.process import ShutdownProcess
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import LifecycleNode, Node

PACKAGE = 'kane_dynamics'
MANAGER = 'lifecycle_manager_of_the_arm'
CONFIGURING = 120.0  # s for a transition: kernels compile when the node configures
RESPAWN_DELAY = 1.0  # s after which a node or a guard that ended starts again
# Arguments that describe the robot to the node and to the plant.
DESCRIPTION = ('urdf', 'supplement', 'constraints', 'arm_compensates', 'prefix')
ARGUMENTS = {
    'params_file': (
        '', 'parameter file: a path, or a file name in share/kane_dynamics/config'),
    'urdf': ('', 'path of the URDF; overrides the parameter files'),
    'arm_compensates': (
        '', 'terms that the arm adds itself, separated by commas, or none'),
    'supplement': (
        '', 'path of the supplement of the URDF; overrides the parameter files'),
    'constraints': (
        '', 'path of the constraints file of closed loops; overrides the files'),
    'activation': (
        '', 'on_request or at_once; default: at_once with plant:=, the simulated robot'),
    'namespace': ('', 'namespace of all nodes'),
    'prefix': (
        '', 'prefix of names of joints and frames; overrides the parameter files'),
    'commands': (
        'commands', 'topic of the commanded efforts, for example <controller>/commands'),
    'joint_states': ('joint_states', 'topic of the joint states'),
    'use_sim_time': (
        '', 'use time from /clock, which the plant publishes; overrides the files'),
    'lifecycle_manager': (
        'false',
        'start the lifecycle manager of Nav2, which activates the node, with a bond'),
    'guard': (
        'true', 'start torque_guard, which holds the arm when the node dies or hangs'),
    'monitor': (
        'false', 'start monitor_node with params_file: payload estimate, watch over the model'),
    'plant': ('', 'parameter file of a simulated robot to start, given like params_file'),
    'state_publisher': ('false', 'start robot_state_publisher; requires urdf:='),
}


def parameter_file(argument, name):
    """Return the path of a parameter file, given as a path or as a name in share."""
    path = name if os.path.dirname(name) else os.path.join(
        get_package_share_directory(PACKAGE), 'config', name)
    if not os.path.isfile(path):
        raise FileNotFoundError(
            f"{argument}: no file '{path}'; expected an existing file")
    return path


def truth(argument, text):
    """Return the value of a boolean argument."""
    known = {'true': True, '1': True, 'yes': True, 'false': False, '0': False,
             'no': False}
    if text.lower() not in known:
        raise ValueError(f"{argument}: '{text}'; expected true or false")
    return known[text.lower()]


def end_if_invalid(event, context):
    """
    Do not restart a node whose configuration is invalid: it would end again.

    Called when a node ended. `respawn` of launch regards no exit code, but ends with the
    process.
    """
    if event.returncode != INVALID:
        return []
    reason = (f'{event.process_name}: not started again, because its configuration is '
              'invalid, as it says above; correct it and launch again')
    shutdown = ShutdownProcess(process_matcher=matches_action(event.action))
    return [LogInfo(msg=reason), EmitEvent(event=shutdown)]


def nodes(context):
    """Return the nodes to start with the values of the arguments."""
    value = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    # Only given arguments override the parameter files.
    chosen = [{name: value[name]} for name in DESCRIPTION if value[name]]
    clock = []
    clock_source = []
    if value['use_sim_time']:
        simulated = truth('use_sim_time', value['use_sim_time'])
        clock = [{'use_sim_time': simulated}]
        clock_source = [{'publish_clock': simulated}]
    config = []
    if value['params_file']:
        config = [parameter_file('params_file', value['params_file'])]
    remappings = []
    for topic in ('commands', 'joint_states'):
        if value[topic] != topic:
            remappings.append((topic, value[topic]))
    guarded = truth('guard', value['guard'])
    chosen_activation = value['activation'] or (value['plant'] and 'at_once')
    activation = [{'activation': chosen_activation}] if chosen_activation else []
    managed = truth('lifecycle_manager', value['lifecycle_manager'])
    if managed and value['activation']:
        raise ValueError(f"activation: '{value['activation']}'; expected none with "
                         'lifecycle_manager:=true, which activates the node')
    if managed:
        activation = [{'autostart': False, 'bond': True}]
    started = [LifecycleNode(
        package=PACKAGE, executable='kane_dynamics', name=PACKAGE,
        namespace=value['namespace'],
        parameters=[*config, *chosen, *activation, *clock, {'guard.enabled': guarded}],
        output='screen', remappings=remappings, respawn=True,
        respawn_delay=RESPAWN_DELAY, on_exit=end_if_invalid,
        additional_env=without_shared_memory() if guarded else None)]
    if guarded:  # it reads the parameters of the dynamics node
        started.append(Node(
            package=PACKAGE, executable='torque_guard', name='torque_guard',
            namespace=value['namespace'], parameters=[{'node': PACKAGE}],
            output='screen',
            remappings=remappings, respawn=True, respawn_delay=RESPAWN_DELAY,
            on_exit=end_if_invalid))
    if truth('monitor', value['monitor']):
        started.append(Node(
            package=PACKAGE, executable='monitor_node', name='monitor_node',
            namespace=value['namespace'], output='screen', remappings=remappings,
            parameters=[*config, *chosen, *clock, {'node': PACKAGE}]))
    if managed:
        started.append(Node(
            package='nav2_lifecycle_manager', executable='lifecycle_manager',
            name=MANAGER, namespace=value['namespace'], output='screen',
            parameters=[{'autostart': True, 'node_names': [PACKAGE], 'bond_timeout': 4.0,
                         'service_timeout': CONFIGURING}, *clock]))
    if value['plant']:
        started.append(Node(
            package=PACKAGE, executable='plant_node', name='plant_node',
            namespace=value['namespace'],
            parameters=[parameter_file('plant', value['plant']), *chosen, *clock_source],
            output='screen', remappings=remappings))
    if truth('state_publisher', value['state_publisher']):
        if not value['urdf'] or value['prefix']:
            raise ValueError('state_publisher: true; expected urdf:= and no prefix:=')
        with open(value['urdf'], encoding='utf-8') as file:
            description = file.read()
        started.append(Node(
            package='robot_state_publisher', executable='robot_state_publisher',
            namespace=value['namespace'],
            parameters=[{'robot_description': description}, *clock],
            output='screen', remappings=remappings))
    return started


def generate_launch_description():
    """Return the launch description: the arguments and the nodes."""
    declared = []
    for name, (default, description) in ARGUMENTS.items():
        declared.append(
            DeclareLaunchArgument(name, default_value=default, description=description))
    return LaunchDescription([*declared, OpaqueFunction(function=nodes)])
