"""Models are changed without XML: tools, further models, locked joints, other names."""

from kane_dynamics import (ball, box, FlexibleLink, Inertial, InputError, load_urdf,
                           ModelBuilder, ModelError, ModelWarning, point_mass, pose_from,
                           Robot, with_locked, with_model, with_names, with_tool)
from kane_dynamics._util.resources import resource_path
from mechanisms import random_model
import numpy as np
from numpy.testing import assert_allclose
import pytest

ARM = load_urdf(resource_path('urdf', 'ur10e.urdf'))
GRIPPER = Inertial(0.9, (0.0, 0.01, 0.06), np.diag([2e-3, 2e-3, 1e-3]))


def test_a_tool_adds_its_mass_and_frames():
    model = with_tool(ARM, 'tool0', 'gripper', GRIPPER, at=(0, 0, 0.02), rpy=(0, 0, 0.4),
                      frames={'tcp': (0.0, 0.0, 0.15)})
    assert model.base_name == ARM.base_name and model.joint_names == ARM.joint_names
    robot = Robot(model)
    bare = Robot(ARM)
    q = bare.random_configuration(1)
    pose = bare.frame_pose('tool0', q)
    place = pose[:3, 3] + pose[:3, :3] @ [0, 0, 0.17]
    assert_allclose(robot.frame_pose('tcp', q)[:3, 3], place, atol=1e-14)
    com = place - pose[:3, :3] @ [0, 0, 0.15] + (
        robot.frame_pose('gripper', q)[:3, :3] @ GRIPPER.com)
    J = robot.jacobian('gripper', q)
    weight = np.array([0, 0, -9.81 * GRIPPER.mass])
    arm = com - robot.frame_pose('gripper', q)[:3, 3]
    assert_allclose(robot.gravity_force(q) - bare.gravity_force(q),
                    -J.T @ np.concatenate([weight, np.cross(arm, weight)]), atol=1e-12)


def test_arguments_of_a_tool_are_checked():
    with pytest.raises(ModelError, match="no body or frame 'flange9'"):
        with_tool(ARM, 'flange9', 'gripper', GRIPPER)
    with pytest.raises(ModelError, match="'tool0': exists already"):
        with_tool(ARM, 'wrist_3_link', 'tool0', GRIPPER)
    with pytest.raises(ModelError, match='principal moments'):
        with_tool(ARM, 'tool0', 'x', Inertial(1.0, (0, 0, 0), np.diag([1.0, 0.1, 0.1])))


def hand():
    """Return a gripper with a finger that slides, and one that mimics it."""
    b = ModelBuilder('hand')
    b.body('palm', kind='fixed', inertial=box(0.5, (0.1, 0.1, 0.1)))
    b.body('left', 'palm', 'prismatic', axis=(0, 1, 0), at=(0, 0, 0.1),
           inertial=point_mass(0.05))
    b.body('right', 'palm', 'prismatic', axis=(0, -1, 0), at=(0, 0, 0.1), mimic='left',
           inertial=point_mass(0.05))
    return b.model()


def test_a_model_on_a_frame_has_the_joints_of_both_models():
    model = with_model(ARM, hand(), 'tool0', rpy=(0, 0, 0.3), prefix='hand_')
    assert model.joint_names == (*ARM.joint_names, 'hand_left')
    robot = Robot(model)
    bare = Robot(ARM)
    q = np.append(bare.random_configuration(2), 0.02)
    between = (robot.frame_pose('hand_left', q)[:3, 3]
               + robot.frame_pose('hand_right', q)[:3, 3]) / 2
    pose = bare.frame_pose('tool0', q[:6])
    assert_allclose(between, pose[:3, 3] + 0.1 * pose[:3, 2], atol=1e-14)
    with pytest.raises(ModelError, match='exists already'):
        with_model(ARM, ARM, 'tool0')


@pytest.mark.parametrize('seed', range(4))
def test_a_locked_joint_is_one_that_does_not_move(seed):
    model = random_model(seed, 6, mimics=seed % 3)
    rng = np.random.default_rng(seed)
    names = [str(name) for name in rng.permutation(model.joint_names)[:2]]
    positions = dict(zip(names, rng.uniform(-1.0, 1.0, 2).tolist()))
    locked = Robot(with_locked(model, positions))
    whole = Robot(model)
    moving = [k for k, name in enumerate(model.joint_names) if name not in positions]
    assert locked.joint_names == tuple(model.joint_names[k] for k in moving)
    q, u, udot = np.zeros((3, model.n))
    q[moving], u[moving], udot[moving] = rng.uniform(-1.0, 1.0, (3, len(moving)))
    for name, position in positions.items():
        q[model.joint_names.index(name)] = position
    assert_allclose(locked.inverse_dynamics(q[moving], u[moving], udot[moving]),
                    whole.inverse_dynamics(q, u, udot)[moving], rtol=1e-9, atol=1e-9)
    for frame in model.frames:
        assert_allclose(locked.frame_pose(frame.name, q[moving]),
                        whole.frame_pose(frame.name, q), atol=1e-12)


def test_mimics_of_a_locked_joint_are_locked_and_balls_stay():
    b = ModelBuilder('carrier')
    b.body('lift', kind='prismatic', inertial=box(1.0, (0.1, 0.1, 0.1)))
    b.body('head', 'lift', 'ball', at=(0, 0, 0.2), inertial=box(2.0, (0.3, 0.2, 0.1)))
    b.mount(hand(), 'head', prefix='h_')
    model = with_locked(b.model(), {'lift': 0.5, 'h_left': 0.03})
    assert model.joint_names == ('head/wx', 'head/wy', 'head/wz')
    assert model.coordinate_names == ('head/qx', 'head/qy', 'head/qz', 'head/qw')
    robot = Robot(model)
    q = robot.random_configuration(3)
    whole = Robot(b.model())
    together = np.concatenate([[0.5], q, [0.03]])
    for frame in ('h_left', 'h_right', 'head'):
        assert_allclose(robot.frame_pose(frame, q), whole.frame_pose(frame, together),
                        atol=1e-14)
    with pytest.raises(InputError,
                       match=r"'head/wx' is no joint .*expected some of lift, h_left"):
        with_locked(b.model(), {'head/wx': 0.0})


def test_a_locked_root_becomes_the_base_and_beams_keep_their_modes():
    b = ModelBuilder('boom')
    b.body('turret', inertial=ball(3.0, 0.2))
    b.beam('boom', 'turret',
           FlexibleLink(length=1.0, density=0.8, stiffness=120.0, modes=(2, 0)),
           axis=(0, -1, 0))
    model = b.model()
    locked = with_locked(model, {'turret': 0.7})
    assert locked.base_inertial.mass == pytest.approx(3.0)
    rigid = Robot(locked)
    whole = Robot(model)
    q = np.array([0.2, 0.01, -0.005])
    assert_allclose(rigid.frame_pose('boom/tip', q),
                    whole.frame_pose('boom/tip', [0.7, *q]), atol=1e-14)
    assert_allclose(rigid.gravity_force(q), whole.gravity_force([0.7, *q])[1:],
                    atol=1e-12)


@pytest.mark.parametrize(('positions', 'words'), [
    ({'elbow': 0.0}, "'elbow' is no joint"),
    ({'elbow_joint': np.inf},
     "position of joint 'elbow_joint': inf; expected a finite number"),
    (dict.fromkeys(ARM.joint_names, 0.0), 'expected at least one joint that moves')])
def test_locking_an_unknown_dependent_or_last_joint_is_refused(positions, words):
    with pytest.raises(InputError, match=words):
        with_locked(ARM, positions)


def test_renaming_changes_names_only():
    names = {'shoulder_pan_joint': 'axis_1', 'tool0': 'flange_of_robot',
             'ur10e': 'left arm'}
    model = with_names(ARM, names)
    assert model.name == 'left arm' and model.joint_names[0] == 'axis_1'
    q = Robot(ARM).random_configuration(4)
    assert_allclose(Robot(model).frame_pose('flange_of_robot', q),
                    Robot(ARM).frame_pose('tool0', q), atol=0)
    assert_allclose(Robot(model).gravity_force(q), Robot(ARM).gravity_force(q), atol=0)
    with pytest.raises(InputError, match="names: 'shoulder' is no joint, body or frame"):
        with_names(ARM, {'shoulder': 'x'})
    with pytest.raises(ModelError, match='more than once'):
        with_names(ARM, {'elbow_joint': 'shoulder_pan_joint'})


def test_a_builder_goes_on_from_a_model():
    b = ModelBuilder.from_model(ARM)
    b.body('track', 'tool0', 'prismatic', axis=(0, 0, 1), inertial=point_mass(1.0))
    assert b.model().joint_names == (*ARM.joint_names, 'track')


@pytest.mark.parametrize('modes', [(1, 0), (2, 2)])
def test_a_beam_on_a_locked_joint_keeps_its_modes_and_its_load(modes):
    b = ModelBuilder('boom')
    b.body('turret', inertial=ball(3.0, 0.2))
    b.beam('boom', 'turret',
           FlexibleLink(length=1.0, density=0.8, stiffness=120.0, modes=modes),
           axis=(0, -1, 0), at=(0.1, 0.0, 0.3))
    b.body('load', 'boom/tip', axis=(0, 1, 0),
           inertial=box(0.5, (0.2, 0.1, 0.1), at=(0.1, 0, 0)))
    whole = Robot(b.model())
    rng = np.random.default_rng(0)
    for names in (['boom'], ['turret', 'boom']):
        positions = dict(zip(names, (0.4, -0.3)))
        clamped = Robot(with_locked(whole.model, positions))
        held = [whole.joint_names.index(name) for name in names]
        moving = [k for k in range(whole.n) if k not in held]
        assert clamped.joint_names == tuple(whole.joint_names[k] for k in moving)
        q, u, udot = np.zeros((3, whole.n))
        q[held] = list(positions.values())
        q[moving], u[moving], udot[moving] = 0.02 * rng.standard_normal((3, len(moving)))
        assert_allclose(clamped.inverse_dynamics(q[moving], u[moving], udot[moving]),
                        whole.inverse_dynamics(q, u, udot)[moving],
                        rtol=1e-9, atol=1e-11)
        assert_allclose(clamped.mass_matrix(q[moving]),
                        whole.mass_matrix(q)[np.ix_(moving, moving)],
                        rtol=1e-9, atol=1e-11)
        assert_allclose(clamped.frame_pose('load', q[moving]),
                        whole.frame_pose('load', q), atol=1e-14)


def test_locked_positions_in_degrees_are_warned_of():
    with pytest.warns(ModelWarning,
                      match=r"'elbow_joint' at 90, limits .*expected rad or m"):
        with_locked(ARM, {'elbow_joint': 90.0})


def test_orientations_in_degrees_are_warned_of():
    with pytest.warns(ModelWarning,
                      match="'gripper': rpy: 180 rad; .*are these degrees"):
        with_tool(ARM, 'tool0', 'gripper', GRIPPER, rpy=(180.0, 0.0, 0.0))
    with pytest.warns(ModelWarning, match='^rpy: 90 rad; .*are these degrees'):
        pose_from(rpy=(0.0, 0.0, 90.0))


@pytest.mark.parametrize(('inertial', 'place', 'words'), [
    (box(1.0, (0.1, 0.1, 0.1), at=(0.0, 0.0, 50.0)), {},
     "tool 'x': center of mass 50 m from its frame, .*expected m"),
    (GRIPPER, {'at': (0.0, 0.0, 120.0)}, "tool 'x': at 120 m from its frame"),
    (GRIPPER, {'frames': {'tcp': (0.0, 0.0, 150.0)}},
     "tool 'x': frame 'tcp' 150 m from its"),
    (box(1500.0, (0.1, 0.1, 0.1)), {},
     "tool 'x': 1500 kg, .*expected kg: are these grams?")])
def test_tools_in_millimeters_or_grams_are_warned_of(inertial, place, words):
    with pytest.warns(ModelWarning, match=words):
        with_tool(ARM, 'tool0', 'x', inertial, **place)


def test_a_body_fixed_beside_a_beam_is_warned_of():
    b = ModelBuilder('boom')
    b.beam('boom', 'world',
           FlexibleLink(length=1.0, density=0.8, stiffness=120.0, modes=(2, 0)))
    b.section('middle', 'boom', 0.5)
    model = b.model()
    root = r"along beam 'boom' in the axes of its root, .*expected the frame 'boom/tip'"
    with pytest.warns(ModelWarning, match=f"joint 'x': 0.8 m {root}") as warned:
        with_tool(model, 'boom', 'x', point_mass(1.0), at=(0.8, 0.0, 0.0))
    assert len(warned) == 1
    for call, words in ((lambda: b.frame('y', 'boom', at=(0.3, 0, 0)),
                         "frame 'y': 0.3 m"),
                        (lambda: b.load('boom', point_mass(1.0, (1, 0, 0))),
                         "inertia on 'boom': 1 m"),
                        (lambda: b.body('z', 'boom', at=(1, 0, 0)), "joint 'z': 1 m"),
                        (lambda: b.mount(ARM, 'boom', at=(1, 0, 0)), "model '.*': 1 m")):
        with pytest.warns(ModelWarning, match=f'{words} {root}'):
            call()
    # Warnings are errors: none of these is one.
    b.body('hub', 'boom', 'fixed', at=(0.0, 0.1, 0.0), inertial=point_mass(0.1))
    with_tool(model, 'boom/tip', 'x', point_mass(1.0), at=(0.1, 0.0, 0.0))
    with_tool(model, 'middle', 'x', point_mass(1.0), at=(0.1, 0.0, 0.0))


@pytest.mark.parametrize(('call', 'words'), [
    (lambda: with_locked(ARM, ['elbow_joint']),
     'positions: .*expected a mapping of joint names'),
    (lambda: with_names(ARM, None), 'names: None; expected a mapping of present names'),
    (lambda: with_tool(ARM, 'tool0', 'x', GRIPPER, frames=['tcp']),
     'frames: .*expected a mapping'),
    (lambda: with_model(ARM, ARM, 'tool0', prefix=None),
     'prefix: a NoneType; expected a str')])
def test_arguments_of_edits_that_are_no_mapping_or_text_are_named(call, words):
    with pytest.raises(InputError, match=words):
        call()
