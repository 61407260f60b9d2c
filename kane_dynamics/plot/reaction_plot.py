"""Plot of joint reactions."""

from kane_dynamics._util.typing import Array
from kane_dynamics.plot.style import (beside, BLUE, GREEN, INK, legend_below, Path,
                                      plot_lines, RED, show_at_least, styled, time_axis,
                                      titled, zero_line)
from kane_dynamics.robot.robot import Robot
from kane_dynamics.simulation.trajectory import Trajectory
from matplotlib.axes import Axes
from matplotlib.figure import Figure
import numpy as np

_AXES = {'x': RED, 'y': GREEN, 'z': BLUE}


def plot_reactions(robot: Robot, trajectory: Trajectory, path: Path | None = None, *,
                   title: str | None = None) -> Figure:
    """
    Plot force and moment at every joint: three components each, and their magnitudes.

    For the parameters see `kane_dynamics.plot`.
    """
    trajectory.require(robot, 'plot_reactions')
    title = titled(title, 'joint reactions, parent on child, world '
                          'axes', robot.model.name)
    reactions = robot.joint_reactions(trajectory.q, trajectory.u, trajectory.udot,
                                      t=trajectory.t)
    # Smaller components are rounding of the largest one.
    least = 1e-6 * np.abs(reactions).max()
    joints = [body.joint.name for body in robot.model.bodies]
    with styled(11.0, 1.3 + 1.55 * len(joints), title, path) as figure:
        panels = figure.subplots(len(joints), 2, sharex=True, squeeze=False)
        # Force on the left, moment about the joint on the right.
        for i, name in enumerate(joints):
            force_panel, moment_panel = panels[i]
            _plot_vector(force_panel, trajectory.t, reactions[:, i, :3], 'N', least)
            _plot_vector(moment_panel, trajectory.t, reactions[:, i, 3:], 'N m', least)
            force_panel.set_ylabel(f'{name}\n[N]')
            moment_panel.set_ylabel('[N m]')
        for axes, text in zip(panels[0], ('Force',
                                          'Moment about the joint'), strict=True):
            axes.set_title(text)
        legend_below(figure, panels[0, :1])
        time_axis(panels)
    return figure


def _plot_vector(axes: Axes, t: Array, vector: Array, unit: str, least: float) -> None:
    """Plot the three components of a vector, (K, 3), and its magnitude."""
    magnitude = np.linalg.norm(vector, axis=1)
    lines: dict[str, tuple[Array, str, str]] = {}
    for (label, color), component in zip(_AXES.items(), vector.T, strict=True):
        lines[label] = component, color, '-'
    lines['magnitude'] = magnitude, INK, '--'
    zero_line(axes)
    plot_lines(axes, t, lines)
    show_at_least(axes, least)
    beside(axes, ('largest', INK), (f'{magnitude.max():.3g} {unit}', INK))
