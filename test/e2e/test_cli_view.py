"""`kane-dynamics view` shows a moving robot to browsers on this machine only."""

from contextlib import ExitStack
from html import unescape
from pathlib import Path
import re
import subprocess
import sys
import time

from browser import browser, CHROMIUM
from kane_dynamics import load_urdf, Robot
from kane_dynamics.cli import main
from kane_dynamics.cli.tables import load_trajectory
import numpy as np
import pytest

URDF = Path(__file__).resolve().parents[2] / 'urdf' / 'two_link.urdf'
SLIDER = "document.querySelector('[role=slider]')"
MOTION = """t,q.joint1,q.joint2
0,0,0
1,1.2,-0.8
"""


def settled(page, seconds=60.0):
    """Return a picture of the page once it no longer changes: shapes fade in."""
    end = time.monotonic() + seconds
    picture_before = page.picture()
    while time.monotonic() < end:
        time.sleep(0.3)
        picture = page.picture()
        if np.abs(picture - picture_before).max() < 0.02:
            return picture
        picture_before = picture
    raise AssertionError('the page never comes to rest')


def robot_part(picture):
    """Return the part of a picture that controls and notices do not cover."""
    height, width, _ = picture.shape
    return picture[height // 3:, :int(0.7 * width)]


@pytest.mark.skipif(CHROMIUM is None,
                    reason='no Chromium on PATH: apt-get install chromium')
def test_a_browser_shows_the_robot_and_its_slider_moves_it(tmp_path):
    (tmp_path / 'motion.csv').write_text(MOTION)
    process = subprocess.Popen(
        [sys.executable, '-m', 'kane_dynamics.cli', 'view', str(URDF), '--no-open',
         '--port', '0', '--motion', str(tmp_path / 'motion.csv')],
        stdout=subprocess.PIPE, text=True)
    with process, ExitStack() as ending:
        ending.callback(process.terminate)
        url = process.stdout.readline().split()[-1]
        assert url.startswith('http://127.0.0.1:')
        page = ending.enter_context(browser(url))
        page.wait(f"document.querySelector('canvas') && {SLIDER}")
        first = settled(page)
        page.evaluate(f'{SLIDER}.focus()')
        page.press('End')
        page.wait(f"{SLIDER}.getAttribute('aria-valuenow') == 1")
        page.wait("document.body.innerText.includes('-0.800')")  # the elbow in the table
        last = settled(page)
        page.press('Home')
        page.wait("document.body.innerText.includes('0.000')")
        again = settled(page)
        page.evaluate("[...document.querySelectorAll('button')]"
                      ".find(b => b.innerText == 'Play').click()")
        page.wait(f"{SLIDER}.getAttribute('aria-valuenow') > 0.2")
    assert page.errors == []
    assert [request for request in page.requests
            if not request.startswith((url, 'data:', f'blob:{url}'))] == []
    first, last, again = map(robot_part, (first, last, again))
    # Something stands on the light floor.
    assert (first < 0.6).any(axis=-1).mean() > 0.005
    moved = (np.abs(last - first).max(axis=-1) > 0.1).mean()
    assert moved > 0.01
    assert (np.abs(again - first).max(axis=-1) > 0.1).mean() < 0.1 * moved


@pytest.mark.parametrize('what', [[], ['--motion', 'motion.csv']],
                         ids=['still', 'moving'])
def test_an_exported_page_is_whole_without_a_server(tmp_path, what, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path('motion.csv').write_text(MOTION)
    assert main(['view', str(URDF), *what, '--export', 'page.html']) == 0
    assert capsys.readouterr().out == 'wrote page.html\n'
    page = Path('page.html').read_text()
    assert '__VISER_EMBED_DATA__="' in page
    assert 'src="http' not in page and 'href="http' not in page


@pytest.mark.parametrize('what', [[], ['--motion', 'motion.csv']],
                         ids=['still', 'moving'])
def test_an_exported_page_has_legend_units_torques_limits_and_joints(
        tmp_path, what, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path('motion.csv').write_text(MOTION)
    assert main(['view', str(URDF), *what, '--export', 'page.html']) == 0
    page = Path('page.html').read_text()
    assert '<title>two_link</title>' in page
    panel = unescape(re.sub(r'<[^>]+>', ' ', page[page.index('<details'):])).split()
    text = ' '.join(panel)
    assert re.search(r'joint torques, the longest \d+(\.\d+)? N m', text)
    assert re.search(r'reaction forces, the longest \d+(\.\d+)? N ', text)
    robot = Robot(load_urdf(URDF))
    limits = robot.limits
    for i, joint in enumerate(robot.joint_names):
        row = text[text.index(joint):].split('%')[0]
        assert (f'{limits.lower[i]:.4g} … {limits.upper[i]:.4g}' in row
                and f'±{limits.effort[i]:.4g}' in row)
    assert 'joint q [rad] range τ [N m] limit share' in text
    assert ('torques of the motion' in text) == bool(what)
    assert ('torques that hold the robot against gravity' in text) == (not what)


@pytest.mark.skipif(CHROMIUM is None,
                    reason='no Chromium on PATH: apt-get install chromium')
def test_an_exported_motion_plays_with_its_table_and_a_still_configuration_does_not(
        tmp_path):
    t = np.linspace(0.0, 1.0, 101)
    np.savetxt(tmp_path / 'motion.csv', np.stack([t, np.sin(3.0 * t), -t * t], axis=1),
               delimiter=',', header='t,q.joint1,q.joint2', comments='')
    robot = Robot(load_urdf(URDF))
    shown = tmp_path / 'page.html'
    player = "document.querySelector('[aria-valuemax^=\"1\"]')"
    cells = ("[...document.querySelectorAll('#joints tr:nth-child(2) span')].map(s => "
             's.innerText)')
    assert main(['view', str(URDF), '--export', str(shown)]) == 0
    with browser(shown.as_uri()) as page:
        page.wait("document.querySelector('canvas')")
        # It is loaded.
        page.wait("document.querySelector('[aria-label=\"Show scene tree\"]')")
        assert not page.evaluate(
            "[...document.querySelectorAll('[role=slider]')]"
            '.some(s => s.ariaValueMax > 0)')
        held = page.evaluate(cells)
        assert page.evaluate(cells) == held
        assert page.errors == []
    assert float(held[1]) == pytest.approx(robot.gravity_force(np.zeros(2))[0], rel=5e-3)
    assert main(['view', str(URDF), '--motion', str(tmp_path / 'motion.csv'),
                 '--export', str(shown)]) == 0
    with browser(shown.as_uri()) as page:
        page.wait(f"{player} && document.getElementById('time').innerText > 0.3")
        page.evaluate('document.dispatchEvent(new KeyboardEvent('
                      "'keydown', {code: 'Space', bubbles: true}))")  # pauses
        time.sleep(1.0)
        t = float(page.evaluate("document.getElementById('time').innerText"))
        assert t == pytest.approx(float(page.evaluate(f'{player}.ariaValueNow')),
                                  abs=0.05)
        position, torque, _ = page.evaluate(cells)
        assert page.errors == []
    trajectory = load_trajectory(str(tmp_path / 'motion.csv'), robot)
    row = int(np.abs(trajectory.t - t).argmin())
    assert float(position) == pytest.approx(trajectory.q[row, 0], abs=1e-3)
    assert float(torque) == pytest.approx(trajectory.tau[row, 0], rel=5e-3)
