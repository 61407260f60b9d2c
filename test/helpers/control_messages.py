"""The names and fields of control_msgs that the node uses; no wheel has them."""

from message_package import imported_package, package_environment

JOINT_COMMAND = """
std_msgs/Header header
string[] joint_names
string interface_name
float64[] values
"""
INTERFACE_VALUE = """
string[] interface_names
float64[] values
"""
DYNAMIC_INTERFACE_GROUP_VALUES = """
std_msgs/Header header
string[] interface_groups
control_msgs/InterfaceValue[] interface_values
"""
JOINT_TOLERANCE = """
string name
float64 position
float64 velocity
float64 acceleration
"""
JOINT_COMPONENT_TOLERANCE = """
uint16 X_AXIS = 1
uint16 Y_AXIS = 2
uint16 Z_AXIS = 3
uint16 TRANSLATION = 4
uint16 ROTATION = 5
string joint_name
uint16 component
float64 position
float64 velocity
float64 acceleration
"""
FOLLOW_JOINT_TRAJECTORY = """
trajectory_msgs/JointTrajectory trajectory
trajectory_msgs/MultiDOFJointTrajectory multi_dof_trajectory
control_msgs/JointTolerance[] path_tolerance
control_msgs/JointComponentTolerance[] component_path_tolerance
control_msgs/JointTolerance[] goal_tolerance
control_msgs/JointComponentTolerance[] component_goal_tolerance
builtin_interfaces/Duration goal_time_tolerance
---
int32 SUCCESSFUL = 0
int32 INVALID_GOAL = -1
int32 INVALID_JOINTS = -2
int32 OLD_HEADER_TIMESTAMP = -3
int32 PATH_TOLERANCE_VIOLATED = -4
int32 GOAL_TOLERANCE_VIOLATED = -5
int32 error_code
string error_string
---
std_msgs/Header header
string[] joint_names
trajectory_msgs/JointTrajectoryPoint desired
trajectory_msgs/JointTrajectoryPoint actual
trajectory_msgs/JointTrajectoryPoint error
string[] multi_dof_joint_names
trajectory_msgs/MultiDOFJointTrajectoryPoint multi_dof_desired
trajectory_msgs/MultiDOFJointTrajectoryPoint multi_dof_actual
trajectory_msgs/MultiDOFJointTrajectoryPoint multi_dof_error
"""
SOURCES = {
    'action/FollowJointTrajectory.action': FOLLOW_JOINT_TRAJECTORY,
    'msg/DynamicInterfaceGroupValues.msg': DYNAMIC_INTERFACE_GROUP_VALUES,
    'msg/InterfaceValue.msg': INTERFACE_VALUE,
    'msg/JointCommand.msg': JOINT_COMMAND,
    'msg/JointComponentTolerance.msg': JOINT_COMPONENT_TOLERANCE,
    'msg/JointTolerance.msg': JOINT_TOLERANCE,
}


def control_messages():
    """Build control_msgs; return the environment of processes that import it."""
    return package_environment('control_msgs', SOURCES)


def imported_control_messages():
    """Let this process and its children import control_msgs while a block runs."""
    return imported_package('control_msgs', SOURCES)
