"""
Start the dynamics node, with a simulated robot and robot_state_publisher if asked to.

    ros2 launch kane_dynamics kane_dynamics.launch.py config:=ur10e.yaml
    ros2 launch kane_dynamics kane_dynamics.launch.py config:=/my/arm.yaml namespace:=left
    ros2 launch kane_dynamics kane_dynamics.launch.py urdf:=/my/arm.urdf state_publisher:=true
    ros2 launch kane_dynamics kane_dynamics.launch.py config:=ur10e.yaml plant:=plant.yaml
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
    'prefix': ('', 'before the names of joints and frames in messages; wins over the files'),
    'commands': ('commands', 'topic of the torques; a controller has its own, <name>/commands'),
    'joint_states': ('joint_states', 'topic of the joint states'),
    'use_sim_time': ('false', 'take the time from /clock'),
    'plant': ('', 'parameter file of a simulated robot to start too; found as config is'),
    'state_publisher': ('false', 'start robot_state_publisher too; needs urdf:='),
}


def parameter_file(argument, name):
    """Return the path of a parameter file, given as such or by a name in share."""
    path = name if os.path.dirname(name) else os.path.join(
        get_package_share_directory(PACKAGE), 'config', name)
    if not os.path.isfile(path):
        raise FileNotFoundError(f"{argument} is '{path}', which does not exist")
    return path


def nodes(context):
    """Return the nodes to start, now that the arguments are known."""
    value = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    common = {'use_sim_time': value['use_sim_time'].lower() in ('true', '1', 'yes')}
    parameters = []
    if value['config']:
        parameters.append(parameter_file('config', value['config']))
    chosen = [{name: value[name]} for name in ('urdf', 'prefix') if value[name]]
    remappings = [(topic, value[topic]) for topic in ('commands', 'joint_states')
                  if value[topic] != topic]
    started = [Node(
        package=PACKAGE, executable='dynamics_node', name=PACKAGE, namespace=value['namespace'],
        parameters=[*parameters, *chosen, common], output='screen', remappings=remappings)]
    if value['plant']:
        started.append(Node(
            package=PACKAGE, executable='plant_node', name='plant', namespace=value['namespace'],
            parameters=[parameter_file('plant', value['plant']), *chosen,
                        {'publish_clock': common['use_sim_time']}],
            output='screen', remappings=remappings))
    if value['state_publisher'].lower() in ('true', '1', 'yes'):
        if not value['urdf'] or value['prefix']:
            raise ValueError('state_publisher:=true needs urdf:=, and knows no prefix')
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
