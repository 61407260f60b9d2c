"""A request of parameters changes the torque path at once, with one plan."""

from pathlib import Path
import subprocess
import sys

from kane_dynamics._util.resources import resource_path

PROGRAM = """
import sys
import rclpy
from kane_dynamics import Motion
from kane_dynamics.ros.dynamics_node.node import DynamicsNode
from rclpy.parameter import Parameter

given = ('urdf:=URDF', 'arm_compensates:=none', 'activation:=on_request',
         'torque_path:=native', 'mode:=computed_torque', 'payload.frame:=tip')
rclpy.init(args=['--ros-args', *[x for one in given for x in ('-p', one)]])
node = DynamicsNode()
node.trigger_configure()
node.trigger_activate()
arm = node.arm
path = arm.path
active = path.active_motion
joints = path.controller.followed
motion = Motion.from_points([0.0, 9.0], [[0.0, 0.0], [1.0, 1.0]], joint_names=joints)
now = path.now
assert active.follow(motion, now, now, active.generation)

plans = []
plan = path._plan

def seen():
    plans.append((str(path.controller.mode), active.scheduled[0] is not None
                  or active.scheduled[1] is not None, path._loads.payload is not None))
    return plan()

path._plan = seen
results = node.set_parameters_atomically([
    Parameter('mode', value='gravity_compensation'), Parameter('gains.kp', value=9.0),
    Parameter('limits.rate', value=50.0), Parameter('payload.mass', value=0.5)])
print(results.successful, results.reason, plans)
node.halt()
rclpy.shutdown()
"""


def test_a_change_of_mode_during_a_motion_is_one_plan():
    """The old law without its motion held the measured pose for a millisecond."""
    program = PROGRAM.replace('URDF', str(resource_path('urdf', 'two_link.urdf')))
    done = subprocess.run([sys.executable, '-c', program], capture_output=True,
                          text=True, timeout=100, cwd=Path(__file__).parents[3])
    assert done.stdout.strip() == "True  [('gravity_compensation', False, True)]", (
        done.stdout + done.stderr)


OWNERS = """
import rclpy
from kane_dynamics.ros.dynamics_node.node import DynamicsNode
from kane_dynamics.ros.parameters.live_parameters import owners_of
from kane_dynamics.ros.parameters.parameter_table import BY_NAME

given = ('urdf:=URDF', 'arm_compensates:=none', 'mode:=computed_torque',
         'modes:=[joint_impedance, cartesian_impedance, hand_guiding]',
         'observer.enabled:=true', 'observer.threshold:=9.0', 'wrench.frames:=[tip]',
         'payload.frame:=tip')
# Read where they are used: at a request, a goal, a timer.
LATER = {'trajectory', 'simulation', 'diagnostics_rate', 'closure', 'drives'}
rclpy.init(args=['--ros-args', *[x for one in given for x in ('-p', one)]])
node = DynamicsNode()
node.trigger_configure()
live = {name: name.partition('.')[0] for name, spec in BY_NAME.items() if spec.live}

class Noting(dict):
    def __getitem__(self, name):
        noted.add(live.get(name))
        return super().__getitem__(name)

for owner in node.arm.owners:
    noted = {None}
    for act in (owner.check, owner.use):
        act(Noting(node.values))
    if not noted - {None} <= owner.groups:
        print(owner.groups, 'does not name', noted - owner.groups)
for name, group in live.items():
    if group not in LATER and not owners_of(node.arm.owners, [name]):
        print('no owner of', name)
print('examined', len(node.arm.owners))
rclpy.shutdown()
"""


def test_each_part_names_the_groups_of_parameters_that_it_reads():
    """A change of one that it does not name would not reach it."""
    program = OWNERS.replace('URDF', str(resource_path('urdf', 'two_link.urdf')))
    done = subprocess.run([sys.executable, '-c', program], capture_output=True,
                          text=True, timeout=100, cwd=Path(__file__).parents[3])
    assert done.stdout.strip() == 'examined 10', done.stdout + done.stderr
