"""Shapes of attached objects as payload."""

from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip('rclpy')

from geometry_msgs.msg import Point, Pose  # noqa: E402, I100
from kane_dynamics import Inertial, load_urdf  # noqa: E402
from kane_dynamics._util.resources import resource_path  # noqa: E402
from kane_dynamics.errors import InputError  # noqa: E402
from kane_dynamics.ros.monitors.attached_objects import (  # noqa: E402
    AttachedObjects, check_attached_objects, solid_mesh, solid_primitive, stated_masses,
    uniform_solid)
from node_values import node_values  # noqa: E402
from shape_msgs.msg import Mesh, MeshTriangle, SolidPrimitive  # noqa: E402

MODEL = load_urdf(resource_path('urdf', 'two_link.urdf'))
FIRST, TIP = (body.name for body in MODEL.bodies)
SAMPLES = 400_000


class Shape(SimpleNamespace):
    """A CollisionObject."""

    ADD = b'\0'
    REMOVE = b'\1'
    APPEND = b'\2'


def primitive(kind, *sizes):
    return SolidPrimitive(type=kind, dimensions=list(sizes))


def shape(*primitives, name='cup', poses=None, at=(0.0, 0.0, 0.0), frame=TIP, meshes=()):
    pose = Pose()
    pose.position.x, pose.position.y, pose.position.z = at
    return Shape(id=name, operation=Shape.ADD, header=SimpleNamespace(frame_id=frame),
                 pose=pose, primitives=list(primitives), meshes=list(meshes), planes=[],
                 primitive_poses=poses or [Pose() for _ in primitives],
                 mesh_poses=[Pose() for _ in meshes])


def attached(*primitives, link=TIP, **fields):
    return SimpleNamespace(link_name=link,
                           object=shape(*primitives, frame=link, **fields))


def by_points(inside, half, seed=0):
    """Return the inertial of points in a box, some inside, with density 1."""
    points = np.random.default_rng(seed).uniform(-1.0, 1.0, (SAMPLES, 3)) * half
    share = 8.0 * np.prod(half) / SAMPLES
    x = points[inside(points)]
    mass = share * len(x)
    com = x.mean(axis=0)
    d = x - com
    second = share * d.T @ d
    return Inertial(mass, com, np.trace(second) * np.eye(3) - second)


CONE_H = 0.6
CONE_R = 0.3
SHAPES = [
    (primitive(1, 0.2, 0.5, 0.9), lambda x: np.ones(len(x), bool), (0.1, 0.25, 0.45)),
    (primitive(2, 0.4), lambda x: (x**2).sum(axis=1) < 0.16, (0.4,) * 3),
    (primitive(3, 0.6, 0.3), lambda x: x[:, 0]**2 + x[:, 1]**2 < 0.09, (0.3, 0.3, 0.3)),
    (primitive(4, CONE_H, CONE_R), lambda x: np.hypot(x[:, 0], x[:, 1]) < CONE_R * (
        0.5 - x[:, 2] / CONE_H), (0.3, 0.3, 0.3))]


@pytest.mark.parametrize('solid, inside, half', SHAPES,
                         ids=['box', 'sphere', 'cylinder', 'cone'])
def test_primitives_have_the_inertia_of_their_points(solid, inside, half):
    value = solid_primitive(solid)
    expected = by_points(inside, np.array(half))
    assert value.mass == pytest.approx(expected.mass, rel=0.01)
    np.testing.assert_allclose(value.com, expected.com, atol=2e-3)
    np.testing.assert_allclose(value.inertia, expected.inertia,
                               atol=0.02 * np.abs(expected.inertia).max())


def box_mesh(size, at, shared=True):
    """Return a box mesh, triangles outward; vertices repeated if unshared."""
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)],
                       float)
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4),
             (1, 5, 7, 3)]
    triangles = []
    for a, b, c, d in faces:
        triangles += [(a, b, c), (a, c, d)]
    points = (corners - 0.5) * size + at
    if not shared:
        points = points[np.ravel(triangles)]
        triangles = np.arange(len(points)).reshape(-1, 3).tolist()
    mesh = Mesh()
    mesh.vertices = [Point(x=x, y=y, z=z) for x, y, z in points.tolist()]
    mesh.triangles = [MeshTriangle(vertex_indices=list(t)) for t in triangles]
    return mesh


@pytest.mark.parametrize('shared', [True, False])
@pytest.mark.parametrize('turned', [False, True])
def test_a_mesh_of_a_box_has_the_inertia_of_a_box(shared, turned):
    size = np.array([0.2, 0.3, 0.5])
    at = np.array([3.0, -0.2, 0.4])
    mesh = box_mesh(size, at, shared)
    if turned:
        for triangle in mesh.triangles:
            triangle.vertex_indices = triangle.vertex_indices[::-1]
    value = solid_mesh(mesh)
    expected = solid_primitive(primitive(1, *size))
    assert value.mass == pytest.approx(expected.mass, rel=1e-12)
    np.testing.assert_allclose(value.com, at, atol=1e-12)
    np.testing.assert_allclose(value.inertia, expected.inertia, atol=1e-13)


def test_an_open_mesh_is_refused():
    mesh = box_mesh(np.ones(3), np.zeros(3))
    mesh.triangles = mesh.triangles[:-1]
    with pytest.raises(InputError, match='not closed'):
        solid_mesh(mesh)
    # Without two opposite faces, the areas of the others still add up to zero.
    mesh = box_mesh(np.ones(3), np.zeros(3))
    mesh.triangles = mesh.triangles[4:]
    with pytest.raises(InputError, match='not closed'):
        solid_mesh(mesh)


def test_shapes_of_an_object_add_up_at_their_poses():
    turned = Pose()
    turned.position.x = 0.3
    turned.orientation.z = turned.orientation.w = np.sqrt(0.5)
    box = primitive(1, 0.1, 0.2, 0.3)
    ball = primitive(2, 0.1)
    value = uniform_solid(shape(box, ball, poses=[turned, Pose()], at=(0.0, 0.0, 0.5)))
    R = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    parts = (solid_primitive(box).moved(R, [0.3, 0.0, 0.5]),
             solid_primitive(ball).moved(np.eye(3), [0.0, 0.0, 0.5]))
    pseudo = sum(part.pseudo_inertia for part in parts)
    np.testing.assert_allclose(value.pseudo_inertia, pseudo, atol=1e-15)


class Rig:
    """The attached objects of a model, and what they change."""

    def __init__(self, masses=(), density=0.0, **changes):
        self.values = node_values(
            {'payload.frame': TIP, 'attached_objects.masses': masses,
             'attached_objects.density': density} | changes)
        self.used = []
        self.rejected = []
        self.objects = AttachedObjects(
            MODEL, self.values, lambda total: None, self.used.append,
            lambda *words: self.rejected.append(': '.join(words)))

    def hear(self, *objects, diff=True):
        state = SimpleNamespace(is_diff=diff, attached_collision_objects=list(objects))
        self.objects.on_scene(SimpleNamespace(is_diff=diff, robot_state=state))


CUBE = primitive(1, 0.1, 0.1, 0.1)


def test_stated_masses_come_before_the_density():
    rig = Rig(['cup:=2.0'], 700.0)
    rig.hear(attached(CUBE), attached(CUBE, name='other'))
    assert rig.used[-1].mass == pytest.approx(2.7)
    assert rig.objects.figures() == {'attached objects': 'cup 2 kg, other 0.7 kg'}
    rig.hear(attached(CUBE))  # the same again is no change
    assert len(rig.used) == 1


def test_objects_go_by_name_by_link_and_with_a_whole_scene():
    rig = Rig(density=1000.0)
    both = attached(CUBE), attached(CUBE, name='b')

    def remove(name, link=TIP):
        gone = attached(name=name, link=link)
        gone.object.operation = Shape.REMOVE
        return gone
    rig.hear(*both)
    rig.hear(remove('b'))
    assert rig.used[-1].mass == pytest.approx(1.0)
    rig.hear(*both, diff=False)
    rig.hear(remove('', link=FIRST))
    assert rig.used[-1].mass == pytest.approx(2.0)
    rig.hear(remove(''))
    assert rig.used[-1].mass == 0.0
    rig.hear(*both)
    rig.hear(diff=True)
    assert rig.used[-1].mass == pytest.approx(2.0)
    rig.hear(diff=False)
    assert rig.used[-1].mass == 0.0
    assert not rig.rejected


@pytest.mark.parametrize('thing, reason', [
    (attached(CUBE, link=FIRST), 'not fixed to the body of payload.frame'),
    (attached(CUBE, link='nowhere'), "no frame 'nowhere'"),
    (attached(), '0 shapes with 0 poses'),
    (attached(primitive(1, 0.1, 0.1)), 'with positive ones'),
    (attached(primitive(1, 0.1, 0.1, -0.1)), 'with positive ones'),
    (attached(primitive(5, 0.1)), 'expected a box, sphere, cylinder or cone'),
    (attached(CUBE, CUBE, poses=[Pose()]), '2 shapes with 1 poses'),
    (attached(primitive(1, 1.0, 1.0, 1.0)), 'payload.max_mass'),
    (attached(CUBE, at=(5.0, 0.0, 0.0)), 'at most 2 m from the frame'),
    (attached(CUBE, at=(np.nan, 0.0, 0.0)), 'expected finite numbers')])
def test_objects_that_are_none_are_refused_and_the_others_act(thing, reason):
    rig = Rig(density=1000.0)
    thing.object.id = 'bad'
    rig.hear(attached(CUBE), thing)
    assert rig.used[-1].mass == pytest.approx(1.0)
    assert reason in rig.rejected[0]
    assert rig.rejected[0].startswith("attached object 'bad': ")


def test_objects_together_are_no_heavier_than_a_payload_may_be():
    rig = Rig(['a:=30.0', 'b:=30.0'])
    rig.hear(attached(CUBE, name='a'), attached(CUBE, name='b'))
    assert rig.used[-1].mass == 30.0
    assert 'expected at most 50 kg' in rig.rejected[0]


@pytest.mark.parametrize('entry',
                         ['cup', 'cup:=', ':=2', 'cup:=-1', 'cup:=nan', 'cup:=inf'])
def test_masses_are_checked(entry):
    with pytest.raises(InputError, match='expected object:=mass, kg, at least 0'):
        stated_masses([entry])


def test_objects_need_a_payload_frame():
    values = node_values({'attached_objects.topic': '/scene'})
    with pytest.raises(InputError, match=r"parameter 'payload\.frame': empty"):
        check_attached_objects(values)
