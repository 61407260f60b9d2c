"""The page: the scene, a slider over time or one for each joint, and what acts at the joints."""

from collections.abc import Sequence
from contextlib import redirect_stdout
import io
import socket
import threading
import time
from typing import Any

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.robot.robot import Robot
from kane_dynamics.shapes.link_shapes import bounds, size
from kane_dynamics.simulation.trajectory import Path, Trajectory
from kane_dynamics.urdf.visuals import Visual
from kane_dynamics.view.load_arrows import KINDS, LoadArrows, LONGEST, postures
from kane_dynamics.view.scene import COLORS, Scene
import numpy as np
from viser import ViserServer

_RATE = 25.0  # pictures a second
_SHOWN = ('torques', 'forces')  # at first
_SPEEDS = ('0.1', '0.25', '0.5', '1', '2')
_CAPTIONS = {'torques': 'joint torques', 'forces': 'reaction forces',
             'moments': 'reaction moments'}
_MOST = 2000  # states of a trajectory
_HOLD = 5.0  # s that an exported picture without a motion lasts


class Window:
    """
    A robot in the browser.

    Without a trajectory each joint has a slider, and the torques hold it against gravity.

    Parameters
    ----------
    robot : Robot
        With joint rates for speeds and no constraints, unless there is a trajectory.
    trajectory : Trajectory, optional
        A single motion of this robot.
    visuals : sequence of Visual
        What its links look like (`load_visuals`); rods stand for links without any.
    host : str
        Address to serve at; by default only this machine can see the page.
    port : int
        0 for any that is free; if the port is taken, the next free one.

    Raises
    ------
    InputError
        The trajectory is not of this robot, a mesh cannot be read, or the address is none of this
        machine's.

    """

    def __init__(self, robot: Robot, trajectory: Trajectory | None = None, *,
                 visuals: Sequence[Visual] = (), host: str = '127.0.0.1', port: int = 8080
                 ) -> None:
        """Prepare everything, and begin to serve."""
        self.robot, self.trajectory = robot, trajectory
        if trajectory is None:
            if robot.speed_names != robot.joint_names:
                raise InputError(f'the speeds of this robot are {list(robot.speed_names)}; '
                                 'without a trajectory the view needs the joint rates')
            self._q = _neutral(robot)
            self._largest = LoadArrows.at_rest(robot, postures(robot)).largest
        else:
            trajectory.require(robot, 'the view')
            self._q = trajectory.q[0]
            # As many states as a slider can tell apart.
            K = len(trajectory.t)
            rows = np.linspace(0, K - 1, min(K, _MOST)).astype(int)
            self._t = trajectory.t[rows]
            self._loads = LoadArrows.along(robot, *(part[rows] for part in (
                trajectory.q, trajectory.u, trajectory.udot, trajectory.tau, trajectory.t)))
            self._largest = self._loads.largest
        self._lock, self._playing, self._time = threading.Lock(), False, 0.0
        _check_address(host, port)
        with _quietly():
            self.server = ViserServer(host=host, port=port, verbose=False, label='kane_dynamics')
        try:
            extent = size(robot.model, self._q)
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
        """Play while the page asks for it, until interrupted."""
        before = time.monotonic()
        while True:
            time.sleep(1.0 / _RATE)
            now = time.monotonic()
            if self._playing and self.trajectory is not None:
                begin, end = self.trajectory.t[[0, -1]]
                self._time += (now - before) * float(self._speed.value)
                if self._time > end:
                    self._time = begin
                self._slider.value = self._time
            before = now

    def close(self) -> None:
        """Serve no more."""
        with _quietly():
            self.server.stop()

    def export(self, path: Path) -> None:
        """Write the motion, or the posture, as a page that needs no server; it can be replayed."""
        serializer = self.server.get_scene_serializer()
        if self.trajectory is None:
            serializer.insert_sleep(_HOLD)
        else:
            begin, end = self.trajectory.t[[0, -1]]
            for t in np.arange(begin, end, 1.0 / _RATE):
                self._show_at(t)
                serializer.insert_sleep(1.0 / _RATE)
            self._show_at(end)
        with open(path, 'w', encoding='utf-8') as file:
            file.write(serializer.as_html())

    def _box(self) -> tuple[Array, Array]:
        """Return the corners of the box that the camera should see, (3,) each, m."""
        some = [self._q] if self.trajectory is None else self.trajectory.q[
            ::max(1, len(self.trajectory.q) // 10)]
        corners = [bounds(self.robot.model, q) for q in some]
        return (np.min([low for low, _ in corners], axis=0),
                np.max([high for _, high in corners], axis=0))

    def _add_controls(self) -> None:
        """Put the controls on the page."""
        gui = self.server.gui
        gui.configure_theme(control_width='medium', show_logo=False, show_share_button=False)
        gui.set_panel_label(self.robot.model.name)
        if self.trajectory is None:
            with gui.add_folder('Joints'):
                self._add_joints(gui)
        else:
            self._add_time(gui)
        with gui.add_folder('Arrows'):
            gui.add_html(self._legend())
            for kind in KINDS:
                box = gui.add_checkbox(kind, kind in _SHOWN)
                self._stage.show(kind, kind in _SHOWN)
                box.on_update(lambda event, kind=kind: self._stage.show(kind, event.target.value))
            length = gui.add_slider('length', 0.2, 3.0, 0.1, 1.0)
            length.on_update(lambda event: self._set_length(event.target.value))
        with gui.add_folder('Robot'):
            opacity = gui.add_slider('opacity', 0.1, 1.0, 0.1, 1.0)
            opacity.on_update(lambda event: self._stage.set_opacity(event.target.value))
            names = gui.add_checkbox('joint names', False)
            names.on_update(lambda event: self._stage.show('names', event.target.value))
        self._table = gui.add_markdown('')

    def _legend(self) -> str:
        """Return the arrows' colours, meanings and scale as HTML."""
        rows = [f'<span style="color: rgb{COLORS[kind]}">&#9632;</span> {_CAPTIONS[kind]}, the '
                f'longest {self._largest[kind]:.3g} {"N" if kind == "forces" else "N m"}'
                for kind in KINDS]
        return f'<div style="font-size: 0.8em; padding: 0 1em">{"<br>".join(rows)}</div>'

    def _add_time(self, gui: Any) -> None:
        """Put a slider over time on the page, and what plays the motion."""
        assert self.trajectory is not None
        begin, end = self.trajectory.t[[0, -1]].tolist()
        step = 10.0 ** np.floor(np.log10(max(end - begin, 1e-6) / 100.0))
        self._slider = gui.add_slider('time [s]', begin, max(end, begin + step), step, begin)
        self._slider.on_update(lambda event: self._show_at(event.target.value))
        gui.add_button('Play').on_click(lambda event: self._play(event.target))
        self._speed = gui.add_dropdown('speed', _SPEEDS, initial_value='1')

    def _add_joints(self, gui: Any) -> None:
        """Put a slider for every coordinate on the page."""
        limits = self.robot.limits
        for i, name in enumerate(self.robot.joint_names):
            lower = np.ceil(1e3 * limits.lower[i]) / 1e3 if np.isfinite(limits.lower[i]) else -3.14
            upper = np.floor(1e3 * limits.upper[i]) / 1e3 if np.isfinite(limits.upper[i]) else 3.14
            slider = gui.add_slider(name, lower, max(upper, lower + 1e-3), 1e-3,
                                    float(np.clip(self._q[i], lower, upper)))
            slider.on_update(lambda event, i=i: self._turn(i, event.target.value))

    def _play(self, button: Any) -> None:
        self._time, self._playing = self._slider.value, not self._playing
        button.label = 'Pause' if self._playing else 'Play'

    def _turn(self, i: int, value: float) -> None:
        with self._lock:
            self._q = np.where(np.arange(len(self._q)) == i, value, self._q)
        self._show()

    def _set_length(self, factor: float) -> None:
        self._length = factor * LONGEST * self._stage.extent
        self._show()

    def _show_at(self, t: float) -> None:
        self._time = t
        self._show()

    def _show(self) -> None:
        """Draw the state of now: pages ask from threads of their own."""
        with self._lock:
            if self.trajectory is None:
                loads, k = LoadArrows.at_rest(self.robot, self._q[None]), 0
            else:
                loads, k = self._loads, int(np.abs(self._t - self._time).argmin())
            self._stage.place(loads.q[k], loads.arrows(k, self._length, self._largest))
            self._table.content = self._told(loads.q[k], loads.tau[k])

    def _told(self, q: Array, tau: Array) -> str:
        """Return positions and torques as a table in Markdown."""
        sliding, effort = self.robot.model.sliding, self.robot.limits.effort
        place, load = ('rad, m', 'N m, N') if sliding else ('rad', 'N m')
        rows = [f'| joint | q [{place}] | τ [{load}] | of limit |', '|:--|--:|--:|--:|']
        for i, name in enumerate(self.robot.joint_names):
            share = f'{abs(tau[i]) / effort[i]:.0%}' if np.isfinite(effort[i]) else ''
            rows.append(f'| {name} | {q[i]:.3f} | {tau[i].round(6) + 0.0:.3g} | {share} |')
        return '\n'.join(rows)


def _neutral(robot: Robot) -> Array:
    """Return a posture within the limits, zero where they allow it."""
    return np.clip(np.zeros(robot.n_q), robot.limits.lower, robot.limits.upper)


def _quietly() -> redirect_stdout[io.StringIO]:
    """Keep what viser has to say from the user's output."""
    return redirect_stdout(io.StringIO())


def _check_address(host: str, port: int) -> None:
    """Raise InputError where nothing can be served at all."""
    if not 0 <= port < 65536:
        raise InputError(f'port is {port}; valid: 0 (any that is free) to 65535')
    try:
        socket.create_server((host, 0)).close()
    except OSError as error:
        raise InputError(f"host is '{host}': {error}; expected an address of this machine"
                         ) from None
