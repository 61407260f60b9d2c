"""Plots of flexible robots: bent shapes along a motion, and vibration modes."""

from collections.abc import Sequence
from typing import Any

from kane_dynamics._util.typing import Array
from kane_dynamics.analysis.vibration import natural_vibration
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.ball_joints import require_angles
from kane_dynamics.mechanics.definition.kinematics import configurations
from kane_dynamics.model.model import Model, WORLD
from kane_dynamics.plot.style import BLUE, GREY, INK, ORANGE, Path, RED, SKY, styled
from kane_dynamics.robot.robot import Robot
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
import numpy as np

PLANES = ('xy', 'xz', 'yz', 'xyz')
FLAT = 1e-6  # of the extent; a thinner robot is drawn in its plane
SWING = 0.15  # drawn amplitude of a vibration, relative to the extent of the robot
_AGES = LinearSegmentedColormap.from_list('ages', [BLUE, SKY, ORANGE, RED])

Lines = list[tuple[bool, Array]]  # whether it is a beam, and its points (k, 3), m


def plot_bending(model: Model, q: Any, t: Sequence[float] | None = None,
                 path: Path | None = None, *, exaggeration: float = 1.0,
                 plane: str | None = None, title: str = 'Bending arm') -> Figure:
    """
    Plot the shape of a robot with bent beams, at one or several configurations.

    Parameters
    ----------
    model : Model
        A chain or tree.
    q : (n,) or (K, n) array
        Configurations, such as ``trajectory.q[::50]``: rad, m, and modal coordinates.
    t : (K,) sequence of float, optional
        Their times, s, for the legend.
    exaggeration : float
        Factor on the drawn deflections; the title contains it.
    plane : str, optional
        World axes of the picture: xy, xz, yz, or xyz for a view in space. Default: the
        plane of the robot, else xyz.
    path, title
        See `kane_dynamics.plot`.

    Raises
    ------
    InputError
        If the plane or the configurations are invalid.

    """
    shapes = _checked(model, q)
    if t is not None and len(t) != len(shapes):
        raise InputError(f't: {len(t)} times; expected {len(shapes)}, one per '
                         'configuration')
    drawn = [_lines(model, shape, exaggeration) for shape in shapes]
    labels: list[str | None] = [None] * len(drawn)
    # Later shapes are darker, with their times beside the picture.
    if t is not None:
        labels = [f'{time:.3g} s' for time in t]
    # All shapes have one scale, so that the plane of view fits all.
    view = _View(plane, drawn)
    colors = _AGES(np.linspace(0.0, 1.0, len(drawn)))
    if exaggeration != 1.0:
        title = f'{title}, deflections drawn {exaggeration:g} times'
    with styled(8.0, 6.0, title, path) as figure:
        axes = view.panel(figure, 1, 1, 0)
        for lines, color, label in zip(drawn, colors, labels, strict=True):
            view.draw(axes, lines, color, label)
        if t is not None:
            figure.legend(loc='outside right upper', title='Time', alignment='left')
    return figure


def plot_vibrations(robot: Robot, q: Any, path: Path | None = None, *,
                    held: Sequence[str] = (),
                    count: int = 4, plane: str | None = None,
                    title: str = 'Natural vibrations') -> Figure:
    """
    Plot the slowest natural vibrations about a configuration, at both ends of swings.

    Parameters
    ----------
    robot, q, held
        As for `natural_vibration`. Modes that do not vibrate (zero frequency, or
        unstable) are not drawn.
    count : int
        Largest number of vibrations.
    plane : str, optional
        As for `plot_bending`.
    path, title
        See `kane_dynamics.plot`.

    Raises
    ------
    InputError
        As of `natural_vibration` and `plot_bending`; or if no mode vibrates.

    """
    resting_q = _checked(robot.model, q)[0]
    vibration = natural_vibration(robot, resting_q, held)
    fastest = float(np.abs(vibration.frequencies).max(initial=0.0))
    # Slow ones first; rigid motions have no frequency.
    modes = [k for k, frequency in enumerate(vibration.frequencies)
             if frequency > 1e-6 * fastest][:max(count, 0)]
    if not modes:
        raise InputError(f'count: {count}, no vibration to plot; expected at least one')
    still = _lines(robot.model, resting_q)
    points = np.concatenate([points for _, points in still])
    extent = float(np.ptp(points, axis=0).max())
    # Each mode at both ends of its swing, as large as can be seen.
    swings = [_swing(still, robot.model, resting_q, vibration.shapes[:, k],
                     SWING * extent)
              for k in modes]
    drawn = [still]
    for ends in swings:
        drawn += ends
    view = _View(plane, drawn)
    columns = min(len(modes), 4)
    rows = -(-len(modes) // columns)
    title = f'{title}, amplitudes not to scale'
    with styled(3.6 * columns, 0.6 + 3.6 * rows, title, path) as figure:
        for place, (k, ends) in enumerate(zip(modes, swings)):
            axes = view.panel(figure, rows, columns, place)
            for lines, color in zip((still, *ends), (GREY, BLUE, ORANGE)):
                view.draw(axes, lines, color)
            name = f'{vibration.frequencies[k] / (2.0 * np.pi):.4g} Hz'
            # A mode that moves no line turns the bodies about their lengths.
            if _largest_distance(still, ends[0]) <= 1e-3 * extent:
                name += ', twist'
            axes.set_title(name)
    return figure


def _largest_distance(lines: Lines, moved: Lines) -> float:
    """Return the largest distance along an axis between the points of lines, m."""
    distances = []
    for (_, points), (_, moved_points) in zip(lines, moved):
        distances.append(np.abs(moved_points - points).max())
    return float(max(distances))


def _checked(model: Model, q: Any) -> Array:
    """Return configurations as a (K, n) array of finite numbers."""
    require_angles(model, 'plot')
    rows = np.atleast_2d(np.array(q, dtype=np.float64))
    if rows.ndim != 2 or rows.shape[1] != model.n or not np.isfinite(rows).all():
        raise InputError(f'q: shape {np.shape(q)}; expected finite numbers of shape '
                         f'({model.n},) or (K, {model.n}), for '
                         f'{", ".join(model.coordinate_names)}')
    return rows


def _lines(model: Model, q: Array, exaggeration: float = 1.0) -> Lines:
    """
    Return the lines of a robot: bent beams, and other bodies from joint to joint.

    A body without joints or frames has no line.
    """
    q = q.copy()
    q[list(model.modal_coordinates)] *= exaggeration
    placed = configurations(model, q)
    frames = {frame.name: frame for frame in model.frames}
    lines: Lines = []

    # Beams, from the root through the quadrature points to the tip.
    for index, body in enumerate(model.bodies):
        if body.beam is None:
            continue
        across, along = body.beam.displacement(q[list(body.beam.coordinates)])
        local = np.concatenate([np.zeros((1, 3)), body.beam.points + across + along])
        points = placed[index].p_wb + local @ placed[index].R_wb.T
        tip = frames.get(f'{body.name}/tip')
        if tip is not None:
            points = np.vstack([points, placed[tip.body].p_wb])
        lines.append((True, points))

    # Rigid bodies, from their origin to the joints that they carry, or else to their
    # frames.
    ends = [(body.parent, body.joint.translation) for body in model.bodies
            if body.parent != WORLD and body.joint.deflection is None]
    carriers = {WORLD, *(body.parent for body in model.bodies)}
    ends += [(frame.body, frame.translation) for frame in model.frames
             if frame.body not in carriers]
    for index, end in ends:
        if end.any():
            start = placed[index].p_wb
            lines.append((False, np.array([start, start + placed[index].R_wb @ end])))
    return lines


def _swing(still: Lines, model: Model, resting_q: Array, shape: Array,
           amplitude: float) -> list[Lines]:
    """Return the lines at both ends of a small swing, scaled to an amplitude, m."""
    # The directions of the motion, from a step that is small enough to be linear.
    small = 1e-6 / np.abs(shape).max()
    moved = _lines(model, resting_q + small * shape)
    moves = [moved_points - points
             for (_, moved_points), (_, points) in zip(moved, still, strict=True)]
    largest = max(np.abs(move).max() for move in moves)
    scale = 0.0  # pure twist moves no line
    if largest > 1e-9 * amplitude:
        scale = amplitude / largest
    ends = []
    for sign in (1.0, -1.0):
        ends.append([(beam, points + sign * scale * move)
                     for (beam, points), move in zip(still, moves)])
    return ends


class _View:
    """View: the drawn world axes, and limits that contain all lines."""

    def __init__(self, plane: str | None, drawn: Sequence[Lines]) -> None:
        """Choose the given plane; by default the plane of all lines, else space."""
        if plane is not None and plane not in PLANES:
            raise InputError(f"plane: '{plane}'; expected one of {', '.join(PLANES)}")
        if not any(drawn):
            raise InputError('model: no body has a length; expected at least one')
        # All lines of all shapes have one scale.
        clouds = []
        for lines in drawn:
            clouds += [points for _, points in lines]
        cloud = np.concatenate(clouds)
        low = cloud.min(axis=0)
        size = np.ptp(cloud, axis=0)
        if plane is None:
            # Of lines in a plane, its normal direction is left out.
            plane = 'xyz'
            flat = [k for k in range(3) if size[k] <= FLAT * size.max()]
            if flat:
                plane = plane.replace('xyz'[flat[-1]], '')
        self.names = plane
        self._axes = list(map('xyz'.index, plane))
        margin = 0.06 * float(size.max())
        self._low = (low - margin)[self._axes]
        self._size = np.maximum(size, 2.0 * margin)[self._axes] + 2.0 * margin

    def panel(self, figure: Figure, rows: int, columns: int, k: int) -> Any:
        """Return panel k (from 0) of a figure."""
        in_space = len(self.names) == 3
        axes: Any = figure.add_subplot(rows, columns, k + 1,
                                       projection='3d' if in_space else None)
        for which, name, low, size in zip('xyz', self.names, self._low, self._size):
            axes.set(**{f'{which}label': f'{name} [m]',
                        f'{which}lim': (low, low + size)})
            ticks = max(2, round(6 * size / self._size.max()))
            getattr(axes, f'{which}axis').set_major_locator(MaxNLocator(ticks))
        axes.set_aspect('equal')
        if in_space:
            axes.set_box_aspect(self._size.copy(), zoom=0.7)  # room for the labels
            # A patch would cover the labels of the previous panel.
            axes.patch.set_visible(False)
            axes.tick_params(labelsize=7.0, pad=0.0)
            axes.zaxis.labelpad = 4.0
        return axes

    def draw(self, axes: Any, lines: Lines, color: Any,
             label: str | None = None) -> None:
        """Plot a robot with thick beams and a dot at the start of each line."""
        for is_beam, points in lines:
            coordinates = points[:, self._axes].T
            width = 2.4 if is_beam else 1.2
            axes.plot(*coordinates, color=color, label=label, linewidth=width)
            axes.plot(*coordinates[:, :1], 'o', color=INK, markersize=3.0)
            label = None  # one entry of the legend for all lines
