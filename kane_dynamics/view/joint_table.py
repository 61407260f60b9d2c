"""Table of joints beside the picture: positions, torques, and their limits."""

from collections.abc import Iterator
from html import escape
from typing import NamedTuple

from kane_dynamics._util.typing import Array
from kane_dynamics.robot.robot import Robot
import numpy as np

_NONE = '–'  # without a limit


class JointRow(NamedTuple):
    """Text of one joint; `q_over` and `tau_over` are true if a limit is exceeded."""

    name: str
    q: str
    tau: str
    share: str
    q_over: bool
    tau_over: bool


def load_rows(robot: Robot, q: Array, tau: Array) -> Iterator[JointRow]:
    """
    Yield the row of every joint.

    The row of a ball joint, whose position is a rotation, has its moments only.

    Parameters
    ----------
    robot : Robot
        Its joints have the names and limits of the table.
    q : (n_q,) array
        rad or m.
    tau : (n,) array
        Actuator torque of each joint, N m or N.

    """
    limits = robot.limits
    for i, (name, place) in enumerate(zip(robot.joint_names, robot.model.places)):
        position = ''
        beyond_range = False
        if place is not None:
            position = f'{q[place].round(3) + 0.0:.3f}'  # + 0.0 turns -0.0 into 0.0
            inside = limits.lower[place] <= q[place] <= limits.upper[place]
            beyond_range = not inside
        # The share of the effort limit, where there is one.
        effort = limits.effort[i]
        share = ''
        if np.isfinite(effort):
            fraction = abs(tau[i]) / effort if effort > 0.0 else 0.0
            share = f'{fraction:.0%}'
        torque = f'{tau[i].round(6) + 0.0:.3g}'
        yield JointRow(name, position, torque, share, beyond_range,
                       bool(abs(tau[i]) > effort))


def markdown_table(robot: Robot, q: Array, tau: Array) -> str:
    """Return positions and torques as a table in Markdown; see `load_rows`."""
    position_unit = 'rad'
    load_unit = 'N m'
    if robot.model.sliding:
        position_unit = 'rad, m'
        load_unit = 'N m, N'
    head = f'| joint | q [{position_unit}] | τ [{load_unit}] | of limit |'
    lines = [head, '|:--|--:|--:|--:|']
    for row in load_rows(robot, q, tau):
        lines.append(f'| {row.name} | {row.q} | {row.tau} | {row.share} |')
    return '\n'.join(lines)


def html_load_table(robot: Robot, q: Array, tau: Array) -> str:
    """Return positions, torques and limits as a table in HTML; see `load_rows`."""
    limits = robot.limits
    sliding = robot.model.sliding
    # Units are in the header if all joints share them, else after the name of each
    # joint.
    columns = ['joint', 'q', 'range', 'τ', 'limit', 'share']
    if not sliding:
        columns = ['joint', 'q [rad]', 'range', 'τ [N m]', 'limit', 'share']
    head = ''.join(f'<th>{column}</th>' for column in columns)
    lines = [f'<table id="joints"><tr>{head}</tr>']
    for i, row in enumerate(load_rows(robot, q, tau)):
        units = ''
        if sliding:
            units = ' [m, N]' if row.name in sliding else ' [rad, N m]'
        place = robot.model.places[i]
        bounds = _NONE
        if place is not None:
            bounds = _range_text(limits.lower[place], limits.upper[place])
        effort = f'±{limits.effort[i]:.4g}' if np.isfinite(limits.effort[i]) else _NONE
        lines.append(
            f'<tr><td>{escape(row.name)}{units}</td>'
            f'<td><span{_over(row.q_over)}>{row.q}</span></td><td>{bounds}</td>'
            f'<td><span{_over(row.tau_over)}>{row.tau}</span></td><td>{effort}</td>'
            f'<td><span{_over(row.tau_over)}>{row.share}</span></td></tr>')
    return '\n'.join([*lines, '</table>'])


def _range_text(lower: float, upper: float) -> str:
    """Return a range as a text; a dash for no bound, and one dash for none at all."""
    if not (np.isfinite(lower) or np.isfinite(upper)):
        return _NONE
    return f'{_number(lower)} … {_number(upper)}'


def _over(over: bool) -> str:
    return ' class="over"' if over else ''


def _number(bound: float) -> str:
    return f'{bound:.4g}' if np.isfinite(bound) else _NONE
