"""Pictures of a motion, for --plot."""

from argparse import Namespace
from typing import Any

from kane_dynamics._util.optional_imports import extra
from kane_dynamics.errors import InputError
from kane_dynamics.motion.motion import Motion
from kane_dynamics.robot.robot import Robot
from kane_dynamics.simulation.trajectory import Trajectory


def plotter(options: Namespace) -> Any:
    """Return the plot module, or None without --plot; raise InputError for invalid options."""
    if options.plot is None:
        return None
    if options.plot_of == 'tracking' and options.motion is None:
        raise InputError('--plot-of: tracking without --motion; expected --motion FILE, '
                         'the desired motion')
    plot = extra('kane_dynamics.plot', 'plot', '--plot')
    plot.check_path(options.plot)
    return plot


def draw(plot: Any, options: Namespace, robot: Robot, trajectory: Trajectory,
         desired: Motion | None = None) -> None:
    """Write the picture that the options choose."""
    what = options.plot_of or options.plot_default
    sliding = robot.model.sliding
    name = robot.model.name
    # Two plots have options of their own; the others need robot and trajectory.
    if what == 'trajectory':
        plot.plot_trajectory(trajectory, options.plot, prismatic=sliding,
                             limits=robot.limits, title=f'{name}: motion over time')
    elif what == 'tracking' and desired is not None:
        q_desired, _, _ = desired.sample(trajectory.t)
        joints = list(map(robot.coordinate_names.index, desired.joint_names))
        plot.plot_tracking({'simulated': (trajectory.t, q_desired,
                                          trajectory.q[:, joints])},
                           desired.joint_names, options.plot, prismatic=sliding,
                           title=f'{name}: tracking of the desired motion')
    else:
        draws = {'torque-by-source': plot.plot_torque_by_source,
                 'energy': plot.plot_energy,
                 'reactions': plot.plot_reactions, 'phase': plot.plot_phase}
        draws[what](robot, trajectory, options.plot)
