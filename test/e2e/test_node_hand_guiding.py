"""The FR3 in MuJoCo, with friction, is led by hand over DDS, with and without mode."""

from pathlib import Path
import sys

from kane_dynamics.identification import calibrate_collision
from node_process import Process
import numpy as np
import pytest
import yaml

pytest.importorskip('mujoco')
sys.path.append(str(Path(__file__).resolve().parents[2] / 'benchmarks'))

import task_space_laws as experiments  # noqa: E402, I100

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]
LED = 2.5  # s
ACCELERATED = 1.0  # s at the beginning that do not count


class LedPlant(experiments.Plant):
    """The arm with its friction, whose flange a hand leads along a line."""

    def __init__(self, robot, arm):
        super().__init__(robot, arm.urdf)
        self.rub(robot)
        self.frame = arm.frame
        self.reset(arm.home)
        self.start = robot.frame_pose(arm.frame, arm.home)[:3, 3]
        self.led_since = None  # s of the simulation
        self.forces = []

    def load(self):
        """Add the force of the hand, which holds on to a point that moves."""
        if self.led_since is None:
            return
        q, u = self.state
        stiffness, damping = experiments.HAND
        velocity = np.array([0.0, experiments.LED, 0.0])
        hand = self.start + (self.data.time - self.led_since) * velocity
        place = self.robot.frame_pose(self.frame, q)[:3, 3]
        speed = self.robot.frame_velocity(self.frame, q, u)[:3]
        force = stiffness * (hand - place) + damping * (velocity - speed)
        self.data.qfrc_applied[self.u_places] += (
            self.robot.jacobian(self.frame, q)[:3].T @ force)
        if self.data.time - self.led_since > ACCELERATED:
            self.forces.append(np.linalg.norm(force))


def scaled_friction(path, factor):
    """Write the friction of the examples times a factor; return the path."""
    supplement = yaml.safe_load(experiments.FRICTION.read_text())
    for numbers in supplement['joints'].values():
        for name in ('damping', 'friction'):
            numbers[name] *= factor
    path.write_text(yaml.safe_dump(supplement))
    return path


def mean_force(mode, supplement, **parameters):
    """Return the mean force, N, of the hand on an arm whose node is in a mode."""
    from lockstep_arm import LockstepArm
    arm = experiments.arms()['FR3']
    plant = LedPlant(experiments.with_friction(arm, 1.0), arm)
    lockstep = LockstepArm(plant)
    node = Process(urdf=arm.urdf, tip=arm.frame, supplement=supplement, mode=mode,
                   arm_compensates='none', use_sim_time='true', state_timeout=1.0,
                   real_states=True, **parameters)
    try:
        node.wait_for('active, mode')
        lockstep.connect(targets=False)
        plant.led_since = plant.data.time
        for _ in range(round(LED * experiments.RATE)):
            lockstep.cycle()
    finally:
        lockstep.close()
        code = node.end()[0]
    assert code == 0 and 'Traceback' not in node.log, node.log
    assert lockstep.unanswered == 0
    return np.mean(plant.forces)


def parameters_of_a_recording(factor):
    """Return the parameters by which a recording without contact corrects a model."""
    arm = experiments.arms()['FR3']
    model = experiments.with_friction(arm, factor)
    calibrated = calibrate_collision(model, experiments.free_motion(arm, model),
                                     held=True)
    numbers = {'coulomb': calibrated.coulomb, 'damping': calibrated.damping,
               'offset': calibrated.offset, 'speed': calibrated.friction_speed}
    return {f'observer__friction__{name}': row.tolist() for name, row in numbers.items()}


def test_a_hand_needs_a_fifth_of_the_force(participant, tmp_path):
    """With a model of 20 % more friction, and corrected ones of 20 % more and less."""
    more_friction = scaled_friction(tmp_path / 'more.yaml', 1.0 + experiments.ERROR)
    less = scaled_friction(tmp_path / 'less.yaml', 1.0 - experiments.ERROR)
    without = mean_force('gravity_compensation', more_friction)
    guided = {'more': mean_force('hand_guiding', more_friction)}
    for what, supplement, factor in (('corrected, more', more_friction,
                                      1.0 + experiments.ERROR),
                                     ('corrected, less', less, 1.0 - experiments.ERROR)):
        guided[what] = mean_force('hand_guiding', supplement,
                                  hand_guiding__friction=experiments.RECORDED,
                                  **parameters_of_a_recording(factor))
    print(f'\n{without:.1f} N with gravity compensation; with hand guiding, N: {guided}')
    assert without > experiments.LIGHTER * max(guided.values())
