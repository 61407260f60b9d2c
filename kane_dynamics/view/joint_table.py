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


def joint_rows(robot: Robot, q: Array, tau: Array) -> Iterator[JointRow]:
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
        share = abs(tau[i]) / limits.effort[i] if limits.effort[i] > 0.0 else 0.0
        yield JointRow(name, '' if place is None else f'{q[place].round(3) + 0.0:.3f}',
                       f'{tau[i].round(6) + 0.0:.3g}',
                       f'{share:.0%}' if np.isfinite(limits.effort[i]) else '',
                       place is not None and bool(
                           q[place] < limits.lower[place] or q[place] > limits.upper[place]),
                       bool(abs(tau[i]) > limits.effort[i]))


def markdown_table(robot: Robot, q: Array, tau: Array) -> str:
    """Return positions and torques as a table in Markdown; see `joint_rows`."""
    place, load = ('rad, m', 'N m, N') if robot.model.sliding else ('rad', 'N m')
    rows = [f'| joint | q [{place}] | τ [{load}] | of limit |', '|:--|--:|--:|--:|']
    rows += [f'| {row.name} | {row.q} | {row.tau} | {row.share} |'
             for row in joint_rows(robot, q, tau)]
    return '\n'.join(rows)


def html_table(robot: Robot, q: Array, tau: Array) -> str:
    """Return positions, torques and limits as a table in HTML; see `joint_rows`."""
    limits, sliding = robot.limits, robot.model.sliding
    # Units are in the header if all joints share them, else after the name of each joint.
    place, load = ('', '') if sliding else (' [rad]', ' [N m]')
    head = ''.join(f'<th>{column}</th>' for column in (
        'joint', f'q{place}', 'range', f'τ{load}', 'limit', 'share'))
    lines = [f'<table id="joints"><tr>{head}</tr>']
    for i, row in enumerate(joint_rows(robot, q, tau)):
        units = '' if not sliding else ' [m, N]' if row.name in sliding else ' [rad, N m]'
        at = robot.model.places[i]
        ends = [] if at is None else [limits.lower[at], limits.upper[at]]
        bounds = ' … '.join(map(_number, ends)) if np.isfinite(ends).any() else _NONE
        effort = f'±{limits.effort[i]:.4g}' if np.isfinite(limits.effort[i]) else _NONE
        lines.append(
            f'<tr><td>{escape(row.name)}{units}</td>'
            f'<td><span{_over(row.q_over)}>{row.q}</span></td><td>{bounds}</td>'
            f'<td><span{_over(row.tau_over)}>{row.tau}</span></td><td>{effort}</td>'
            f'<td><span{_over(row.tau_over)}>{row.share}</span></td></tr>')
    return '\n'.join([*lines, '</table>'])


def _over(over: bool) -> str:
    return ' class="over"' if over else ''


def _number(bound: float) -> str:
    return f'{bound:.4g}' if np.isfinite(bound) else _NONE
