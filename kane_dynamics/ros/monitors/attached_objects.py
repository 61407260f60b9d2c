"""
The payload of the objects that MoveIt has attached to the arm.

MoveIt publishes its planning scene, where a grasped object is attached to a link. It has
shapes, but no mass: that is stated by parameter, or follows from a density and the volume
of the shapes. Center of mass and inertia are those of shapes filled uniformly.
"""

from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
import math
from typing import Any

from kane_dynamics.errors import InputError, KaneError
from kane_dynamics.mechanics.algebra.quaternion import rotation_matrix
from kane_dynamics.model.inertial import Inertial
from kane_dynamics.model.model import Model
from kane_dynamics.model.primitive_inertias import ball, box, disc
from kane_dynamics.ros.common.conversion import Array
from kane_dynamics.ros.loads.gravity_payload import checked_payload
import numpy as np
from numpy.typing import NDArray
from rclpy.clock import Clock, ClockType
from rclpy.node import Node

REFUSED = 'attached object'  # with its name: reason of objects without effect
SERVICE = 'get_planning_scene'
PERIOD = 0.5  # s between two looks for that service
SAME = 1e-6  # distance of vertices that are one, relative to the size of a mesh
BOX, SPHERE, CYLINDER, CONE = 1, 2, 3, 4  # types of shape_msgs/SolidPrimitive
SIZES = {BOX: 3, SPHERE: 1, CYLINDER: 2, CONE: 2}  # number of dimensions


def scene_types() -> tuple[Any, Any]:
    """
    Return the types moveit_msgs/PlanningScene and GetPlanningScene.

    Raise InputError if they are not installed.
    """
    try:
        messages, services = (import_module('moveit_msgs.msg'), import_module('moveit_msgs.srv'))
        return messages.PlanningScene, services.GetPlanningScene
    except (ImportError, AttributeError) as error:
        raise InputError("parameter 'attached_objects.topic': set without "
                         f'moveit_msgs/PlanningScene ({error}); expected an empty one, or an '
                         'installed package moveit_msgs') from None


def stated_masses(entries: Sequence[str]) -> dict[str, float]:
    """Return masses by object, kg, from parameter attached_objects.masses."""
    masses = {}
    for entry in entries:
        # Names may have colons, numbers not.
        name, _, number = entry.rpartition(':=')
        try:
            mass = float(number)
        except ValueError:
            mass = math.nan
        if not name or not 0.0 <= mass < math.inf:
            raise InputError(f"parameter 'attached_objects.masses': '{entry}'; expected "
                             'object:=mass, kg, at least 0')
        masses[name] = mass
    return masses


def check_attached_objects(values: Mapping[str, Any]) -> None:
    """Raise InputError unless the parameters of attached objects are valid."""
    stated_masses(values['attached_objects.masses'])
    if values['attached_objects.topic'] and not values['payload.frame']:
        raise InputError("parameter 'payload.frame': empty; expected a frame of the link to "
                         'which objects are attached, as attached_objects.topic is set')


class AttachedObjects:
    """
    The attached objects of a planning scene, as a payload.

    Parameters
    ----------
    model : Model
    values : mapping
        The node's parameters, checked by `check_attached_objects`.
    check : callable
        Called with the payload of some objects, an `Inertial` in the axes of
        payload.frame. Raises InputError if the arm may not carry it.
    use : callable
        Called with the payload of all objects after each change of it.
    reject : callable
        Called with the reason and the details of each object that has no effect.

    """

    def __init__(self, model: Model, values: Mapping[str, Any],
                 check: Callable[[Inertial], None], use: Callable[[Inertial], None],
                 reject: Callable[[str, str], None]) -> None:
        self._model = model
        self._check = check
        self._use = use
        self._reject = reject
        self._attached: dict[str, Any] = {}  # AttachedCollisionObject by id
        self._masses_used: dict[str, float] = {}
        self._total = Inertial()
        self._read(values)

    def _read(self, values: Mapping[str, Any]) -> None:
        self._values = values
        self._masses = stated_masses(values['attached_objects.masses'])
        self._density = values['attached_objects.density']

    def update(self, values: Mapping[str, Any]) -> None:
        """Use checked parameters at once."""
        before = self._masses, self._density
        self._read(values)
        if (self._masses, self._density) != before:
            self._apply()

    def on_scene(self, scene: Any) -> None:
        """Use the attached objects of a PlanningScene, which may be a difference."""
        state = scene.robot_state
        # A whole scene replaces all objects; a difference names those that changed.
        if not scene.is_diff and not state.is_diff:
            self._attached = {}
        elif not state.attached_collision_objects:
            return
        for attached in state.attached_collision_objects:
            self._change(attached)
        self._apply()

    def _change(self, attached: Any) -> None:
        """Attach or detach one object."""
        name, operation = attached.object.id, attached.object.operation
        link = attached.link_name
        kind = type(attached.object)
        if operation == kind.ADD:
            self._attached[name] = attached
        elif operation == kind.REMOVE and name:
            self._attached.pop(name, None)
        elif operation == kind.REMOVE and not link:  # all objects of the arm
            self._attached = {}
        elif operation == kind.REMOVE:  # all objects of the link
            for name, on_arm in list(self._attached.items()):
                if on_arm.link_name == link:
                    del self._attached[name]
        else:
            self._refuse(name, f'operation {operation!r}; expected ADD or REMOVE, as a scene '
                         'of MoveIt has them')

    def _apply(self) -> None:
        """Use the sum of all objects; those that are refused have no effect."""
        total = Inertial()
        masses = {}
        # Object by object: one that is refused leaves the others in use.
        for name, attached in self._attached.items():
            try:
                inertial = self._payload(name, attached)
                self._require_carried(total.mass + inertial.mass)
                self._check(total + inertial)
            except KaneError as error:
                self._refuse(name, str(error))
                continue
            total = total + inertial
            masses[name] = inertial.mass
        self._masses_used = masses
        if not np.array_equal(total.parameters, self._total.parameters):
            self._total = total
            self._use(total)

    def _require_carried(self, mass: float) -> None:
        """Raise InputError if all objects together exceed payload.max_mass."""
        limit = self._values['payload.max_mass']
        if mass > limit:
            raise InputError(f'{mass:g} kg with the others; expected at most {limit:g} kg '
                             '(parameter payload.max_mass)')

    def _refuse(self, name: str, detail: str) -> None:
        self._reject(f"{REFUSED} '{name}'", detail)

    def _payload(self, name: str, attached: Any) -> Inertial:
        """Return the payload of one object in the axes of payload.frame."""
        # Inertia for density 1, then scaled to the stated mass.
        solid = uniform_solid(attached.object)
        mass = self._masses.get(name)
        if mass is None:
            if not self._density:
                raise InputError('no mass; expected one in attached_objects.masses, or '
                                 'attached_objects.density')
            mass = self._density * solid.mass
        # The object may be stated in another frame, which must move with the link.
        frame = attached.object.header.frame_id or attached.link_name
        if attached.link_name and frame != attached.link_name:
            self._require_same_body(frame, attached.link_name)
        inertia = mass / solid.mass * solid.inertia
        payload = checked_payload(self._model, self._values, frame, mass, solid.com.tolist(),
                                  inertia[np.triu_indices(3)].tolist())
        return Inertial() if payload is None else payload

    def _require_same_body(self, frame: str, link: str) -> None:
        """Raise InputError unless the pose of an object is stated on its own link."""
        if self._model.frame(frame).body != self._model.frame(link).body:
            raise InputError(f"pose in '{frame}', but attached to '{link}'; expected a frame "
                             'of that link')

    def figures(self) -> dict[str, str]:
        """Return the entries for the diagnostics."""
        masses = [f'{name} {mass:.3g} kg' for name, mass in self._masses_used.items()]
        return {'attached objects': ', '.join(masses) or 'none'}


class SceneRequest:
    """
    Asks MoveIt once for the objects that are attached, as soon as it answers.

    Parameters
    ----------
    node : Node
    kind : service type
        moveit_msgs/GetPlanningScene.
    topic : str
        Of the scene, whose service is in the same namespace.
    use : callable
        Called with the PlanningScene.

    """

    def __init__(self, node: Node, kind: Any, topic: str,
                 use: Callable[[Any], None]) -> None:
        self._node, self._kind, self._use = node, kind, use
        namespace = topic.rpartition('/')[0]
        self._client = node.create_client(kind, f'{namespace}/{SERVICE}')
        self._timer = node.create_timer(PERIOD, self._ask,
                                        clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._closed = False

    def _ask(self) -> None:
        if not self._client.service_is_ready():
            return
        self._timer.cancel()
        request = self._kind.Request()
        components = request.components
        components.components = components.ROBOT_STATE_ATTACHED_OBJECTS
        self._client.call_async(request).add_done_callback(self._answered)

    def _answered(self, future: Any) -> None:
        if not self._closed and future.exception() is None:
            self._use(future.result().scene)

    def close(self) -> None:
        """Ask no more."""
        self._closed = True
        self._node.destroy_timer(self._timer)
        self._node.destroy_client(self._client)


def uniform_solid(stated: Any) -> Inertial:
    """
    Return the inertial of the shapes of a CollisionObject with density 1.

    It is in the axes of the frame of the object's header. Raise InputError for shapes
    without a volume.
    """
    if stated.planes:
        raise InputError('a plane; expected boxes, spheres, cylinders, cones, or closed meshes')
    solids = [*map(solid_primitive, stated.primitives), *map(solid_mesh, stated.meshes)]
    poses = [*stated.primitive_poses, *stated.mesh_poses]
    # Each kind of shape has its own list of poses.
    of_each_kind = len(stated.primitive_poses) == len(stated.primitives)
    if not solids or len(poses) != len(solids) or not of_each_kind:
        raise InputError(f'{len(solids)} shapes with {len(poses)} poses; expected shapes '
                         'with a pose for each')
    total = Inertial()
    for solid, pose in zip(solids, poses):
        total = total + solid.moved(*_placement(pose))
    return total.moved(*_placement(stated.pose))


def solid_primitive(shape: Any) -> Inertial:
    """Return the inertial of a SolidPrimitive with density 1, in its own axes."""
    count = SIZES.get(shape.type)
    sizes = np.array(shape.dimensions[:count], dtype=np.float64)
    if count is None or len(sizes) < count or not (np.isfinite(sizes) & (sizes > 0.0)).all():
        raise InputError(f'primitive of type {shape.type} and dimensions {sizes.tolist()}; '
                         'expected a box, sphere, cylinder or cone with positive ones')
    # The volume is the mass at density 1.
    if shape.type == BOX:
        return box(float(sizes.prod()), sizes)
    if shape.type == SPHERE:
        radius = float(sizes[0])
        return ball(4.0 / 3.0 * math.pi * radius**3, radius)
    height, radius = sizes.tolist()
    volume = math.pi * radius**2 * height
    if shape.type == CYLINDER:
        return disc(volume, radius, thickness=height)
    # A cone with its tip up and the origin at half of its height.
    mass = volume / 3.0
    across = mass * (3.0 / 20.0 * radius**2 + 3.0 / 80.0 * height**2)
    along = 0.3 * mass * radius**2
    return Inertial(mass, np.array([0.0, 0.0, -0.25 * height]),
                    np.diag([across, across, along]))


def solid_mesh(mesh: Any) -> Inertial:
    """Return the inertial of a closed mesh filled with density 1, in its own axes."""
    vertices = np.array([[v.x, v.y, v.z] for v in mesh.vertices]).reshape(-1, 3)
    triangles = np.array([t.vertex_indices for t in mesh.triangles], dtype=np.int64)
    triangles = triangles.reshape(-1, 3)
    if not np.isfinite(vertices).all() or (triangles >= len(vertices)).any():
        raise InputError('a mesh with vertices that are missing or not finite; expected a '
                         'closed mesh')
    _require_closed(vertices, triangles)

    # Tetrahedra from the first vertex to the triangles, with signed volumes: the integrals of 1,
    # x and x x^T over each.
    first = vertices[0]
    corners = vertices[triangles] - first
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    volumes = np.einsum('ij,ij->i', a, np.cross(b, c)) / 6.0
    sums = corners.sum(axis=1)
    volume = volumes.sum()
    moment = volumes @ sums / 4.0
    second = (np.einsum('i,ikr,iks->rs', volumes, corners, corners)
              + np.einsum('i,ir,is->rs', volumes, sums, sums)) / 20.0
    if volume < 0.0:  # the triangles are seen from inside
        volume, moment, second = -volume, -moment, -second
    if not volume > 0.0:
        raise InputError('a mesh without volume; expected a closed one')
    pseudo = np.block([[second, moment[:, None]], [moment[None], np.array([[volume]])]])
    return Inertial.from_pseudo_inertia(pseudo).moved(np.eye(3), first)


def _require_closed(vertices: Array, triangles: NDArray[np.int64]) -> None:
    """Raise InputError unless each edge of a mesh belongs to triangles on both of its sides."""
    if not len(triangles):
        raise InputError('a mesh without triangles; expected a closed one')
    size = np.ptp(vertices, axis=0).max()
    if not size > 0.0:
        raise InputError('a mesh without volume; expected a closed one')
    # Files often repeat the vertices of each triangle.
    _, same = np.unique(np.round(vertices / (SAME * size)), axis=0, return_inverse=True)
    corners = same.reshape(-1)[triangles]
    # In a closed mesh each edge is passed once in each direction, by the triangles on
    # its sides.
    edges = np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]])
    edges = edges[edges[:, 0] != edges[:, 1]]
    forward, counts = np.unique(edges, axis=0, return_counts=True)
    backward, others = np.unique(edges[:, ::-1], axis=0, return_counts=True)
    if not (np.array_equal(forward, backward) and np.array_equal(counts, others)):
        raise InputError('a mesh that is not closed; expected one whose triangles enclose a '
                         'volume')


def _placement(pose: Any) -> tuple[Array, Array]:
    """Return rotation (3, 3) and position (3,) of a Pose; InputError if it is none."""
    p, r = pose.position, pose.orientation
    position, quaternion = np.array([p.x, p.y, p.z]), np.array([r.x, r.y, r.z, r.w])
    length = math.hypot(*quaternion)
    if not np.isfinite(position).all() or not abs(length - 1.0) <= 0.01:
        raise InputError(f'pose {[*position.tolist(), *quaternion.tolist()]}; expected finite '
                         'numbers, and a quaternion of length 1')
    return rotation_matrix(quaternion), position
