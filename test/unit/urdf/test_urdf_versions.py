"""URDF 1.1 and 1.2: quaternions, capsules, and what `strict=False` takes."""

from kane_dynamics import load_urdf, Robot
from kane_dynamics.errors import ModelError, UrdfError
from kane_dynamics.urdf.link_shapes import load_collisions
import numpy as np
import pytest
from urdf_writer import joint, link, load_with_warnings, robot

R = 0.7071067811865476
QUATERNIONS = {'0 0 0 1': '0 0 0', f'{R} 0 0 {R}': '1.5707963267948966 0 0',
               f'0 {R} 0 {R}': '0 1.5707963267948966 0',
               '0.18257418583505536 0.3651483716701107 0.5477225575051661 '
               '0.7302967433402214': '0.7853981633974482 0.33983690945412187 '
                                     '1.4288992721907325'}


def arm(orientation, version='1.1'):
    """Return an arm whose origins, of joints and inertials, have an orientation."""
    inertia = ('<inertia ixx="0.03" iyy="0.002" izz="0.03" ixy="0.001" ixz="0" '
               'iyz="0.0005"/>')
    links = ['<link name="base"/>']
    joints = []
    for k, parent in ((1, 'base'), (2, 'l1'), (3, 'l2')):
        links.append(f'<link name="l{k}"><inertial>'
                     f'<origin xyz="0.2 0.1 0" {orientation}/>'
                     f'<mass value="2"/>{inertia}</inertial></link>')
        joints.append(f'<joint name="j{k}" type="revolute"><parent link="{parent}"/>'
                      f'<child link="l{k}"/><origin xyz="0.1 0 0.3" {orientation}/>'
                      '<axis xyz="0 0 1"/><limit lower="-2" upper="2" effort="9" '
                      'velocity="3"/></joint>')
    return robot(*links, *joints).replace('<robot ', f'<robot version="{version}" ')


@pytest.mark.parametrize('quaternion', QUATERNIONS)
def test_a_quaternion_is_the_rotation_of_its_roll_pitch_and_yaw(quaternion):
    by_quaternion = Robot(load_urdf(arm(f'quat_xyzw="{quaternion}"')))
    by_angles = Robot(load_urdf(arm(f'rpy="{QUATERNIONS[quaternion]}"')))
    q, u, udot = np.random.default_rng(3).normal(size=(3, 3))
    torque = by_quaternion.inverse_dynamics(q, u, udot)
    assert torque == pytest.approx(by_angles.inverse_dynamics(q, u, udot), abs=1e-12)
    # An independent rotation of the vector part: v + 2 w (p x v) + 2 p x (p x v).
    *p, w = map(float, quaternion.split())
    z = np.array([0.0, 0.0, 1.0])
    turned = z + 2.0 * w * np.cross(p, z) + 2.0 * np.cross(p, np.cross(p, z))
    pose = by_quaternion.frame_pose('l1', np.zeros(3))
    assert pose[:3, 2] == pytest.approx(turned, abs=1e-14)


@pytest.mark.parametrize('orientation, words', [
    ('quat_xyzw="0 0 0 1" rpy="0 0 0"', 'expected one of them'),
    ('quat_xyzw="0 0 0 2"', 'length 2'), ('quat_xyzw="0 0 0"', '4 finite numbers')])
def test_quaternions_that_state_no_rotation_are_refused(orientation, words):
    with pytest.raises(UrdfError, match=words):
        load_urdf(arm(orientation))


def test_a_file_that_is_not_strict_reads_version_1_0_without_quaternions():
    orientation = f'quat_xyzw="{R} 0 0 {R}"'
    model, texts = load_with_warnings(arm(orientation, version='1.0'), strict=False)
    assert any("'quat_xyzw'" in text for text in texts)
    plain = Robot(load_urdf(arm('rpy="0 0 0"')))
    q = np.array([0.3, -0.2, 0.5])
    assert Robot(model).gravity_force(q) == pytest.approx(plain.gravity_force(q))


def test_mass_without_inertia_is_a_point_mass_if_not_strict():
    source = robot('<link name="a"/>', '<link name="b"><inertial><origin xyz="0.5 0 0"/>'
                   '<mass value="3"/></inertial></link>', joint('j', 'a', 'b'))
    with pytest.raises(UrdfError, match='point mass'):
        load_urdf(source)
    model, texts = load_with_warnings(source, strict=False)
    assert any("no <inertia>: link 'b'" in text for text in texts)
    assert model.bodies[0].inertial.mass == 3.0
    assert not model.bodies[0].inertial.inertia.any()


def test_a_capsule_is_a_cylinder_with_half_spheres():
    shapes = load_collisions(robot(
        '<link name="a"><collision><origin xyz="1 0 0" '
        f'quat_xyzw="0 {R} 0 {R}"/><geometry><capsule radius="0.1" length="0.6"/>'
        '</geometry></collision></link>').replace('<robot ', '<robot version="1.1" '))
    assert [shape.kind for shape in shapes] == ['cylinder', 'sphere', 'sphere']
    assert shapes[0].size.tolist() == [0.1, 0.6]
    # Its axis is along x.
    ends = np.array([shape.pose[:3, 3] for shape in shapes[1:]])
    assert ends == pytest.approx(np.array([[0.7, 0, 0], [1.3, 0, 0]]), abs=1e-12)


def test_all_faults_of_a_file_are_found_at_once():
    source = robot(link('a'), link('b', moments=(-0.1, 0.1, 0.1)),
                   link('c', moments=(0.1, -0.1, 0.1)), joint('j', 'a', 'b'),
                   joint('k', 'b', 'c', limit='<limit lower="-1" upper="1" '
                                              'velocity="-2" effort="1"/>'))
    with pytest.raises(ModelError, match='3 faults') as caught:
        load_urdf(source)
    first, second, third = caught.value.faults
    assert "joint 'k'" in first
    assert "link 'b'" in second
    assert "link 'c'" in third
    with pytest.raises(UrdfError, match='2 faults') as caught:
        load_urdf(source.replace('velocity="-2"', 'velocity="x" lowr="1"'))
    assert [words in fault for words, fault in zip(
        ("velocity: 'x'", "attribute 'lowr'"), caught.value.faults)] == [True, True]
