"""Panel of an exported page: legend, scale of the arrows, table of joints."""

from html import escape
import json

from kane_dynamics._util.typing import Array
from kane_dynamics.robot.robot import Robot
from kane_dynamics.view.joint_table import html_load_table, load_rows

_STYLE = """<style>
#loads { position: fixed; top: 3.8em; right: 1em; z-index: 1;
  max-height: calc(100vh - 8em); overflow: auto; padding: 0.6em 0.9em;
  border-radius: 4px; font: 12px sans-serif; color: #222;
  background: rgb(255 255 255 / 0.92); box-shadow: 0 1px 6px rgb(0 0 0 / 0.2); }
#loads summary { font-weight: bold; cursor: pointer; }
#loads p { margin: 0.4em 0; line-height: 1.45; }
#loads table { border-collapse: collapse; font-variant-numeric: tabular-nums; }
#loads th, #loads td { padding: 0.15em 0.4em; text-align: right; white-space: nowrap; }
#loads th { border-bottom: 1px solid #bbb; font-weight: 600; }
#loads th:first-child, #loads td:first-child { text-align: left; padding-left: 0; }
#loads .over { color: #b00020; font-weight: bold; }
</style>"""

# The player shows its time on a slider, from 0 to the duration of the recording.
_SCRIPT = """<script>
addEventListener('load', () => {
  const motion = JSON.parse(document.getElementById('motion').textContent);
  const cells = [...document.querySelectorAll('#joints tr')].slice(1)
    .map(row => [...row.querySelectorAll('span')]);
  const time = document.getElementById('time');
  let shown = -1;
  const show = () => {
    requestAnimationFrame(show);
    const player = [...document.querySelectorAll('[role=slider]')]
      .find(slider => Math.abs(slider.getAttribute('aria-valuemax') - motion.duration)
        < 1e-6);
    if (!player) return;
    const k = Math.min(motion.rows.length - 1,
      Math.floor(player.getAttribute('aria-valuenow') / motion.period + 1e-6));
    if (k === shown) return;
    shown = k;
    time.textContent = motion.times[k];
    motion.rows[k].forEach(([q, tau, share, qOver, tauOver], i) =>
      [[q, qOver], [tau, tauOver], [share, tauOver]].forEach(([text, over], j) => {
        cells[i][j].textContent = text;
        cells[i][j].className = over ? 'over' : '';
      }));
  };
  show();
});
</script>"""


def add_panel(page: str, robot: Robot, legend: str, t: Array | None, q: Array,
              tau: Array, period: float) -> str:
    """
    Return a page of viser with a panel that describes its picture.

    Parameters
    ----------
    page : str
        HTML of `as_html`.
    robot : Robot
        Its joints have the names and limits of the table.
    legend : str
        HTML: colors, meanings and scale of the arrows.
    t : (K,) array, optional
        Times of the states, s; None for a single one, of a configuration at rest.
    q, tau : (K, n_q) arrays
        Positions in rad or m, and torques of the actuators in N m or N, at those times.
    period : float
        Time between two pictures, s.

    """
    name = escape(robot.model.name)
    when = '<p>At rest; τ: torques that hold the robot against gravity</p>'
    if t is not None:
        when = (f'<p>Time <span id="time">{t[0]:.2f}</span> s of {t[-1]:.2f} s; τ: '
                'torques of the motion</p>')
    heading = f'<details id="loads" open><summary>{name}</summary>'
    table = html_load_table(robot, q[0], tau[0])
    panel = [_STYLE, heading, f'<p>{legend}</p>', when, table, '</details>']
    if t is not None:
        # The texts that the script puts into the table, but for the names, at each time.
        rows_by_time = []
        for state in zip(q, tau):
            rows_by_time.append([row[1:] for row in load_rows(robot, *state)])
        motion = {'period': period, 'duration': (len(t) - 1) * period,
                  'times': [f'{time:.2f}' for time in t], 'rows': rows_by_time}
        # Only numbers and percentages: no text can end the element.
        panel += ['<script id="motion" type="application/json">', json.dumps(motion),
                  '</script>', _SCRIPT]
    content, closing_tag, end = page.rpartition('</body>')
    described = content + '\n'.join(panel) + closing_tag + end
    return described.replace('<title>Viser</title>', f'<title>{name}</title>', 1)
