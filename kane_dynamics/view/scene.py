"""3D scene of a robot in viser: shapes of bodies, arrows at joints."""

from collections.abc import Sequence
from typing import Any

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.kinematics.body_poses import body_poses
from kane_dynamics.model.link_shapes import LINK_COLOR, LinkShape, shapes_of_bodies
from kane_dynamics.model.model import Model
from kane_dynamics.view.load_arrows import KINDS
import numpy as np
import trimesh
from viser import ViserServer
from viser.transforms import SO3

# The colours of the plots, where torques and reactions have no others.
COLORS = {'torques': (0, 114, 178), 'forces': (213, 94, 0), 'moments': (0, 158, 115),
          'contacts': (204, 121, 167)}
_AWAY = 1.8  # the camera's distance, in sizes of what is shown
_CELL = 0.15  # of the robot's size, a square of the floor


class Scene:
    """
    A robot in a scene of viser's.

    Parameters
    ----------
    server : ViserServer
        That shows it.
    model : Model
        The robot.
    visuals : sequence of LinkShape
        Of its links.
    extent : float
        The robot's size, m.

    """

    def __init__(self, server: ViserServer, model: Model, visuals: Sequence[LinkShape],
                 extent: float) -> None:
        """Draw floor, light and shapes, with all bodies at the world's origin."""
        self.server = server
        self.model = model
        self.extent = extent
        scene = server.scene
        scene.set_up_direction('+z')
        scene.configure_environment_map('studio', environment_intensity=0.12)
        # Sizes relative to the robot, so that small and large ones look alike.
        cell = _nice(_CELL * extent)
        scene.add_grid('/floor', 16.0 * cell, 16.0 * cell, cell_size=cell,
                       section_size=4.0 * cell, cell_color=(225, 228, 232),
                       section_color=(196, 201, 208), shadow_opacity=0.2)
        self._frames = [scene.add_frame(f'/robot/{i}', show_axes=False)
                        for i in range(len(model.bodies) + 1)]
        self._shapes: list[Any] = []
        for i, (body, visual) in enumerate(shapes_of_bodies(model, visuals, extent)):
            # Body -1 is the world: the last frame, which never moves.
            self._draw(f'{self._frames[body].name}/{i}', visual)
        self._arrows = {}
        for kind in KINDS:
            self._arrows[kind] = scene.add_arrows(
                f'/{kind}', np.zeros((0, 2, 3)), _linear(COLORS[kind]),
                shaft_radius=0.008 * extent, head_radius=0.02 * extent,
                head_length=0.05 * extent)
        self._names = [scene.add_label(f'/names/{i}', body.joint.name, visible=False)
                       for i, body in enumerate(model.bodies)]

    def look(self, low: Array, high: Array, aside: float = 0.1) -> None:
        """
        Point the first camera at a box, with room for arrows.

        Parameters
        ----------
        low, high : (3,) arrays
            Corners of the box, m.
        aside : float
            Offset of the box to the left, in units of the camera's distance.

        """
        away = np.array([0.65, -0.68, 0.34])
        distance = _AWAY * max(float(np.linalg.norm(high - low)), self.extent)
        # The controls cover the right side: shift the robot to the left.
        center = 0.5 * (low + high) + aside * distance * np.array([0.72, 0.69, 0.0])
        camera = self.server.initial_camera
        camera.fov = np.radians(40.0)
        camera.look_at = tuple(center)
        camera.position = tuple(center + distance * away)

    def place(self, q: Array, arrows: dict[str, Array]) -> None:
        """Move bodies and names to q; set the arrows, (m, 2, 3) in m by kind."""
        poses = body_poses(self.model, q)
        with self.server.atomic():
            for frame, pose in zip(self._frames, poses):
                frame.wxyz = SO3.from_matrix(pose[:3, :3]).wxyz
                frame.position = pose[:3, 3]
            for label, pose in zip(self._names, poses):
                label.position = pose[:3, 3]
            for kind, points in arrows.items():
                self._arrows[kind].points = points.astype(np.float32)

    def show(self, kind: str, visible: bool) -> None:
        """Show or hide arrows of a kind, or 'names'."""
        handles = self._names if kind == 'names' else [self._arrows[kind]]
        for handle in handles:
            handle.visible = visible

    def set_opacity(self, opacity: float) -> None:
        """Set the opacity of the robot, from 0 to 1."""
        for shape in self._shapes:
            shape.opacity = None if opacity >= 1.0 else opacity

    def _draw(self, name: str, shape: LinkShape) -> None:
        """Add the shape of a body to the scene, in the body's axes."""
        if shape.kind == 'mesh':
            self._draw_mesh(name, shape)
            return
        scene = self.server.scene
        color = _rgb(LINK_COLOR if shape.color is None else shape.color)
        place = _place(shape)
        # Primitive shapes have no file.
        if shape.kind == 'box':
            handle: Any = scene.add_box(name, dimensions=tuple(shape.size), color=color,
                                        **place)
        elif shape.kind == 'cylinder':
            radius, height = shape.size
            handle = scene.add_cylinder(name, radius, height, color=color, **place)
        else:
            radius = float(shape.size[0])
            handle = scene.add_icosphere(name, radius, subdivisions=3, color=color,
                                         **place)
        self._shapes.append(handle)

    def _draw_mesh(self, name: str, shape: LinkShape) -> None:
        """Add the parts of a mesh, in the color of the URDF or else of the file."""
        for k, mesh in enumerate(_meshes(shape)):
            color = shape.color
            if color is None:
                color = _file_color(mesh)
            self._shapes.append(self.server.scene.add_mesh_simple(
                f'{name}/{k}',
                mesh.vertices, mesh.faces, side='double', color=_rgb(color),
                **_place(shape)))


def _place(shape: LinkShape) -> dict[str, Any]:
    """Return the pose of a shape as viser takes it."""
    return {'wxyz': SO3.from_matrix(shape.pose[:3, :3]).wxyz,
            'position': shape.pose[:3, 3]}


def _meshes(shape: LinkShape) -> list[Any]:
    """Return the scaled parts of a mesh file."""
    try:
        parts = trimesh.load_scene(shape.file, ignore_broken=True).dump()
    except Exception as error:  # every format raises other errors
        raise InputError(f'{shape.file}: {error}; expected a readable mesh') from error
    meshes = [part for part in parts
              if isinstance(part, trimesh.Trimesh) and len(part.faces)]
    if not meshes:
        raise InputError(f'{shape.file}: no triangles; expected a mesh')
    for mesh in meshes:
        mesh.apply_scale(shape.size)
    return meshes


def _file_color(part: Any) -> Array:
    """Return the color of a part of a mesh in its file, 0 to 1, or that of links."""
    color = getattr(getattr(part.visual, 'material', None), 'main_color', None)
    if color is None:
        return LINK_COLOR
    return np.asarray(color[:3]) / 255.0


def _rgb(color: Array) -> tuple[int, int, int]:
    red, green, blue = (round(255.0 * float(part)) for part in color)
    return red, green, blue


def _linear(color: tuple[int, int, int]) -> tuple[int, int, int]:
    """Return a color in linear light, as viser expects those of arrows."""
    return _rgb((np.array(color) / 255.0) ** 2.2)


def _nice(length: float) -> float:
    """Return the number nearest to a length among 1, 2 or 5 times a power of ten."""
    power = 10.0 ** np.floor(np.log10(length))
    candidates = power * np.array([1.0, 2.0, 5.0, 10.0])
    return float(candidates[np.argmin(np.abs(candidates - length))])
