"""`calibrate --live` leads a simulated arm with position servos through poses."""

import json
import re
import sys
import time

from held_arms import held_arm
from kane_dynamics import load_urdf, Robot
from kane_dynamics.cli.parser import main
import numpy as np
import pytest
from std_msgs.msg import Float64MultiArray
import yaml

PLANT = 'kane_dynamics.ros.plant.main'
NAMES = ['j1', 'j2', 'j3']
SCALE = [0.8, -1.3, 1.1]
SIZES = np.array([0.25, 0.12, 0.05])  # N m, of stick-slip
LOAD = 0.5  # kg
COM = [0.0, 0.0, 0.1]  # m, in the last link's frame
PAST = 0.15  # rad


class Hand:
    """A person who moves the servos as the command says, and presses Enter."""

    def __init__(self, client, capsys):
        self.publisher = client.create_publisher(Float64MultiArray, 'commands', 1)
        self.capsys = capsys
        self.at = np.zeros(3)
        self.prompts = []

    def move(self, q, steps=100):
        """Move the servos in a straight line."""
        for share in np.linspace(0.0, 1.0, steps):
            numbers = self.at + share * (q - self.at)
            self.publisher.publish(Float64MultiArray(data=numbers.tolist()))
            time.sleep(0.01)
        self.at = q

    def readline(self):
        """Do what the last line says."""
        prompt = self.capsys.readouterr().err.splitlines()[-1]
        assert prompt.endswith('then press Enter')
        self.prompts.append(prompt)
        q = np.array([float(re.search(rf'{name} (\S+?)[,;]', prompt)[1])
                      for name in NAMES])
        past = 'from the other side' in prompt
        self.move(q + PAST if past else q - PAST)
        self.move(q)
        return '\n'


@pytest.mark.timeout(400)
def test_an_arm_led_by_hand_gives_its_scales_and_its_gravity(
        start, client, tmp_path, monkeypatch, capsys):
    rng = np.random.default_rng(2)
    true = held_arm(3, rng)
    (tmp_path / 'true.urdf').write_text(true.urdf())
    urdf = tmp_path / 'arm.urdf'  # with wrong masses
    urdf.write_text(true.urdf(true.masses * [2.0, 0.5, 0.7]))
    joints = {name: {'armature': 0.05, 'friction': float(size)}
              for name, size in zip(NAMES, SIZES, strict=True)}
    (tmp_path / 'motors.yaml').write_text(yaml.safe_dump({'joints': joints}))
    plant = start(
        module=PLANT, urdf=tmp_path / 'true.urdf', supplement=tmp_path / 'motors.yaml',
        rate=200.0, sticking='true', commands__form='position_offset',
        commands__stiffness=60.0, commands__damping=4.0, efforts__scale=SCALE,
        payload__frame='l3', payload__mass=LOAD, payload__com=COM, after_timeout='hold')
    plant.wait_for('joint states/s')
    hand = Hand(client, capsys)
    monkeypatch.setattr(sys, 'stdin', hand)
    live = ['calibrate', str(urdf), '--live', '5', '--floor', 'none']
    loaded = str(tmp_path / 'loaded.csv')
    assert main([*live, '--save', loaded]) == 0
    assert client.adjust('/plant_node', payload__mass=0.0).successful
    assert main([*live, '--json', '--loaded', loaded, '--load', 'l3', '--load-mass',
                 str(LOAD), '--load-com', *map(str, COM), '--out',
                 str(tmp_path / 'arm.yaml')]) == 0
    result = json.loads(capsys.readouterr().out)

    # Friction matters: each pose is held from both sides.
    assert result['poses'] == len(hand.prompts) == 20
    assert len(np.loadtxt(loaded, delimiter=',', skiprows=1)) == 10
    np.testing.assert_allclose(result['scale'], SCALE, rtol=0.03)
    assert result['not_told_apart'] == []
    # Stick-slip leaves some of the friction, which the approaches show.
    least, largest = np.transpose(result['friction'])
    assert (least > 0.3 * SIZES).all() and (largest < 1.3 * SIZES).all()
    robot = Robot(load_urdf(urdf, supplement=tmp_path / 'arm.yaml'), friction=False)
    given = Robot(load_urdf(urdf), friction=False)
    q = rng.uniform(-1.5, 1.5, (50, 3))
    truth = np.array([true.holding_torque(row) for row in q])
    error = np.sqrt(np.mean((robot.gravity_force(q) - truth)**2))
    assert error < 0.1 * np.sqrt(np.mean((given.gravity_force(q) - truth)**2))


def test_an_arm_without_joint_states_is_refused(tmp_path, monkeypatch, capsys):
    from kane_dynamics.ros.common import pose_leader
    monkeypatch.setattr(pose_leader, 'WAIT', 1.0)
    urdf = tmp_path / 'arm.urdf'
    urdf.write_text(held_arm(2, np.random.default_rng(1)).urdf())
    assert main(['calibrate', str(urdf), '--live', '5']) == 2
    assert "joint states: none on 'joint_states' within 1 s" in capsys.readouterr().err
    assert main(['calibrate', str(urdf), '--live', '5', '--floor', '9']) == 2
    assert 'poses: 0 of 300 proposed ones without contact' in capsys.readouterr().err
    assert main(['calibrate', str(urdf), '--live', '3']) == 2
    assert '--live: 3 poses; expected at least 4' in capsys.readouterr().err
