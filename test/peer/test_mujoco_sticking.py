"""Exact friction is the limit of MuJoCo's noslip solver, as far as that converges."""

from kane_dynamics import ModelBuilder, Robot, rod, simulate
import mujoco
import numpy as np

FRICTION = (2.0, 1.0)
DURATION = 1.0
AMPLITUDES = np.array([4.0, 2.0])
FREQUENCIES = np.array([6.0, 9.0])
SCENE = """
<mujoco><compiler angle="radian" inertiafromgeom="false"/>
<option timestep="{step}" integrator="Euler" noslip_iterations="50" gravity="0 0 -9.81"/>
<worldbody><body name="one">
  <joint axis="0 0 1" frictionloss="2" armature="0.2" solreffriction="{time} 1"/>
  <inertial pos="0.3 0 0" mass="2" diaginertia="1e-9 0.06 0.06"/>
  <body name="two" pos="0.6 0 0">
    <joint axis="0 -1 0" frictionloss="1" armature="0.2" solreffriction="{time} 1"/>
    <inertial pos="0.25 0 0" mass="0.4" diaginertia="1e-9 0.0083333333333 0.0083333333333"/>
  </body></body></worldbody></mujoco>
"""  # noqa: E501


def torque(t):
    return AMPLITUDES * np.sin(FREQUENCIES * t)


def moved_by_mujoco(step):
    # The rate of a joint that stops decays with this time constant, two steps at least.
    model = mujoco.MjModel.from_xml_string(SCENE.format(step=step, time=2.0 * step))
    data = mujoco.MjData(model)
    for k in range(round(DURATION / step)):
        data.qfrc_applied[:] = torque(k * step)
        mujoco.mj_step(model, data)
    return data.qpos.copy()


def moved(step):
    builder = ModelBuilder('arm')
    builder.body('one', axis=(0, 0, 1), inertial=rod(2.0, (0, 0, 0), (0.6, 0, 0)),
                 friction=FRICTION[0], armature=0.2)
    builder.body('two', 'one', axis=(0, -1, 0), at=(0.6, 0, 0), friction=FRICTION[1],
                 inertial=rod(0.4, (0, 0, 0), (0.5, 0, 0)), armature=0.2)
    middles = (np.arange(round(DURATION / step)) + 0.5) * step
    run = simulate(Robot(builder.model()), [0.0, 0.0], [0.0, 0.0], DURATION, step=step,
                   sticking=True, torque=np.array([torque(t) for t in middles]))
    assert run.sticking.any(axis=0).all() and not run.sticking.all(axis=0).any()
    return run.q[-1]


def test_motion_with_transitions_is_the_limit_of_noslip():
    ours = moved(5e-4)
    assert np.abs(moved(1e-3) - ours).max() < 2e-6
    for step, its_error in ((2e-3, 2e-4), (5e-4, 5e-5), (1.25e-4, 1.25e-5)):
        assert np.abs(moved_by_mujoco(step) - ours).max() < its_error
