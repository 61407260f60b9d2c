"""Plot of joint reactions."""

from kane_dynamics.plot.style import (beside, BLUE, draw, GREEN, INK, legend_below, Path, RED,
                                      show_at_least, styled, time_axis, titled, zero_line)
from kane_dynamics.robot.robot import Robot
from kane_dynamics.simulation.trajectory import Trajectory
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
    title = titled(title, 'joint reactions, parent on child, world axes', robot.model.name)
    reactions = robot.joint_reactions(trajectory.q, trajectory.u, trajectory.udot, t=trajectory.t)
    least = 1e-6 * np.abs(reactions).max()
    joints = [body.joint.name for body in robot.model.bodies]
    with styled(11.0, 1.3 + 1.55 * len(joints), title, path) as figure:
        panels = figure.subplots(len(joints), 2, sharex=True, squeeze=False)
        for i, name in enumerate(joints):
            for axes, (unit, part) in zip(panels[i], (('N', slice(0, 3)), ('N m', slice(3, 6))),
                                          strict=True):
                vector = reactions[:, i, part]
                size = np.linalg.norm(vector, axis=1)
                zero_line(axes)
                draw(axes, trajectory.t, {
                    **{label: (row, color, '-')
                       for (label, color), row in zip(_AXES.items(), vector.T, strict=True)},
                    'magnitude': (size, INK, '--')})
                show_at_least(axes, least)
                axes.set_ylabel(f'{name}\n[{unit}]' if unit == 'N' else f'[{unit}]')
                beside(axes, ('largest', INK), (f'{size.max():.3g} {unit}', INK))
        for axes, text in zip(panels[0], ('Force', 'Moment about the joint'), strict=True):
            axes.set_title(text)
        legend_below(figure, panels[0, :1])
        time_axis(panels)
    return figure
