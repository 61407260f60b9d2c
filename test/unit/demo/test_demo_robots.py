"""The robots of the demo: settings fit their files, MuJoCo closes loops."""

from kane_dynamics import load_constraints, load_urdf, Robot
from kane_dynamics.demo.demo_settings import FR3, RATE
from kane_dynamics.demo.director import parsed
from kane_dynamics.demo.tracking_report import torques_by_source
from moved_palletizer import PALLETIZER
import numpy as np
from palletizer import palletizer, positions
import pytest

pytest.importorskip('mujoco')

from kane_dynamics.demo.mujoco_plant import MujocoArm  # noqa: E402, I100


@pytest.mark.parametrize('demo', [FR3, PALLETIZER])
def test_a_demo_robot_names_its_joints_in_the_order_of_the_commands(demo):
    if demo.constraints is None:
        assert load_urdf(demo.urdf, joints=demo.joints).joint_names == demo.joints
        return
    robot = Robot(load_urdf(demo.urdf), **load_constraints(demo.constraints))
    assert tuple(robot.joint_names[k] for k in robot.equations.actuated) == demo.joints
    home = [demo.positions[joint] for joint in robot.joint_names]
    assert np.abs(robot.constraint_residual(home)).max() < 1e-12


@pytest.mark.parametrize('demo', [FR3, PALLETIZER])
def test_the_motion_of_a_demo_robot_stays_within_its_limits(demo):
    q, u, _ = demo.motion().sample(np.linspace(0.0, 8.0, 801))
    model = load_urdf(demo.urdf)
    for k, joint in enumerate(demo.joints):
        limits = model.coordinate_joints[model.joint_names.index(joint)].limits
        assert limits.lower < q[:, k].min() and q[:, k].max() < limits.upper
        assert np.abs(u[:, k]).max() < limits.velocity


def test_mujoco_with_equality_constraints_moves_the_palletizer_as_its_constraints_say():
    """Feedforward alone, without a servo, follows the motion for a second."""
    demo = PALLETIZER
    robot = palletizer()
    arm = MujocoArm(demo)
    motion = demo.motion()
    terms = torques_by_source(demo, motion, (np.arange(RATE) + 0.5) / RATE)
    for tau in terms.sum(axis=1):
        arm.step(tau)
    q, u = arm.state
    expected, rates, _ = motion.sample(1.0)
    assert np.abs(expected - demo.home).max() > 0.1
    np.testing.assert_allclose(q, expected, atol=2e-4)
    np.testing.assert_allclose(u, rates, atol=2e-3)
    every = positions(robot,
                      *(dict(zip(demo.joints, q))[name] for name in robot.speed_names))
    joint_positions = [arm.data.joint(name).qpos[0] for name in robot.joint_names]
    np.testing.assert_allclose(joint_positions, every, atol=1e-6)


@pytest.mark.parametrize('text', ['0.5', '1000', 'nan', 'long'])
def test_a_duration_out_of_range_is_refused(text, capsys):
    with pytest.raises(SystemExit):
        parsed(['--duration', text])
    assert 'duration' in capsys.readouterr().err
