"""Draw view.png, the page of `kane-dynamics view` as a headless Chromium shows it."""

from pathlib import Path
import sys
import time

from browser import browser  # of test/helpers
from kane_dynamics import load_urdf, Robot
from kane_dynamics.motion.motion import Motion
from kane_dynamics.simulation.trajectory import Trajectory
from kane_dynamics.urdf.link_shapes import load_visuals
from kane_dynamics.view import Window
import numpy as np

URDF = Path(__file__).resolve().parents[1] / 'urdf' / 'fr3.urdf'
JOINTS = [f'fr3_joint{k}' for k in range(1, 8)]


def main(path: str) -> None:
    """Show a fast motion's half-way point."""
    robot = Robot(load_urdf(URDF, joints=JOINTS))
    motion = Motion.from_points([0.0, 0.6], [[-0.6, -0.6, 0.0, -2.2, 0.0, 1.8, 0.8],
                                             [0.6, 0.9, 0.3, -1.1, 0.5, 2.4, 0.8]],
                                joint_names=JOINTS)
    t = np.linspace(0.0, 0.4, 101)
    window = Window(robot, Trajectory.along(robot, t, *motion.sample(t)),
                    visuals=load_visuals(URDF), port=0)
    with browser(window.url) as page:
        page.wait("document.querySelector('[role=slider]')")
        time.sleep(8.0)  # shapes fade in
        page.evaluate("document.querySelector('[role=slider]').focus()")
        page.press('End')
        # The time of software GL.
        page.evaluate("document.querySelector('[role=alert] button').click()")
        page.evaluate('document.activeElement.blur()')
        time.sleep(4.0)
        page.picture(path)
    window.close()


if __name__ == '__main__':
    main(sys.argv[1])
