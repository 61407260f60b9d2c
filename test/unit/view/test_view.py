"""Viewer: shapes are at the robot's poses; arrows show joint loads."""

from dataclasses import replace
from functools import cache
from pathlib import Path

from kane_dynamics import InputError, load_urdf, ModelWarning, Robot, UrdfError
from kane_dynamics.kinematics.body_poses import body_poses
from kane_dynamics.model.link_shapes import shapes_of_bodies
from kane_dynamics.simulation.trajectory import Trajectory
from kane_dynamics.urdf.link_shapes import load_visuals
from kane_dynamics.view import Window
from kane_dynamics.view.load_arrows import LoadArrows
from mechanisms import random_model, random_state
import numpy as np
from palletizer import DRIVEN, palletizer, positions
import pytest
import trimesh

URDFS = Path(__file__).resolve().parents[3] / 'urdf'
ARM = """<robot name="arm"><material name="red"><color rgba="1 0 0 1"/></material>
<link name="base"/>
<link name="upper"><inertial><origin xyz="0.3 0 0"/><mass value="2"/>
  <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>
  <visual><origin xyz="0.3 0 0.1" rpy="0 0 1.5707963267948966"/><material name="red"/>
    <geometry><mesh filename="package://arm_description/meshes/bar.stl" scale="2 1 1"/></geometry>
  </visual>
  <visual><geometry><sphere radius="0.1"/></geometry></visual></link>
<link name="fore"><inertial><origin xyz="0.2 0 0"/><mass value="1"/>
  <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="tool"/>
<joint name="lift" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
  <origin xyz="0 0 0.5"/><limit lower="-2" upper="2" velocity="3" effort="50"/></joint>
<joint name="bend" type="revolute"><parent link="upper"/><child link="fore"/><axis xyz="0 1 0"/>
  <origin xyz="0.6 0 0"/><limit lower="-2" upper="2" velocity="3" effort="20"/></joint>
<joint name="flange" type="fixed"><parent link="fore"/><child link="tool"/>
  <origin xyz="0.4 0 0" rpy="0 0.7 0"/></joint></robot>"""  # noqa: E501


@cache
def tree():
    """Return a robot with revolute and prismatic joints and a mimic joint."""
    return Robot(random_model(4, n=5, mimics=1))


@pytest.fixture
def arm(tmp_path):
    """Return the path of the arm's URDF, two folders below a package with its mesh."""
    package = tmp_path / 'arm_description'
    (package / 'urdf').mkdir(parents=True)
    (package / 'meshes').mkdir()
    trimesh.creation.box((0.3, 0.1, 0.1)).export(package / 'meshes' / 'bar.stl')
    (package / 'urdf' / 'arm.urdf').write_text(ARM)
    return package / 'urdf' / 'arm.urdf'


def test_shapes_are_read_with_their_places_sizes_colours_and_files(arm):
    mesh, ball = load_visuals(arm)
    assert (mesh.link, mesh.kind, mesh.file) == (
        'upper', 'mesh', arm.parents[1] / 'meshes' / 'bar.stl')
    np.testing.assert_array_equal(mesh.color, [1.0, 0.0, 0.0])
    np.testing.assert_array_equal(mesh.size, [2.0, 1.0, 1.0])
    np.testing.assert_allclose(mesh.pose[:3],
                               [[0, -1, 0, 0.3], [1, 0, 0, 0], [0, 0, 1, 0.1]],
                               atol=1e-12)
    assert (ball.kind, ball.size.tolist(), ball.color) == ('sphere', [0.1], None)


def test_a_mesh_is_found_in_an_installed_package_or_named_and_left_out(arm, monkeypatch):
    with pytest.warns(ModelWarning, match=r'package://arm_description/meshes/bar\.stl'):
        assert [visual.kind for visual in load_visuals(ARM)] == ['sphere']
    (arm.parents[2] / 'share').mkdir()
    arm.parents[1].rename(arm.parents[2] / 'share' / 'arm_description')
    monkeypatch.setenv('AMENT_PREFIX_PATH', str(arm.parents[2]))
    assert load_visuals(ARM)[0].file == (
        arm.parents[2] / 'share' / 'arm_description' / 'meshes' / 'bar.stl')


def test_malformed_visuals_are_an_error_of_the_urdf():
    with pytest.raises(UrdfError):
        load_visuals(ARM.replace('radius="0.1"', 'radius="big"'))


def test_shapes_are_drawn_where_the_robots_frames_are(arm):
    robot = Robot(load_urdf(arm))
    q = np.array([0.4, -0.9])
    for link in ('base', 'upper', 'tool'):  # fixed, moving, merged into another's body
        stated = replace(load_visuals(arm)[0], link=link)
        body, visual = shapes_of_bodies(robot.model, [stated], 1.0)[0]
        np.testing.assert_allclose(body_poses(robot.model, q)[body] @ visual.pose,
                                   robot.frame_pose(link, q) @ stated.pose, atol=1e-14)
    q = random_state(tree().model, 1)[0]
    poses = body_poses(tree().model, q)
    for frame in ('frame0', 'frame5', 'base'):
        placed = tree().model.frame(frame)
        np.testing.assert_allclose(
            poses[placed.body][:3, :3] @ placed.translation + poses[placed.body][:3, 3],
            tree().frame_pose(frame, q)[:3, 3], atol=1e-13)


def test_rods_from_joint_to_joint_stand_for_links_that_look_like_nothing(arm):
    model = load_urdf(arm)
    shown = shapes_of_bodies(model, load_visuals(arm), 1.0)
    rods = {body: visual for body, visual in shown if visual.kind == 'cylinder'}
    assert set(rods) == {-1, 1}  # the upper arm has looks of its own
    np.testing.assert_allclose(rods[-1].pose[:3, 3], [0.0, 0.0, 0.25])
    assert rods[1].size[1] == pytest.approx(0.4)  # to the tool
    bare = []
    for _, visual in shapes_of_bodies(model, (), 1.0):
        if visual.kind == 'cylinder':
            bare.append(visual)
    assert [visual.size[1] for visual in bare] == pytest.approx([0.5, 0.6, 0.4])
    for file in URDFS.glob('*.urdf'):
        assert load_visuals(file)


def test_arrows_are_the_torques_and_reactions_at_their_joints():
    robot = tree()
    q = random_state(robot.model, 1)
    u = random_state(robot.model, 2)
    udot = random_state(robot.model, 3)
    tau = robot.inverse_dynamics(q, u, udot)
    loads = LoadArrows.along(robot, q, u, udot, tau, np.zeros(len(q)))
    np.testing.assert_array_equal(loads.reactions[1],
                                  robot.joint_reactions(q[1], u[1], udot[1]))
    scale = dict.fromkeys(('torques', 'forces', 'moments'), 2.0)
    drawn = loads.arrows(1, 0.5, scale)
    origins = body_poses(robot.model, q[1])[:-1, :3, 3]
    for kind, part in (('forces', slice(0, 3)), ('moments', slice(3, 6))):
        np.testing.assert_allclose(drawn[kind][:, 0], origins)
        np.testing.assert_allclose(drawn[kind][:, 1] - drawn[kind][:, 0],
                                   0.25 * loads.reactions[1][:, part])
    assert len(drawn['torques']) == robot.n  # none at the joint that follows another
    np.testing.assert_allclose(
        np.linalg.norm(np.diff(drawn['torques'], axis=1), axis=(1, 2)),
        0.25 * np.abs(tau[1]))
    long = loads.arrows(
        int(np.argmax(np.abs(loads.reactions[..., 3:]).sum(axis=(1, 2)))), 1.0,
        loads.largest)
    for arrows in long.values():
        lengths = np.linalg.norm(np.diff(arrows, axis=1), axis=-1)
        assert lengths.max(initial=0.0) <= 1.0 + 1e-12


def test_arrows_of_contacts_begin_where_these_touch():
    robot = tree()
    q = random_state(robot.model, 1)[:1]
    still = np.zeros_like(q)
    contacts = np.array([[[[0.1, 0.2, 0.3], [1.0, 1.0, 1.0]],
                          [[0.0, 0.0, 8.0], [0.0, 0.0, 0.0]]]])
    loads = LoadArrows.along(robot, q, still, still, still, np.zeros(1), contacts)
    assert loads.largest['contacts'] == 8.0 and not loads.reactions.any()
    arrow, = loads.arrows(0, 0.5, loads.largest)['contacts']
    np.testing.assert_allclose(arrow, [[0.1, 0.2, 0.3], [0.1, 0.2, 0.8]])


def test_at_rest_the_base_carries_the_weight_and_torques_hold_it_up(arm):
    loads = LoadArrows.at_rest(Robot(load_urdf(arm)), np.array([[0.3, 0.2]]))
    np.testing.assert_allclose(loads.reactions[0, 0, :3], [0.0, 0.0, 3 * 9.81],
                               atol=1e-12)
    arrows = loads.arrows(0, 1.0, loads.largest)
    up = arrows['torques'][:, 1] - arrows['torques'][:, 0]  # x turns to z about -y
    np.testing.assert_allclose(up / np.linalg.norm(up, axis=1)[:, None],
                               [[0, -1, 0]] * 2, atol=1e-12)
    assert np.linalg.norm(up[0]) == pytest.approx(1.0)
    rounding = replace(loads, reactions=loads.reactions * [1, 1, 1, 1e-14, 1e-14, 1e-14])
    assert rounding.largest['moments'] == 0.0
    assert rounding.arrows(0, 1.0, rounding.largest)['moments'].shape == (0, 2, 3)


def test_a_window_refuses_what_it_cannot_show(arm):
    robot = Robot(load_urdf(arm))
    other_trajectory = Trajectory.along(tree(), np.arange(3.0), *np.zeros((3, 3, 5)))
    with pytest.raises(InputError, match='lift'):
        Window(robot, other_trajectory, port=0)
    with pytest.raises(InputError, match=r"host: 'no\.such\.host\.invalid'"):
        Window(robot, host='no.such.host.invalid', port=0)
    with pytest.raises(InputError, match='port: 70000'):
        Window(robot, port=70000)
    (arm.parents[1] / 'meshes' / 'bar.stl').write_text('no mesh')
    with pytest.raises(InputError, match=r'bar\.stl'):
        Window(robot, visuals=load_visuals(arm), port=0)


def test_sliders_of_a_closed_loop_are_those_of_its_motors_and_keep_it_closed():
    robot = palletizer()
    window = Window(robot, port=0)
    try:
        assert [robot.joint_names[k] for k in window._turned] == list(DRIVEN)
        for name, value in zip(DRIVEN, (0.3, 0.2, 0.1, -0.4)):
            window._turn(robot.joint_names.index(name), value)
        np.testing.assert_allclose(window._q, positions(robot, 0.3, 0.2, 0.1, -0.4),
                                   atol=1e-9)
    finally:
        window.close()
    loads = LoadArrows.at_rest(robot, window._q[None])
    driven = [robot.joint_names.index(name) for name in DRIVEN]
    np.testing.assert_allclose(loads.tau[0][driven], robot.gravity_force(window._q),
                               atol=1e-9)
