"""
Draw demo.webp: the arm of `make demo` with and without feedforward, as MuJoCo shows it.

The arm, the motion and the servo are those of the demo. Node and topics are left out, so
the torques arrive at once. The transparent arm is the desired motion. The errors of the
ends are measured in the simulation. The variable MUJOCO_GL chooses MuJoCo's renderer:
`osmesa` needs no display.
"""

import argparse
import re

from kane_dynamics import Controller, load_urdf, Mode, Robot
from kane_dynamics.demo.demo_settings import DURATION, FR3, RATE
from kane_dynamics.demo.mujoco_plant import MujocoArm
import mujoco
import numpy as np
from PIL import Image, ImageDraw, ImageFont

WIDTH = 420
HEIGHT = 360
PICTURES = 12.5  # a second
TIP = 'fr3_hand_tcp'
KEEP_VISUALS = '<mujoco><compiler discardvisual="false" fusestatic="false"/></mujoco>'
DESIRED = np.array([0.0, 0.45, 0.85, 0.35])  # red, green, blue, opacity
INSIDE = 0.98  # where both arms coincide, the solid one hides the other


def torque_of_servo(q, u, desired):
    """Return the torque of the demo's soft servo, N m."""
    q_d, u_d, _ = desired
    return FR3.kp * (q_d - q) + FR3.kd * (u_d - u)


def positions_of_arm(motion, controller):
    """Simulate the demo's arm in MuJoCo; return its positions per tick, (N, 7), rad."""
    arm = MujocoArm(FR3)
    positions = []
    for tick in range(round(DURATION * RATE)):
        t = tick / RATE
        q, u = arm.state
        positions.append(q)
        tau = torque_of_servo(q, u, motion.sample(t))
        if controller is not None:
            tau = tau + controller.command(t, q, u, motion, t).tau
        arm.step(tau)
    return np.array(positions)


class Camera:
    """Pictures of the demo's arm beside the transparent arm of the desired motion."""

    def __init__(self):
        """Compile the URDF with its visual shapes."""
        text = FR3.urdf.read_text(encoding='utf-8')
        text = re.sub(r'<collision>.*?</collision>', '', text, flags=re.DOTALL)
        text = text.replace('</robot>', KEEP_VISUALS + '</robot>')
        spec = mujoco.MjSpec.from_string(text)
        spec.visual.global_.offwidth = WIDTH
        spec.visual.global_.offheight = HEIGHT
        spec.visual.headlight.ambient = [0.5, 0.5, 0.5]
        spec.visual.headlight.diffuse = [0.6, 0.6, 0.6]
        sky = spec.add_texture(name='sky', type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
                               builtin=mujoco.mjtBuiltin.mjBUILTIN_FLAT, width=8,
                               height=8)
        sky.rgb1 = sky.rgb2 = [0.87, 0.89, 0.92]
        self.model = spec.compile()
        self.places = [self.model.joint(name).qposadr[0] for name in FR3.joints]
        self.renderer = mujoco.Renderer(self.model, HEIGHT, WIDTH)
        self.view = mujoco.MjvCamera()
        self.view.lookat = [0.22, 0.0, 0.44]
        self.view.distance = 1.45
        self.view.azimuth = 140.0
        self.view.elevation = -14.0

    def posed(self, q):
        """Return MuJoCo's data at the positions q of the arm, rad."""
        data = mujoco.MjData(self.model)
        data.qpos[self.places] = q
        mujoco.mj_forward(self.model, data)
        return data

    def picture(self, measured, desired):
        """Return the picture of two configurations, (HEIGHT, WIDTH, 3)."""
        self.renderer.update_scene(self.posed(measured), self.view)
        scene = self.renderer.scene
        solid = scene.ngeom
        mujoco.mjv_addGeoms(self.model, self.posed(desired), mujoco.MjvOption(),
                            mujoco.MjvPerturb(), mujoco.mjtCatBit.mjCAT_DYNAMIC, scene)
        for geom in scene.geoms[solid:scene.ngeom]:
            geom.rgba = DESIRED
            geom.size = INSIDE * geom.size
        return self.renderer.render()


def main():
    """Draw the file."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('path')
    path = parser.parse_args().path
    motion = FR3.motion()
    robot = Robot(load_urdf(FR3.urdf, joints=FR3.joints))
    feedforward = Controller(robot, mode=Mode.INVERSE_DYNAMICS)
    runs = {'servo alone': positions_of_arm(motion, None),
            'servo + feedforward': positions_of_arm(motion, feedforward)}
    camera = Camera()
    font = ImageFont.load_default(15)
    pictures = []
    for tick in range(0, round(DURATION * RATE), round(RATE / PICTURES)):
        desired = motion.sample(tick / RATE)[0]
        target = robot.frame_pose(TIP, desired)[:3, 3]
        picture = Image.new('RGB', (2 * WIDTH, HEIGHT), 'white')
        draw = ImageDraw.Draw(picture)
        for column, (title, positions) in enumerate(runs.items()):
            measured = positions[tick]
            picture.paste(Image.fromarray(camera.picture(measured, desired)),
                          (column * WIDTH, 0))
            error = np.linalg.norm(robot.frame_pose(TIP, measured)[:3, 3] - target)
            draw.text((column * WIDTH + 14, 10), title, 'black', font)
            draw.text((column * WIDTH + 14, 32),
                      f'error of the tip {1e3 * error:.1f} mm', 'black', font)
        pictures.append(picture)
    pictures[0].save(path, save_all=True, append_images=pictures[1:], loop=0, quality=75,
                     duration=round(1000.0 / PICTURES), method=6)


if __name__ == '__main__':
    main()
