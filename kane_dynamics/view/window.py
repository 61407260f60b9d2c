"""Page of the viewer: scene, time or joint sliders, and table of loads."""

from collections.abc import Sequence
from contextlib import redirect_stdout
from functools import partial
import io
import socket
import threading
import time
from typing import Any

from kane_dynamics._util.typing import Array
from kane_dynamics._util.whole_files import whole_file
from kane_dynamics.control.computed_torque import followed_joints
from kane_dynamics.errors import ConstraintError, InputError
from kane_dynamics.kinematics.body_poses import model_bounds, model_size
from kane_dynamics.loop_tracking.loop_tracker import velocity_rows
from kane_dynamics.mechanics.ball_joints import require_angles
from kane_dynamics.model.link_shapes import LinkShape
from kane_dynamics.robot.robot import Robot
from kane_dynamics.simulation.trajectory import Path, Trajectory
from kane_dynamics.view.exported_page import add_panel
from kane_dynamics.view.joint_table import markdown_table
from kane_dynamics.view.load_arrows import (KINDS, LoadArrows, LONGEST,
                                            sampled_configurations)
from kane_dynamics.view.scene import COLORS, Scene
import numpy as np
from viser import ViserServer

_RATE = 25.0  # pictures a second
_SHOWN = ('torques', 'forces', 'contacts')  # initially visible
_SPEEDS = ('0.1', '0.25', '0.5', '1', '2')
_CAPTIONS = {'torques': 'joint torques', 'forces': 'reaction forces',
             'moments': 'reaction moments', 'contacts': 'forces of contacts'}
_ASIDE = 0.2  # the table of an exported page is wider than the controls
_STEP = 1e-3  # of a slider, rad or m
_MOST = 2000  # states of a trajectory


class Window:
    """
    Viewer of a robot in the browser.

    Without a trajectory each joint has a slider, with closed loops each independent
    joint, and the torques are those at rest under gravity.

    Parameters
    ----------
    robot : Robot
        With ball joints it needs a trajectory.
    trajectory : Trajectory, optional
        A single motion of this robot.
    visuals : sequence of LinkShape
        Shapes of its links (`load_visuals`); links without shapes are drawn as rods.
    host : str
        Address to serve at; the default is reachable from this machine only.
    port : int
        Port, or the next free one; 0 chooses any free port.

    Raises
    ------
    InputError
        If the trajectory is not of this robot, a mesh cannot be read, or the address is
        not one of this machine.

    """

    def __init__(self, robot: Robot, trajectory: Trajectory | None = None, *,
                 visuals: Sequence[LinkShape] = (), host: str = '127.0.0.1',
                 port: int = 8080
                 ) -> None:
        """Build the scene and start the server."""
        self.robot = robot
        self.trajectory = trajectory
        # Without a motion the loads are those at rest, and sliders move the joints.
        if trajectory is None:
            require_angles(robot.model, 'view')
            self._turned = _turned_joints(robot)
            self._q = robot.feasible_configuration()
            samples = sampled_configurations(robot)
            self._largest = LoadArrows.at_rest(robot, samples).largest
        else:
            trajectory.require(robot, 'the view')
            self._q = trajectory.q[0]
            # A slider cannot resolve more states.
            K = len(trajectory.t)
            rows = np.linspace(0, K - 1, min(K, _MOST)).astype(int)
            self._t = trajectory.t[rows]
            contacts = np.stack([trajectory.contact_points[rows],
                                 trajectory.contact_forces[rows]], axis=1)
            self._loads = LoadArrows.along(robot, trajectory.q[rows], trajectory.u[rows],
                                           trajectory.udot[rows], trajectory.tau[rows],
                                           self._t, contacts)
            self._largest = self._loads.largest
        self._lock = threading.Lock()
        self._playing = False
        self._time = 0.0
        _check_address(host, port)
        with _quietly():
            self.server = ViserServer(host=host, port=port, verbose=False,
                                      label='kane_dynamics')
        # A scene that fails must not leave its server behind.
        try:
            extent = model_size(robot.model, self._q)
            self._stage = Scene(self.server, robot.model, visuals, extent)
            self._length = LONGEST * extent
            self._stage.look(*self._box())
            self._add_controls()
            self._show()
        except BaseException:
            self.close()
            raise

    @property
    def url(self) -> str:
        """Return the address of the page."""
        return f'http://{self.server.get_host()}:{self.server.get_port()}'

    def run(self) -> None:
        """Play the motion while the page is in play mode, until interrupted."""
        last = time.monotonic()
        while True:
            time.sleep(1.0 / _RATE)
            now = time.monotonic()
            if self._playing and self.trajectory is not None:
                # Advance by the time that passed, times the speed; begin again at the
                # end.
                begin, end = self.trajectory.t[[0, -1]]
                self._time += (now - last) * float(self._speed.value)
                if self._time > end:
                    self._time = begin
                self._slider.value = self._time
            last = now

    def close(self) -> None:
        """Stop the server."""
        with _quietly():
            self.server.stop()

    def export(self, path: Path) -> None:
        """Write a page that needs no server, with the panel of `add_panel`."""
        self._stage.look(*self._box(), aside=_ASIDE)
        serializer = self.server.get_scene_serializer()
        if self.trajectory is None:
            loads = LoadArrows.at_rest(self.robot, self._q[None])
            rows = [0]
            t = None
        else:
            # Every moment of the motion is a picture of the exported page.
            begin, end = self.trajectory.t[[0, -1]]
            times = [*np.arange(begin, end, 1.0 / _RATE), end]
            loads = self._loads
            rows = [self._row(moment) for moment in times]
            t = self._t[rows]
            for moment in times[:-1]:
                self._show_at(moment)
                serializer.insert_sleep(1.0 / _RATE)
            self._show_at(end)
        # The panel shows the numbers of the moment that the page shows.
        page = add_panel(serializer.as_html(), self.robot, self._legend(_SHOWN), t,
                         loads.q[rows], loads.tau[rows], 1.0 / _RATE)
        with whole_file(path) as file:
            file.write(page)

    def _box(self) -> tuple[Array, Array]:
        """Return the corners of the visible box, (3,) each, m."""
        configurations = self._q[None]
        if self.trajectory is not None:  # about ten of them
            configurations = self.trajectory.q[::max(1, len(self.trajectory.q) // 10)]
        low, high = model_bounds(self.robot.model, configurations[0])
        for q in configurations[1:]:
            next_low, next_high = model_bounds(self.robot.model, q)
            low = np.minimum(low, next_low)
            high = np.maximum(high, next_high)
        return low, high

    def _add_controls(self) -> None:
        """Add the controls to the page."""
        gui = self.server.gui
        gui.configure_theme(control_width='medium', show_logo=False,
                            show_share_button=False)
        gui.set_panel_label(self.robot.model.name)
        # A trajectory sets the joints itself; without one they have sliders.
        if self.trajectory is None:
            with gui.add_folder('Joints'):
                self._add_joints(gui)
        else:
            self._add_time(gui)
        # Arrows are shown and hidden by their kind, under a legend of the colours.
        with gui.add_folder('Arrows'):
            gui.add_html('<div style="font-size: 0.8em; padding: 0 1em">'
                         f'{self._legend(KINDS)}</div>')
            for kind in KINDS:
                box = gui.add_checkbox(kind, kind in _SHOWN)
                self._stage.show(kind, kind in _SHOWN)
                box.on_update(partial(self._show_arrows, kind))
            length = gui.add_slider('length', 0.2, 3.0, 0.1, 1.0)
            length.on_update(lambda event: self._set_length(event.target.value))
        with gui.add_folder('Robot'):
            opacity = gui.add_slider('opacity', 0.1, 1.0, 0.1, 1.0)
            opacity.on_update(lambda event: self._stage.set_opacity(event.target.value))
            names = gui.add_checkbox('joint names', False)
            names.on_update(lambda event: self._stage.show('names', event.target.value))
        # The numbers of the state shown, filled at each update.
        self._table = gui.add_markdown('')

    def _legend(self, kinds: Sequence[str]) -> str:
        """Return the colors, meanings and scale of some kinds of arrows as HTML."""
        rows = []
        for kind in kinds:
            if kind == 'contacts' and not self._largest[kind]:
                continue
            unit = 'N' if kind in ('forces', 'contacts') else 'N m'
            rows.append(f'<span style="color: rgb{COLORS[kind]}">&#9632;</span> '
                        f'{_CAPTIONS[kind]}, the longest {self._largest[kind]:.3g} '
                        f'{unit}')
        return '<br>'.join(rows)

    def _add_time(self, gui: Any) -> None:
        """Add a time slider, a play button and the speed of the motion to the page."""
        assert self.trajectory is not None
        begin, end = self.trajectory.t[[0, -1]].tolist()
        step = 10.0 ** np.floor(np.log10(max(end - begin, 1e-6) / 100.0))
        self._slider = gui.add_slider('time '
                                      '[s]', begin, max(end, begin + step), step, begin)
        self._slider.on_update(lambda event: self._show_at(event.target.value))
        gui.add_button('Play').on_click(lambda event: self._play(event.target))
        self._speed = gui.add_dropdown('speed', _SPEEDS, initial_value='1')

    def _add_joints(self, gui: Any) -> None:
        """Add a slider to the page for every joint that is turned by hand."""
        limits = self.robot.limits
        for i in self._turned:
            # Within the limits, by whole steps of the slider.
            lower = -3.14
            upper = 3.14
            if np.isfinite(limits.lower[i]):
                lower = np.ceil(1e3 * limits.lower[i]) / 1e3
            if np.isfinite(limits.upper[i]):
                upper = np.floor(1e3 * limits.upper[i]) / 1e3
            position = float(np.clip(self._q[i], lower, upper))
            slider = gui.add_slider(self.robot.joint_names[i], lower,
                                    max(upper, lower + _STEP), _STEP, position)
            slider.on_update(lambda event, i=i: self._turn(i, event.target.value))

    def _play(self, button: Any) -> None:
        self._time = self._slider.value
        self._playing = not self._playing
        button.label = 'Pause' if self._playing else 'Play'

    def _turn(self, i: int, value: float) -> None:
        # One joint changes; in a closed loop the dependent ones follow it.
        with self._lock:
            q = np.where(np.arange(len(self._q)) == i, value, self._q)
            turned_names = [self.robot.joint_names[k] for k in self._turned]
            try:
                q = self.robot.closed_configuration(q, fixed=turned_names)
            except ConstraintError:
                return  # beyond the reach of the mechanism: the picture stays
            self._q = q
        self._show()

    def _show_arrows(self, kind: str, event: Any) -> None:
        self._stage.show(kind, event.target.value)

    def _set_length(self, factor: float) -> None:
        self._length = factor * LONGEST * self._stage.extent
        self._show()

    def _show_at(self, t: float) -> None:
        self._time = t
        self._show()

    def _show(self) -> None:
        """Draw the current state; called from several threads."""
        with self._lock:
            if self.trajectory is None:
                loads = LoadArrows.at_rest(self.robot, self._q[None])
                k = 0
            else:
                loads = self._loads
                k = self._row(self._time)
            self._stage.place(loads.q[k], loads.arrows(k, self._length, self._largest))
            self._table.content = markdown_table(self.robot, loads.q[k], loads.tau[k])

    def _row(self, t: float) -> int:
        """Return the row of the state nearest to a time."""
        return int(np.abs(self._t - t).argmin())


def _turned_joints(robot: Robot) -> tuple[int, ...]:
    """Return the indices of the joints with sliders: all, or the independent ones."""
    names = robot.joint_names
    speeds = robot.speed_names
    only_velocities = len(velocity_rows(robot)) == len(robot.constraint_names)
    if only_velocities:  # no constraint on positions
        return tuple(range(len(names)))
    if set(speeds) <= set(names):
        return tuple(map(names.index, speeds))
    return followed_joints(robot)


def _quietly() -> redirect_stdout[io.StringIO]:
    """Suppress the output of viser."""
    return redirect_stdout(io.StringIO())


def _check_address(host: str, port: int) -> None:
    """Raise InputError for an address that cannot be served."""
    if not 0 <= port < 65536:
        raise InputError(f'port: {port}; expected 0 (any free port) to 65535')
    try:
        socket.create_server((host, 0)).close()
    except OSError as error:
        raise InputError(f"host: '{host}': {error}; expected an address of this machine"
                         ) from None
