"""The spin-up of a cantilever, against a chain of rigid segments in MuJoCo."""

from kane_dynamics import (FlexibleLink, ModelBuilder, ModelWarning, Prescribed, Robot,
                           simulate)
import mujoco
import numpy as np
import pytest

# Kane, Ryan & Banerjee, JGCD 10 (1987): 10 m of beam brought to 6 rad/s within 15 s.
LENGTH = 10.0
DENSITY = 1.2
STIFFNESS = 14000.0
FINAL = 6.0
DURATION = 15.0
SEGMENTS = 24


def turn(t):
    """Return the hub's angle, rad: the law of the paper, over any scalar."""
    w = 2.0 * np.pi / DURATION
    return FINAL / DURATION * (0.5 * t * t + (np.cos(w * t) - 1.0) / w**2)


def spun(foreshortening, duration=DURATION):
    """Return the simulation and the tip's deflection, m."""
    b = ModelBuilder('spin-up', gravity=(0, 0, 0))
    b.beam('beam', 'world', FlexibleLink(LENGTH, DENSITY, STIFFNESS, (3, 0),
                                         foreshortening=foreshortening))
    robot = Robot(b.model(), constraints=[Prescribed('beam', turn)])
    run = simulate(robot, np.zeros(4), np.zeros(3), duration, step=1e-3, sample=0.05)
    tip = np.array([(np.linalg.inv(robot.frame_pose('beam', q))
                     @ robot.frame_pose('beam/tip', q))[1, 3] for q in run.q])
    return run, tip


def chain_of_segments(times):
    """Return the tip's deflection of sprung rigid segments in MuJoCo, m."""
    h = LENGTH / SEGMENTS
    heavy = 1e9
    mass = DENSITY * h
    inertia = DENSITY * h**3 / 12.0
    start = ''
    end = ''
    for k in range(SEGMENTS):
        # Clamped at the first one's root.
        spring = STIFFNESS / h * (2.0 if k == 0 else 1.0)
        start += (f'<body pos="{h if k else 0} 0 0"><joint axis="0 0 1" '
                  f'stiffness="{spring}"/>'
                  f'<inertial pos="{h / 2} 0 0" mass="{mass}" '
                  f'diaginertia="{inertia} {inertia} {inertia}"/>')
        end += '</body>'
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><option gravity="0 0 0" timestep="5e-4" '
        'integrator="RK4"/><worldbody><body>'
        f'<joint axis="0 0 1" armature="{heavy}"/><inertial pos="0 0 0" mass="1" '
        f'diaginertia="1 1 1"/>{start}{end}</body></worldbody></mujoco>')
    data = mujoco.MjData(model)
    tips = []
    step = model.opt.timestep
    for t in times:
        while data.time < t - 0.5 * step:
            middle = data.time + 0.5 * step
            data.qfrc_applied[0] = heavy * FINAL / DURATION * (
                1.0 - np.cos(2.0 * np.pi * middle / DURATION))
            mujoco.mj_step(model, data)
        angles = np.cumsum(data.qpos[1:])
        tips.append(h * np.sin(angles).sum())
    return np.array(tips)


def test_the_beam_lags_and_returns_as_a_chain_of_segments_does():
    run, tip = spun(foreshortening=True)
    expected = chain_of_segments(run.t)
    assert -0.6 < tip.min() < -0.5  # it lags by half a metre
    assert 5.0 < run.t[tip.argmin()] < 9.0
    assert abs(tip[-1]) < 0.01 < np.abs(tip).max()  # and comes back
    np.testing.assert_allclose(tip, expected,
                               rtol=0.0, atol=0.01 * np.abs(expected).max())


def test_without_foreshortening_it_diverges():
    with pytest.warns(ModelWarning, match="beam 'beam': a deflection of 1.* m at .* s"):
        assert np.abs(spun(foreshortening=False, duration=12.0)[1]).max() > 5.0
