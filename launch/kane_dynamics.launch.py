"""
Start the dynamics node, and robot_state_publisher with it if asked to.

    ros2 launch kane_dynamics kane_dynamics.launch.py config:=ur10e.yaml
    ros2 launch kane_dynamics kane_dynamics.launch.py config:=/my/arm.yaml namespace:=left
    ros2 launch kane_dynamics kane_dynamics.launch.py urdf:=/my/arm.urdf state_publisher:=true
"""

import os

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

PACKAGE = 'kane_dynamics'
ARGUMENTS = {
    'config': ('', 'parameter file: a path, or the name of one in share/kane_dynamics/config'),
    'urdf': ('', 'path of the URDF; wins over the parameter file'),
    'namespace': ('', 'namespace of all nodes'),
    'commands': ('commands', 'topic of the torques; a controller has its own, <name>/commands'),
    'joint_states': ('joint_states', 'topic of the joint states'),
    'use_sim_time': ('false', 'take the time from /clock'),
    'state_publisher': ('false', 'start robot_state_publisher too; needs urdf:='),
}


def nodes(context):
    """Return the nodes to start, now that the arguments are known."""
    value = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    common = {'use_sim_time': value['use_sim_time'].lower() in ('true', '1', 'yes')}
    parameters = []
    if value['config']:
        config = value['config']
        if os.path.dirname(config) == '':
            config = os.path.join(get_package_share_directory(PACKAGE), 'config', config)
        if not os.path.isfile(config):
            raise FileNotFoundError(f"config is '{config}', which does not exist")
        parameters.append(config)
    if value['urdf']:
        parameters.append({'urdf': value['urdf']})
    started = [Node(
        package=PACKAGE, executable='dynamics_node', name=PACKAGE, namespace=value['namespace'],
        parameters=[*parameters, common], output='screen',
        remappings=[(topic, value[topic]) for topic in ('commands', 'joint_states')
                    if value[topic] != topic])]
    if value['state_publisher'].lower() in ('true', '1', 'yes'):
        if not value['urdf']:
            raise ValueError('state_publisher:=true needs urdf:=')
        with open(value['urdf'], encoding='utf-8') as file:
            description = file.read()
        started.append(Node(
            package='robot_state_publisher', executable='robot_state_publisher',
            namespace=value['namespace'],
            parameters=[{'robot_description': description}, common], output='screen'))
    return started


def generate_launch_description():
    """Declare the arguments; the nodes follow from their values."""
    declared = [DeclareLaunchArgument(name, default_value=default, description=description)
                for name, (default, description) in ARGUMENTS.items()]
    return LaunchDescription([*declared, OpaqueFunction(function=nodes)])
