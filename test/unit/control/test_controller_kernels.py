"""The parts of a controller as kernels and in C are those of the library."""

import ctypes
import math
from pathlib import Path
import shutil
import subprocess

from kane_dynamics import (absolute_rates, CollisionDetector, Controller,
                           controller_kernels, InputError, load_urdf, Mode,
                           MomentumObserver, Motion, Robot, simulate)
from kane_dynamics._util.resources import resource_path
from kane_dynamics.control.torque_limiter import TorqueLimiter
from linkages import four_bar
import numpy as np
from palletizer import palletizer, positions
import pytest

EXAMPLE = Path(__file__).resolve().parents[3] / 'examples' / 'exported_controller'


DAHL = {'presliding_stiffness': 20.0}
LUGRE = {**DAHL, 'presliding_damping': 0.5, 'breakaway_friction': 1.5,
         'stribeck_speed': 0.1}


def arm(further=None, **options):
    """Return a two-link arm with friction, and further terms of its law."""
    path = resource_path('urdf', 'two_link.urdf')
    friction = {'friction': 1.0, 'friction_speed': 0.05, 'damping': 0.5,
                **(further or {})}
    joints = dict.fromkeys(load_urdf(path).joint_names, friction)
    return Robot(load_urdf(path, supplement={'joints': joints}), **options)


def test_the_limiter_is_that_of_the_library():
    robot = arm()
    _, limited, _, _ = controller_kernels(robot)
    limiter = TorqueLimiter(robot.joint_names)
    rng = np.random.default_rng(0)
    effort = np.array([5.0, 3.0])
    rate = np.array([400.0, np.inf])
    step = 0.004
    limiter.set_effort(effort)
    limiter.set_rate(rate)
    limiter.apply(0.0, np.zeros(2))
    last = np.zeros(2)
    for k in range(1, 50):
        tau = rng.uniform(-8.0, 8.0, 2)
        last = limited(tau, last, effort, np.minimum(rate * step, 1e300))
        command = limiter.apply(k * step, tau)
        np.testing.assert_allclose(last, command.tau, atol=1e-12)
    assert command.limited


@pytest.mark.parametrize('law', [None, DAHL, LUGRE])
@pytest.mark.parametrize('speeds', [None, absolute_rates])
@pytest.mark.parametrize('held', [True, False])
def test_the_observer_is_that_of_the_library(held, speeds, law):
    robot = arm(law, speeds=speeds)
    gain = np.array([30.0, 60.0])
    _, _, step, _ = controller_kernels(robot)
    observer = MomentumObserver(robot, gain=gain, held=held)
    rng = np.random.default_rng(0)
    memory = np.zeros(step.traced().shape)
    assert memory.shape == ((12,) if law else (3, 2))
    last_tau = np.zeros(2)
    last_t = 0.0
    q, u = rng.uniform(-1.0, 1.0, (2, 2))
    for t in np.cumsum(rng.uniform(0.001, 0.01, 30)):
        q = q + 0.01 * u
        u = u + rng.normal(0.0, 0.1, 2)
        tau = rng.uniform(-5.0, 5.0, 2)
        mean = last_tau if held else 0.5 * (last_tau + tau)
        elapsed = t - last_t if last_t else 0.0
        memory = step(q, u, mean, memory, elapsed, np.exp(-gain * elapsed))
        expected = observer.update(t, q, u, robot.generalized_force(tau, q))
        np.testing.assert_allclose(memory.ravel()[:2], expected, rtol=1e-9, atol=1e-9)
        last_tau = tau
        last_t = t
    assert np.abs(expected).max() > 1.0


def test_the_detector_is_that_of_the_library():
    robot = arm()
    rng = np.random.default_rng(0)
    *_, step = controller_kernels(robot)
    threshold = np.array([1.0, 1.0])
    settings = np.array([0.0045, 0.7, 0.0295])
    detector = CollisionDetector(robot.joint_names, threshold, confirm=settings[0],
                                 release=settings[1], clear=settings[2])
    memory = np.zeros(5)
    torque = np.zeros(2)
    changes = []
    for k in range(3000):
        torque = 0.9 * torque + rng.normal(0.0, 0.2, 2)
        if 50 <= k % 500 < 60:  # both with one ratio
            torque[:] = 2.5
        memory = step(torque, threshold, settings, memory, 0.001 if k else 0.0)
        if detector.update(0.001 * k, torque):
            changes.append(detector.joint)
        flag, joint = memory[:2]
        assert flag == detector.collision, k
        assert (robot.joint_names[int(joint) - 1] if joint
                else None) == detector.joint, k
        beyond = memory[3:] >= 0.0
        assert tuple(np.array(robot.joint_names)[beyond]) == detector.beyond
    assert {*robot.joint_names, None} == set(changes)
    memory = step(np.full(2, 9.0), threshold, settings, memory, 0.0)
    assert memory.tolist() == [0.0, 0.0, -1.0, 0.0,
                               0.0], 'an elapsed time of 0 begins again'


def test_motions_that_no_controller_follows_are_refused():
    with pytest.raises(InputError,
                       match=r'followed: .*expected None, because all joints'):
        controller_kernels(arm(), followed=arm().joint_names)
    with pytest.raises(InputError, match=r'followed: .*expected 1 of the joints'):
        controller_kernels(four_bar('crank'), followed=('crank', 'coupler'))
    with pytest.raises(InputError, match='robot: a Model; expected a Robot'):
        controller_kernels(arm().model)


def in_c(robot, kernels, folder):
    """Return functions of exported C that return arrays, by name."""
    source, _ = robot.export_c(folder / 'arm.c', kernels)
    library = folder / 'arm.so'
    subprocess.run(['gcc', '-O1', '-Wall', '-Wextra', '-Werror', '-shared', '-fPIC',
                    '-o', library, source, '-lm'], check=True)
    code = ctypes.CDLL(str(library))
    assert code.arm_self_test() == 0

    def function(kernel):
        shape = kernel.traced().shape

        def call(*arguments):
            result = np.zeros(shape)
            arrays = [np.asarray(x, dtype=np.float64) for x in arguments]
            address = [array.ctypes.data_as(ctypes.c_void_p) for array in arrays]
            getattr(code, f'arm_{kernel.name}')(*address, None,
                                                result.ctypes.data_as(ctypes.c_void_p))
            return result
        return call
    return [function(kernel) for kernel in kernels]


def test_a_controller_in_c_of_the_palletizer_is_that_of_the_library(tmp_path):
    robot = palletizer()
    step = 0.002
    kernels = controller_kernels(robot)
    law, limited, observe, detect = in_c(robot, kernels, tmp_path)
    gains = np.repeat([100.0, 20.0], robot.n)
    controller = Controller(robot, mode=Mode.COMPUTED_TORQUE, kp=100.0, kd=20.0,
                            rate_limit=2e4)
    observer = MomentumObserver(robot, gain=50.0, held=True)
    detector = CollisionDetector(robot.speed_names, 50.0)
    motion = Motion.from_points([0.0, 1.0],
                                [[0.0, 0.1, -0.2, 0.0], [0.5, 0.4, 0.1, -0.3]],
                                joint_names=robot.speed_names)

    driven = np.array([0.05, 0.12, -0.2, 0.1])
    u = np.array([0.3, -0.2, 0.4, 0.1])
    memory = np.zeros((3, robot.n))
    flags = np.zeros(robot.n + 3)
    last = np.zeros(robot.n_q)
    pushed = []
    for k in range(200):
        t = step * k
        q = positions(robot, *driven)
        elapsed = step if k else 0.0
        force = robot.generalized_force(last, q)
        memory = observe(q, u, last, memory, elapsed,
                         np.exp(-50.0 * elapsed * np.ones(robot.n)))
        flags = detect(memory[0], np.full(robot.n, 50.0), [0.005, 0.8, 0.2], flags,
                       elapsed)
        observer.hold(force)
        detector.update(t, observer.update(t, q, u, force))
        desired = [row[0] for row in motion.sample(np.array([t]))]
        expected = law(q, u, *desired, gains)
        change = np.full(robot.n_q, 2e4 * elapsed)
        last = limited(expected, last, robot.limits.effort, change)
        command = controller.command(t, q, u, motion)

        # The command, the estimate of the external torques and the flag are the same.
        np.testing.assert_allclose(last, command.tau, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(memory[0], observer.torque, rtol=1e-7, atol=1e-6)
        assert flags[0] == detector.collision
        pushed.append(detector.joint)

        # The arm moves, pushed at its shoulder for a while.
        push = np.array([0.0, 200.0 if 80 < k < 120 else 0.0, 0.0, 0.0])
        udot = robot.forward_dynamics(q, u,
                                      robot.generalized_force(command.tau, q) + push)
        u = u + step * udot
        driven = driven + step * u
    assert 'shoulder' in pushed
    assert pushed[60] is None

    # Open loops and false numbers end in NaN, which a controller refuses.
    opened = q + 0.1 * np.eye(robot.n_q)[robot.joint_names.index('elbow')]
    assert np.isnan(law(opened, u, *desired, gains)[0])
    assert np.isnan(observe(opened, u, last, memory, step, np.ones(robot.n))[0, 0])
    assert np.isfinite(observe(q, u, last, memory * np.nan, 0.0, np.ones(robot.n))).all()


@pytest.mark.parametrize('law', [DAHL, LUGRE, {**DAHL, 'load_friction': 0.1}])
def test_presliding_friction_is_no_external_torque_in_c(law, tmp_path):
    robot = arm(law)
    gain = np.full(2, 50.0)
    observe = in_c(robot, controller_kernels(robot), tmp_path)[2]

    def torque(t, q, u):
        return robot.gravity_force(q) + 3.0 * np.array(
            [math.sin(3.0 * t), math.sin(5.0 * t)])
    run = simulate(robot, np.array([0.3, -0.5]), np.zeros(2), 3.0,
                   torque=torque, step=1e-3)

    def largest(observe, memory):
        estimates = []
        for k in range(len(run.t)):
            elapsed = run.t[k] - run.t[k - 1] if k else 0.0
            mean = 0.5 * (run.tau[k] + run.tau[k - 1]) if k else run.tau[k]
            memory = observe(run.q[k], run.u[k], mean, memory, elapsed,
                             np.exp(-gain * elapsed))
            estimates.append(memory.ravel()[:2])
        return np.abs(estimates).max()
    # Without deflections, friction is wrong by up to twice its size after a reversal.
    stiff = arm({**law, 'presliding_stiffness': 0.0, 'presliding_damping': 0.0})
    wrong = largest(controller_kernels(stiff)[2], np.zeros((3, 2)))
    assert wrong > 0.5
    assert largest(observe, np.full(12, np.nan)) < 0.05 * wrong


def test_controllers_of_another_robot_are_not_exported(tmp_path):
    robot = arm()
    with pytest.raises(InputError, match="'computed_torque' of another robot"):
        robot.export_c(tmp_path / 'arm.c', controller_kernels(robot.copy()))
    with pytest.raises(InputError, match='kernels: a Kernel; expected a sequence'):
        robot.export_c(tmp_path / 'arm.c', controller_kernels(robot)[0])
    source, _ = robot.export_c(tmp_path / 'arm.c', [controller_kernels(robot)[1]] * 2)
    assert source.read_text().count('\nvoid arm_limited_torque(') == 1


@pytest.mark.skipif(shutil.which('cmake') is None, reason='no CMake')
def test_the_example_controller_is_built_moves_the_arm_and_refuses_bad_states(tmp_path):
    # It would slow the way to the steady state.
    robot = Robot(arm().model, friction=False)
    robot.export_c(tmp_path / 'arm.c', ['forward_dynamics', *controller_kernels(robot)])
    build = tmp_path / 'build'
    strict = '-Wall -Wextra -Wpedantic -Wdouble-promotion -Werror'
    for command in (['cmake', '-S', str(EXAMPLE), '-B', str(build),
                     f'-DARM_DIR={tmp_path}',
                     f'-DCMAKE_C_FLAGS={strict}'], ['cmake', '--build', str(build)]):
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout + done.stderr
    shown = subprocess.run([str(build / 'controller')], capture_output=True, text=True,
                           check=True).stdout.splitlines()
    rows = [line.split() for line in shown[:2]]
    assert tuple(row[0] for row in rows) == robot.joint_names
    q, external, effort = np.array([row[1:] for row in rows], dtype=float).T
    assert (effort == robot.limits.effort).all()
    # Computed torque yields to an external torque by the acceleration over kp.
    torque = np.array([2.0, 0.0])
    yielded = robot.inverse_mass_matrix(q) @ torque / 400.0
    np.testing.assert_allclose(q, 0.8 + yielded, atol=1e-6)
    np.testing.assert_allclose(external, torque, atol=1e-5)
    # At half of the external torque, after ln 2 / 50 s, and 5 ms to confirm.
    assert shown[2] == 'collision at 2.019 s'
    assert shown[3] == 'refused 1 4', 'the first position, and the second speed'
