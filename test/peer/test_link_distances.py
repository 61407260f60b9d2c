"""Distances of links and obstacles agree with those of Coal (hpp-fcl), pair by pair."""

from pathlib import Path

import coal
from kane_dynamics import (InputError, LinkDistances, LinkShape, load_collision_shapes,
                           load_urdf, ModelBuilder, ModelWarning, pose_from, Robot, rod,
                           rotation_exp)
from kane_dynamics.kinematics.convex_distance import convex_distances, ConvexShapes
import numpy as np
import pytest

URDFS = Path(__file__).resolve().parents[2] / 'urdf'


def coal_shape(shape):
    """Return the geometry of Coal for a shape."""
    sizes = [float(size) for size in shape.size]
    return {'box': coal.Box, 'cylinder': coal.Cylinder,
            'sphere': coal.Sphere}[shape.kind](*sizes)


def coal_distance(first, first_pose, second, second_pose):
    """Return the distance of two placed shapes by Coal; negative where they overlap."""
    request = coal.DistanceRequest()
    result = coal.DistanceResult()
    request.gjk_tolerance = 1e-12
    poses = [coal.Transform3s(pose[:3, :3].copy(), pose[:3, 3].copy())
             for pose in (first_pose, second_pose)]
    return coal.distance(coal_shape(first), poses[0], coal_shape(second), poses[1],
                         request, result)


def random_shape(rng, name='x'):
    """Return a box, cylinder or sphere at a random pose."""
    kind = rng.choice(['box', 'cylinder', 'sphere'])
    size = rng.uniform(0.05, 0.5, {'box': 3, 'cylinder': 2, 'sphere': 1}[kind])
    pose = np.eye(4)
    pose[:3, :3] = rotation_exp(rng.normal(size=3))
    pose[:3, 3] = rng.uniform(-0.6, 0.6, 3)
    return LinkShape(name, str(kind), size, pose)


def test_distances_of_random_shapes_are_those_of_coal():
    rng = np.random.default_rng(0)
    first = [random_shape(rng) for _ in range(2000)]
    second = [random_shape(rng) for _ in range(2000)]
    poses = []
    for shapes in (first, second):
        poses.append(np.array([shape.pose for shape in shapes]))
    distances, near, far = convex_distances(ConvexShapes.of(first), poses[0],
                                            ConvexShapes.of(second), poses[1])
    expected = np.array([coal_distance(a, a.pose, b, b.pose)
                         for a, b in zip(first, second, strict=True)])
    apart = expected > 1e-6
    assert 400 < apart.sum() < 1800  # the rest overlap
    np.testing.assert_allclose(distances[apart], expected[apart], rtol=1e-4, atol=1e-6)
    assert (distances[expected < -1e-6] == 0.0).all()
    gaps = np.linalg.norm(near - far, axis=1)
    np.testing.assert_allclose(gaps[apart], distances[apart], rtol=1e-6, atol=1e-9)


def test_aligned_boxes_and_cylinders_have_the_distance_of_their_faces():
    box = LinkShape('a', 'box', np.array([1.0, 1.0, 1.0]), np.eye(4))
    for kind, size, gap in (('box', [1.0, 1.0, 1.0], 0.25),
                            ('cylinder', [0.5, 1.0], 0.25),
                            ('sphere', [0.5], 0.25)):
        for axis in np.eye(3):
            pose = np.eye(4)
            pose[:3, 3] = 1.25 * axis
            second = LinkShape('b', kind, np.array(size), pose)
            distance, _, _ = convex_distances(ConvexShapes.of([box]), box.pose[None],
                                              ConvexShapes.of([second]), pose[None])
            assert distance[0] == pytest.approx(gap, abs=1e-9)


@pytest.mark.parametrize('name', ['ur10e', 'fr3'])
def test_links_of_an_arm_have_the_distances_of_coal(name):
    path = URDFS / f'{name}.urdf'
    robot = Robot(load_urdf(path))
    shapes = load_collision_shapes(path)
    table = LinkShape('table', 'box', np.array([2.0, 2.0, 0.1]),
                      pose_from((0.0, 0.0, -0.3)))
    distances = LinkDistances(robot, shapes, [table])
    q = robot.random_configuration(1, 40)
    by_pair = distances(q)
    assert by_pair.shape == (40, len(distances.pairs))
    by_link = {}
    for shape in shapes:
        by_link.setdefault(shape.link, []).append(shape)
    for k, state in enumerate(q):
        for column, (first, second) in enumerate(distances.pairs):
            if first not in by_link:
                continue  # a rod of ours
            expected = []
            for a in by_link[first]:
                pose = robot.frame_pose(first, state) @ a.pose
                for b in by_link.get(second, [table]):
                    carrier = np.eye(4) if b is table else robot.frame_pose(
                        second, state)
                    expected.append(coal_distance(a, pose, b, carrier @ b.pose))
            assert by_pair[k, column] == pytest.approx(max(min(expected), 0.0), rel=1e-4,
                                                       abs=1e-6)
    nearest = distances.nearest(q[0])
    assert nearest.distance == distances.smallest(q[0]) == by_pair[0].min()
    assert nearest.links == distances.pairs[int(by_pair[0].argmin())]
    np.testing.assert_allclose(distances(q[0]), by_pair[0], atol=1e-12)
    assert distances.nearest(q).distance == by_pair.min()


def two_links():
    """Return two rods in series whose second can fold onto a base, with their shapes."""
    b = ModelBuilder('arm')
    for name, on, at in (('upper', 'world', (0, 0, 0.5)),
                         ('lower', 'upper', (0.5, 0, 0)),
                         ('hand', 'lower', (0.5, 0, 0))):
        b.body(name, on, axis=(0, 1, 0), at=at,
               inertial=rod(1.0, (0, 0, 0), (0.5, 0, 0)))
    ball = np.eye(4)
    ball[0, 3] = 0.25
    shapes = [LinkShape(name, 'sphere', np.array([0.1]), ball)
              for name in ('upper', 'lower', 'hand')]
    return Robot(b.model()), [*shapes,
                              LinkShape('world', 'sphere', np.array([0.1]), np.eye(4))]


def test_a_folded_arm_comes_as_near_as_its_geometry_says():
    robot, shapes = two_links()
    distances = LinkDistances(robot, shapes)
    assert ('upper', 'hand') in distances.pairs and ('lower', 'world') in distances.pairs
    # Neighbors are left out.
    assert not {('upper', 'lower'), ('world', 'upper')} & set(distances.pairs)
    straight = distances.nearest(np.zeros(3))
    # upper at 0.25, hand at 1.25 along x, 0.5 above the base: the ball of the base at 0.
    expected = {('upper', 'hand'): 1.0 - 0.2,
                ('lower', 'world'): np.hypot(0.75, 0.5) - 0.2,
                ('hand', 'world'): np.hypot(1.25, 0.5) - 0.2}
    assert straight.distance == pytest.approx(min(expected.values()), abs=1e-9)
    assert straight.links == min(expected, key=expected.get)
    folded = distances([0.0, np.pi, 0.0])  # hand over the base, at x = -0.25
    assert folded[distances.pairs.index(('hand', 'world'))] == pytest.approx(
        np.hypot(0.25, 0.5) - 0.2, abs=1e-9)
    assert distances.smallest([0.0, np.pi, np.pi]) == 0.0  # the hand on the upper link
    fewer = LinkDistances(robot, shapes, ignored=[('hand', 'upper')])
    assert ('upper', 'hand') not in fewer.pairs


def test_obstacles_are_compared_with_all_links_also_those_next_to_the_base():
    robot, shapes = two_links()
    post = LinkShape('post', 'cylinder', np.array([0.05, 2.0]),
                     pose_from((0.25, 0.4, 0.5)))
    distances = LinkDistances(robot, shapes, [post])
    assert distances.nearest(np.zeros(3)).links == ('upper', 'post')
    assert distances.nearest(np.zeros(3)).distance == pytest.approx(0.4 - 0.15, abs=1e-9)


def test_a_shape_of_an_unknown_link_is_left_out_with_a_warning():
    """The link whose name is misspelled is a rod: its distances would be too large."""
    robot, shapes = two_links()
    misspelled = LinkShape('uper', 'sphere', np.array([0.6]), np.eye(4))
    with pytest.warns(ModelWarning,
                      match='shapes: the model has no link uper; left out'):
        LinkDistances(robot, [*shapes, misspelled])


def test_shapes_that_overlap_at_rest_are_left_out_by_name():
    robot, shapes = two_links()
    large = [LinkShape(shape.link, 'sphere', np.array([0.6]), shape.pose)
             for shape in shapes]
    distances = LinkDistances(robot, large)
    assert set(distances.left_out) >= {('upper', 'hand')}
    assert not set(distances.left_out) & set(distances.pairs)


def test_an_obstacle_that_an_arm_at_rest_overlaps_is_compared_all_the_same():
    """An arm that comes from another configuration could enter the obstacle."""
    robot, shapes = two_links()
    wall = LinkShape('wall', 'box', np.array([0.2, 1.0, 1.0]),
                     pose_from((1.2, 0.0, 0.5)))
    distances = LinkDistances(robot, shapes, [wall])
    assert distances.left_out == ()
    hand = distances.pairs.index(('hand', 'wall'))
    assert distances(np.zeros(3))[hand] == 0.0
    assert distances.nearest(np.zeros(3)).links == ('hand', 'wall')
    folded = distances([0.0, np.pi, 0.0])[hand]  # the hand at x = -0.25
    assert folded == pytest.approx(1.1 + 0.25 - 0.1, abs=1e-9)
    fewer = LinkDistances(robot, shapes, [wall], ignored=[('hand', 'wall')])
    assert ('hand', 'wall') not in fewer.pairs


@pytest.mark.parametrize(('change', 'words'), [
    ({'shapes': LinkShape('a', 'box', np.ones(3), np.eye(4))},
     'shapes: a LinkShape; expected'),
    ({'shapes': [LinkShape('a', 'mesh', np.ones(3), np.eye(4))]},
     "kind 'mesh'; expected one"),
    ({'obstacles': [LinkShape('a', 'box', np.ones(2), np.eye(4))]},
     'expected 3 finite numbers'),
    ({'obstacles': [LinkShape('upper', 'box', np.ones(3), np.eye(4))]},
     'expected another name'),
    ({'obstacles': [LinkShape('a', 'box', np.ones(3), np.eye(3))]},
     'expected a finite .4, 4.'),
    ({'ignored': [('upper', 'elbow')]},
     "ignored: 'elbow' has no shape; expected names of")])
def test_invalid_shapes_and_names_are_refused(change, words):
    robot, shapes = two_links()
    with pytest.raises(InputError, match=words):
        LinkDistances(robot, **{'shapes': shapes, **change})
