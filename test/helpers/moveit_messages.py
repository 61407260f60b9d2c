"""The names and fields of tf2_msgs and moveit_msgs that the node uses."""

from contextlib import ExitStack

from message_package import imported_package

TF = {'msg/TFMessage.msg': 'geometry_msgs/TransformStamped[] transforms\n'}
MOVEIT = {
    'msg/CollisionObject.msg': """
std_msgs/Header header
geometry_msgs/Pose pose
string id
shape_msgs/SolidPrimitive[] primitives
geometry_msgs/Pose[] primitive_poses
shape_msgs/Mesh[] meshes
geometry_msgs/Pose[] mesh_poses
shape_msgs/Plane[] planes
geometry_msgs/Pose[] plane_poses
byte ADD=0
byte REMOVE=1
byte APPEND=2
byte MOVE=3
byte operation
""",
    'msg/AttachedCollisionObject.msg': """
string link_name
moveit_msgs/CollisionObject object
string[] touch_links
float64 weight
""",
    'msg/RobotState.msg': """
moveit_msgs/AttachedCollisionObject[] attached_collision_objects
bool is_diff
""",
    'msg/PlanningScene.msg': """
string name
moveit_msgs/RobotState robot_state
bool is_diff
""",
    'msg/PlanningSceneComponents.msg': """
uint32 SCENE_SETTINGS=1
uint32 ROBOT_STATE=2
uint32 ROBOT_STATE_ATTACHED_OBJECTS=4
uint32 components
""",
    'srv/GetPlanningScene.srv': """
moveit_msgs/PlanningSceneComponents components
---
moveit_msgs/PlanningScene scene
"""}


def imported_tf_and_moveit():
    """Let this process and its children import both packages in a block."""
    packages = ExitStack()
    packages.enter_context(imported_package('tf2_msgs', TF))
    packages.enter_context(imported_package('moveit_msgs', MOVEIT, ('shape_msgs',)))
    return packages
