"""A model that is written as MJCF is the same mechanism in MuJoCo."""

from pathlib import Path

from kane_dynamics import load_mjcf, load_urdf, ModelWarning, Robot
from kane_dynamics.urdf.mjcf_text import mjcf_text
import mujoco
import numpy as np
import pytest

FOLDER = Path(__file__).resolve().parents[2] / 'urdf'


def arm(name, **losses):
    """Return an arm with losses in all joints, and states of it."""
    path = FOLDER / f'{name}.urdf'
    joints = load_urdf(path).joint_names
    model = load_urdf(path, supplement={'joints': dict.fromkeys(joints, losses)})
    return model, np.random.default_rng(0).normal(size=(3, 20, model.n))


def torques(text, q, u, udot):
    """Return the torques of states by MuJoCo, N m or N."""
    peer = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(peer)
    result = []
    for data.qpos[:], data.qvel[:], data.qacc[:] in zip(q, u, udot):
        mujoco.mj_inverse(peer, data)
        result.append(data.qfrc_inverse.copy())
    return np.array(result)


def test_written_mjcf_has_the_torques_of_the_model_in_mujoco_and_when_it_is_loaded():
    model, state = arm('ur10e', damping=2.0, armature=0.1)
    expected = Robot(model).inverse_dynamics(*state)
    text = mjcf_text(model)
    loaded = load_mjcf(text).model
    assert loaded.joint_names == model.joint_names
    np.testing.assert_allclose(torques(text, *state), expected, atol=1e-11)
    again = Robot(loaded).inverse_dynamics(*state)
    np.testing.assert_allclose(again, expected, atol=1e-11)
    limits, of_loaded = Robot(model).limits, Robot(loaded).limits
    np.testing.assert_allclose(of_loaded.lower, limits.lower)
    np.testing.assert_allclose(of_loaded.effort, limits.effort)


def test_a_motor_that_turns_with_two_joints_is_a_tendon():
    model, (q, u, udot) = arm('ur10e')
    coefficients = {'wrist_2_joint': 1.0, 'wrist_3_joint': -1.0}
    losses = {'damping': 0.3, 'armature': 0.05}
    text = mjcf_text(model, [('motor', coefficients, losses)])
    motor = 0.3 * (u[:, 4] - u[:, 5]) + 0.05 * (udot[:, 4] - udot[:, 5])
    expected = Robot(model).inverse_dynamics(q, u, udot)
    expected[:, 4] += motor
    expected[:, 5] -= motor
    np.testing.assert_allclose(torques(text, q, u, udot), expected, atol=1e-11)


def test_mimic_joints_are_equality_constraints():
    model, (q, u, udot) = arm('fr3')
    mechanism = load_mjcf(mjcf_text(model))
    robot = Robot(mechanism.model, **{**mechanism.options,
                                      'independent': model.joint_names})
    mimic, = set(mechanism.model.joint_names) - set(model.joint_names)
    order = [*model.joint_names, mimic]
    places = list(map(order.index, robot.coordinate_names))
    of_all = np.column_stack([q, q[:, -1]])[:, places]
    np.testing.assert_allclose(robot.inverse_dynamics(of_all, u, udot),
                               Robot(model).inverse_dynamics(q, u, udot), atol=1e-10)


def test_friction_that_mujoco_lacks_is_named():
    model, _ = arm('two_link', damping=1.0, load_friction=0.1)
    with pytest.warns(ModelWarning, match='MJCF: friction of joint1, joint2'):
        mjcf_text(model)
