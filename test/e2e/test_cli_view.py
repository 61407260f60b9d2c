"""`kane-dynamics view` shows a moving robot to a browser, and to nobody else."""

from contextlib import ExitStack
from pathlib import Path
import subprocess
import sys
import time

from browser import browser, CHROMIUM
from kane_dynamics.cli import main
import numpy as np
import pytest

URDF = Path(__file__).resolve().parents[2] / 'urdf' / 'two_link.urdf'
SLIDER = "document.querySelector('[role=slider]')"
MOTION = """t,q.joint1,q.joint2
0,0,0
1,1.2,-0.8
"""


def settled(page, seconds=20.0):
    """Return a picture of the page once it no longer changes: shapes fade in."""
    end, before = time.monotonic() + seconds, page.picture()
    while time.monotonic() < end:
        time.sleep(0.3)
        after = page.picture()
        if np.abs(after - before).max() < 0.02:
            return after
        before = after
    raise AssertionError('the page never comes to rest')


def robot_part(picture):
    """Return the part of a picture that controls and notices do not cover."""
    height, width, _ = picture.shape
    return picture[height // 3:, :int(0.7 * width)]


@pytest.mark.skipif(CHROMIUM is None, reason='no Chromium on PATH: apt-get install chromium')
def test_a_browser_shows_the_robot_and_its_slider_moves_it(tmp_path):
    (tmp_path / 'motion.csv').write_text(MOTION)
    process = subprocess.Popen(
        [sys.executable, '-m', 'kane_dynamics.cli', 'view', str(URDF), '--no-open', '--port', '0',
         '--trajectory', str(tmp_path / 'motion.csv')], stdout=subprocess.PIPE, text=True)
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
    assert (first < 0.6).any(axis=-1).mean() > 0.005  # something stands on the light floor
    moved = (np.abs(last - first).max(axis=-1) > 0.1).mean()
    assert moved > 0.01
    assert (np.abs(again - first).max(axis=-1) > 0.1).mean() < 0.1 * moved


@pytest.mark.parametrize('what', [[], ['--trajectory', 'motion.csv']], ids=['still', 'moving'])
def test_an_exported_page_is_whole_without_a_server(tmp_path, what, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path('motion.csv').write_text(MOTION)
    assert main(['view', str(URDF), *what, '--export', 'page.html']) == 0
    assert capsys.readouterr().out == 'wrote page.html\n'
    page = Path('page.html').read_text()
    assert '__VISER_EMBED_DATA__="' in page
    assert 'src="http' not in page and 'href="http' not in page
