"""A floating base for any URDF: the joint between the world and the base link."""

from kane_dynamics import InputError, inverse_kinematics, load_urdf, Motion, Robot
from kane_dynamics.analysis.model_checks import examine_model
from kane_dynamics.cli import main
import numpy as np
from numpy.testing import assert_allclose
import pytest
from urdf_writer import joint, link, load, robot

LEGS = robot(
    link('trunk', 6.0, (0.1, 0.2, 0.25), xyz='0.02 0 0'),
    *(link(f'{side}_{part}', mass, (0.02, 0.02, 0.003), xyz='0 0 -0.1')
      for side in ('left', 'right') for part, mass in (('thigh', 1.2), ('shank', 0.5))),
    link('foot', None),
    joint('left_hip', 'trunk', 'left_thigh', axis='0 1 0', xyz='0 0.1 0'),
    joint('left_knee', 'left_thigh', 'left_shank', axis='0 1 0', xyz='0 0 -0.2',
          limit='<limit lower="-2.5" upper="-0.5" velocity="9" effort="30"/>'),
    joint('right_hip', 'trunk', 'right_thigh', axis='0 1 0', xyz='0 -0.1 0'),
    joint('right_knee', 'right_thigh', 'right_shank', axis='0 1 0', xyz='0 0 -0.2'),
    joint('sole', 'left_shank', 'foot', 'fixed', xyz='0 0 -0.2'))
LEG = ['left_hip', 'left_knee']


@pytest.fixture(scope='module')
def walker():
    """Return the robot with a free base."""
    return Robot(load(LEGS, root_joint='free'))


def test_a_free_base_has_the_dynamics_of_pinocchios_free_flyer(walker):
    pin = pytest.importorskip('pinocchio')
    peer = pin.buildModelFromXML(LEGS, pin.JointModelFreeFlyer())
    data = peer.createData()
    assert list(peer.names)[2:] == list(walker.joint_names[6:])
    rng = np.random.default_rng(0)
    for _ in range(5):
        q = walker.random_configuration(rng)
        udot = rng.normal(size=walker.n)
        R = walker.frame_pose('trunk', q)[:3, :3]
        # Pinocchio's linear velocity is on the axes of the trunk.
        turned = np.eye(walker.n)
        turned[:3, :3] = R.T
        still = np.zeros(walker.n)
        theirs = pin.rnea(peer, data, q, still, turned @ udot)
        assert_allclose(walker.inverse_dynamics(q, still, udot), turned.T @ theirs,
                        atol=1e-11)


def test_a_floating_base_has_the_mass_and_the_legs_of_the_fixed_one(walker):
    fixed = Robot(load(LEGS))
    angles = Robot(load(LEGS, root_joint='floating'))
    assert angles.joint_names == (*(f'root_joint/{x}'
                                    for x in ('x', 'y', 'z', 'rx', 'ry', 'rz')),
                                  *fixed.joint_names)
    legs = np.array([0.3, -1.0, -0.2, 0.4])
    for floating in (walker, angles):
        q = np.concatenate([floating.neutral()[:-4], legs])
        assert_allclose(floating.gravity_force(q)[6:], fixed.gravity_force(legs),
                        atol=1e-12)
        assert_allclose(floating.gravity_force(q)[2], 9.81 * (6.0 + 2 * 1.7), rtol=1e-12)
        assert floating.model.floating_base == floating.joint_names[:6]
    assert fixed.model.floating_base == ()
    assert load(LEGS, root_joint='planar').floating_base == ()


def test_a_floating_base_with_angles_has_motions():
    robot = Robot(load(LEGS, root_joint='floating'))
    q0 = robot.feasible_configuration()
    motion = Motion.from_points([0.0, 1.0], [q0, q0 + 0.2],
                                joint_names=robot.joint_names)
    assert np.isfinite(robot.inverse_dynamics(*motion.sample(0.5))).all()


@pytest.mark.parametrize(('options', 'words'), [
    ({'floating': 'quaternion'}, "no floating joint; expected root_joint='free'"),
    ({'root_joint': 'ball'}, "'ball'; expected one of fixed, free, floating, planar"),
    ({'root_joint': 'free', 'joints': LEG}, 'expected them among the joints that move'),
    ({'root_joint': 'free', 'base': 'tail'}, "base: 'tail' is no link"),
    ({'base': 'free'}, "base: 'free' is no link; expected root_joint='free'")])
def test_a_root_joint_that_cannot_be_added_is_refused(options, words):
    with pytest.raises(InputError, match=words):
        load(LEGS, **options)


def test_a_root_link_called_world_is_answered_with_the_base_to_choose():
    mounted = robot(link('world', None), link('trunk'), link('arm'),
                    joint('mount', 'world', 'trunk', 'fixed'),
                    joint('j', 'trunk', 'arm'))
    with pytest.raises(InputError, match='expected base= one of trunk'):
        load(mounted, root_joint='free')
    assert load(mounted, root_joint='free', base='trunk').n == 7


def test_a_foot_is_placed_by_its_leg_alone_or_with_the_base(walker):
    q0 = walker.feasible_configuration()
    target = walker.frame_pose('foot', q0)[:3, 3] + [0.05, 0.0, 0.03]
    leg = inverse_kinematics(walker, 'foot', target, q0, joints=LEG)
    assert leg.converged
    assert_allclose(walker.frame_pose('foot', leg.q)[:3, 3], target, atol=1e-8)
    moved = np.flatnonzero(leg.q != q0)
    assert [walker.coordinate_names[k] for k in moved] == LEG
    pose = walker.frame_pose('foot', walker.random_configuration(7))
    pose[:3, 3] += [5.0, 0.0, 0.0]  # out of reach without the base
    free = inverse_kinematics(walker, 'foot', pose, q0)
    assert free.converged
    assert_allclose(walker.frame_pose('foot', free.q), pose, atol=1e-8)
    assert np.linalg.norm(free.q[3:7]) == pytest.approx(1.0, abs=1e-15)
    assert not inverse_kinematics(
        walker, 'foot', pose, q0, joints=LEG, starts=3).converged
    with pytest.raises(InputError,
                       match=r"joints: \['knee'\]; expected some of root_joint/x"):
        inverse_kinematics(walker, 'foot', target, joints=['knee'])
    with pytest.raises(InputError,
                       match="joints: root_joint/wx of the ball joint 'root_joint'; "
                       'expected root_joint/wx, root_joint/wy, root_joint/wz together'):
        inverse_kinematics(walker, 'foot', target, joints=['root_joint/wx', *LEG])
    with pytest.raises(InputError, match='joints: 3; expected some of'):
        inverse_kinematics(walker, 'foot', target, joints=3)


def test_doctor_does_not_say_that_a_floating_robot_holds_itself(
        walker, tmp_path, capsys):
    words = [finding.words for finding in examine_model(walker.model, walker, [])]
    assert any(text.startswith("floating base on 'root_joint'") for text in words)
    assert not any('hold the arm' in text or 'root_joint/' in text for text in words)
    path = tmp_path / 'legs.urdf'
    path.write_text(LEGS)
    assert main(['doctor', str(path), '--root-joint', 'free']) == 0
    assert "floating base on 'root_joint'" in capsys.readouterr().out


@pytest.mark.parametrize('kind', ['free', 'floating'])
def test_commands_take_a_floating_base(kind, tmp_path, capsys):
    path = tmp_path / 'legs.urdf'
    path.write_text(LEGS)
    for command in (['torque'], ['simulate', '--duration', '0.1'], ['inspect']):
        assert main([command[0], str(path), '--root-joint', kind, *command[1:]]) == 0
    printed = capsys.readouterr().out
    # Of the center of mass; the trunk's moves a little.
    fallen = f'{-0.5 * 9.81 * 0.1**2:.6g}'
    assert 'root_joint/z' in printed and fallen[:5] in printed


def test_load_urdf_keeps_the_quaternion_of_a_floating_joint_in_the_file():
    floats = robot(link('a'), link('b'), joint('j', 'a', 'b', 'floating', limit=''))
    assert load_urdf(floats, floating='quaternion').coordinate_names[-1] == 'j/qw'
