"""Merging keeps mass, center of mass and inertia of the robot for any selection."""

from hypothesis import given, strategies as st
from kane_dynamics.model.model import Inertial, WORLD
from mechanisms import random_inertial
import numpy as np
from numpy.testing import assert_allclose
from urdf_writer import joint, load_with_warnings, robot

KINDS = ('revolute', 'continuous', 'prismatic', 'fixed', 'floating', 'planar')


def text(values):
    """Return numbers as attribute text with all digits."""
    return ' '.join(repr(float(value)) for value in values)


def random_urdf(seed, n, mimics=False):
    """Return a random tree as a URDF with all kinds of joints, and their names."""
    rng = np.random.default_rng(seed)
    parts = []
    for i in range(n + 1):
        body = random_inertial(rng)
        inertia = ' '.join(f'i{"xyz"[a]}{"xyz"[b]}="{body.inertia[a, b]!r}"'
                           for a in range(3) for b in range(a, 3))
        parts.append(f'<link name="l{i}"><inertial><origin xyz="{text(body.com)}"/>'
                     f'<mass value="{float(body.mass)!r}"/>'
                     f'<inertia {inertia.replace("np.float64(", "").replace(")", "")}/>'
                     '</inertial></link>')
    for i in range(1, n + 1):
        kind = KINDS[rng.integers(len(KINDS))]
        further_joints = ''
        if mimics and i > 1 and kind in KINDS[:3]:
            further_joints = (f'<mimic joint="j1" multiplier="{rng.normal()}" '
                              f'offset="{rng.normal()}"/>')
        kind = 'revolute' if i == 1 else kind
        parts.append(joint(f'j{i}', f'l{rng.integers(i)}', f'l{i}', kind,
                           limit='', more=further_joints,
                           axis=text(rng.normal(size=3)), xyz=text(rng.normal(size=3)),
                           rpy=text(rng.normal(size=3))))
    return robot(*parts)


def poses(model, q):
    """Return the poses of all bodies in the world."""
    pose_by_link = []
    for body in model.bodies:
        R, p = (np.eye(3),
                np.zeros(3)) if body.parent == WORLD else pose_by_link[body.parent]
        j = body.joint
        R, p = R @ j.rotation, p + R @ j.translation
        position = j.multiplier * q[j.coordinate] + j.offset
        if j.kind == 'prismatic':
            pose_by_link.append((R, p + R @ j.axis * position))
        else:
            x, y, z = j.axis
            K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
            pose_by_link.append((R @ (np.eye(3) + np.sin(position) * K
                                      + (1 - np.cos(position)) * K @ K), p))
    return pose_by_link


def whole(model, q):
    """Return the pseudo-inertia of the whole robot about the world's origin."""
    total = model.base_inertial.pseudo_inertia
    for body, (R, p) in zip(model.bodies, poses(model, q)):
        total = total + body.inertial.moved(R, p).pseudo_inertia
    return total


@given(st.integers(0, 10 ** 6), st.integers(1, 8), st.data())
def test_locking_joints_keeps_mass_com_and_inertia_of_the_robot(seed, n, data):
    source = random_urdf(seed, n)
    free, _ = load_with_warnings(source)
    q = np.random.default_rng(seed).normal(size=free.n)
    names = data.draw(st.permutations(free.joint_names))
    names = names[:data.draw(st.integers(0, len(names)))]
    positions = dict(zip(free.joint_names, q))
    locked = {name: value for name, value in positions.items() if name not in names}
    some, _ = load_with_warnings(source, joints=names, locked=locked)
    assert some.joint_names == tuple(names)
    expected = whole(free, q)
    actual = whole(some, [positions[name] for name in names])
    assert_allclose(actual, expected, atol=1e-11 * np.abs(expected).max(), rtol=0)


@given(st.integers(0, 10 ** 6), st.integers(2, 8))
def test_frames_of_a_locked_robot_are_where_they_were(seed, n):
    source = random_urdf(seed, n)
    free, _ = load_with_warnings(source)
    q = np.random.default_rng(seed).normal(size=free.n)
    still, _ = load_with_warnings(source, locked=dict(zip(free.joint_names, q)))
    placed = poses(free, q)
    for frame in free.frames:
        R, p = (np.eye(3), np.zeros(3)) if frame.body == WORLD else placed[frame.body]
        locked_frame = still.frame(frame.name)
        assert locked_frame.body == WORLD
        assert_allclose(locked_frame.rotation, R @ frame.rotation, atol=1e-12)
        assert_allclose(locked_frame.translation, p + R @ frame.translation,
                        atol=1e-12 * n * 10)


@given(st.integers(0, 10 ** 6), st.integers(2, 8))
def test_locking_a_master_keeps_its_mimics_where_they_were(seed, n):
    source = random_urdf(seed, n, mimics=True)
    free, _ = load_with_warnings(source)
    q = np.random.default_rng(seed).normal(size=free.n)
    still, _ = load_with_warnings(source, locked=dict(zip(free.joint_names, q)))
    expected = whole(free, q)
    assert_allclose(whole(still, []), expected,
                    atol=1e-11 * np.abs(expected).max(), rtol=0)


@given(st.integers(0, 10 ** 6), st.integers(1, 6))
def test_order_of_links_and_joints_in_the_text_does_not_matter(seed, n):
    source = random_urdf(seed, n)
    body = source.removeprefix('<robot name="r">').removesuffix('</robot>')
    parts = []
    for part in body.replace('<link', '\n<link').replace('<joint', '\n<joint') .split(
            '\n'):
        if part:
            parts.append(part)
    np.random.default_rng(seed).shuffle(parts)
    first, _ = load_with_warnings(source)
    second, _ = load_with_warnings(robot(*parts), joints=first.joint_names)
    assert second.coordinate_names == first.coordinate_names
    q = np.random.default_rng(seed).normal(size=first.n)
    expected = whole(first, q)
    assert_allclose(whole(second, q), expected,
                    atol=1e-12 * np.abs(expected).max(), rtol=0)


def test_comparison_detects_a_lost_gram():
    source = random_urdf(1, 4)
    free, _ = load_with_warnings(source)
    q = np.zeros(free.n)
    less, _ = load_with_warnings(source, drop=['l4'])
    assert isinstance(free.base_inertial, Inertial)
    assert whole(free, q)[3, 3] - whole(less, q)[3, 3] > 0.1
