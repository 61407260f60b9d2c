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
COLORS = {'torques': (0, 114, 178), 'forces': (213, 94, 0), 'moments': (0, 158, 115)}
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
        self.server, self.model, self.extent = server, model, extent
        scene = server.scene
        scene.set_up_direction('+z')
        scene.configure_environment_map('studio', environment_intensity=0.12)
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
        self._arrows = {kind: scene.add_arrows(
            f'/{kind}', np.zeros((0, 2, 3)), _linear(COLORS[kind]), shaft_radius=0.008 * extent,
            head_radius=0.02 * extent, head_length=0.05 * extent) for kind in KINDS}
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
                frame.wxyz, frame.position = SO3.from_matrix(pose[:3, :3]).wxyz, pose[:3, 3]
            for label, pose in zip(self._names, poses):
                label.position = pose[:3, 3]
            for kind, points in arrows.items():
                self._arrows[kind].points = points.astype(np.float32)

    def show(self, kind: str, visible: bool) -> None:
        """Show or hide arrows of a kind, or 'names'."""
        for handle in self._names if kind == 'names' else [self._arrows[kind]]:
            handle.visible = visible

    def set_opacity(self, opacity: float) -> None:
        """Set the opacity of the robot, from 0 to 1."""
        for shape in self._shapes:
            shape.opacity = None if opacity >= 1.0 else opacity

    def _draw(self, name: str, visual: LinkShape) -> None:
        """Add the shape of a body to the scene, in the body's axes."""
        pose, scene = visual.pose, self.server.scene
        color = LINK_COLOR if visual.color is None else visual.color
        place: dict[str, Any] = {'wxyz': SO3.from_matrix(pose[:3, :3]).wxyz,
                                 'position': pose[:3, 3]}
        if visual.kind == 'mesh':
            for k, (mesh, own) in enumerate(_meshes(visual)):
                self._shapes.append(scene.add_mesh_simple(
                    f'{name}/{k}', mesh.vertices, mesh.faces, side='double',
                    color=_rgb(color if own is None else own), **place))
        elif visual.kind == 'box':
            self._shapes.append(scene.add_box(name, dimensions=tuple(visual.size),
                                              color=_rgb(color), **place))
        elif visual.kind == 'cylinder':
            radius, height = visual.size
            self._shapes.append(scene.add_cylinder(name, radius, height, color=_rgb(color),
                                                   **place))
        else:
            self._shapes.append(scene.add_icosphere(name, float(visual.size[0]), subdivisions=3,
                                                    color=_rgb(color), **place))


def _meshes(visual: LinkShape) -> list[tuple[Any, Array | None]]:
    """Return the scaled parts of a mesh file with their own colors."""
    try:
        parts = trimesh.load_scene(visual.file, ignore_broken=True).dump()
    except Exception as error:  # every format raises other errors
        raise InputError(f'{visual.file}: {error}; expected a readable mesh') from error
    meshes = [part for part in parts if isinstance(part, trimesh.Trimesh) and len(part.faces)]
    if not meshes:
        raise InputError(f'{visual.file}: no triangles; expected a mesh')
    for mesh in meshes:
        mesh.apply_scale(visual.size)
    return [(mesh, _own_color(mesh) if visual.color is None else None) for mesh in meshes]


def _own_color(part: Any) -> Array | None:
    """Return the color of a part of a mesh in its file, from 0 to 1."""
    color = getattr(getattr(part.visual, 'material', None), 'main_color', None)
    return None if color is None else np.asarray(color[:3]) / 255.0


def _rgb(color: Array) -> tuple[int, int, int]:
    red, green, blue = (round(255.0 * float(x)) for x in color)
    return red, green, blue


def _linear(color: tuple[int, int, int]) -> tuple[int, int, int]:
    """Return a color in linear light, as viser expects those of arrows."""
    return _rgb((np.array(color) / 255.0) ** 2.2)


def _nice(length: float) -> float:
    """Return the number nearest to a length among 1, 2 or 5 times a power of ten."""
    power = 10.0 ** np.floor(np.log10(length))
    return float(power * min((1.0, 2.0, 5.0, 10.0), key=lambda x: abs(x * power - length)))
