"""The parts of a controller as kernels and in C are those of the library."""

from pathlib import Path
import shutil
import subprocess

from kane_dynamics import controller_kernels, InputError, load_urdf, MomentumObserver, Robot
from kane_dynamics._util.resources import resource_path
from kane_dynamics.control.torque_limiter import TorqueLimiter
from linkages import four_bar
import numpy as np
import pytest

EXAMPLE = Path(__file__).resolve().parents[3] / 'examples' / 'exported_controller'


def arm():
    """Return a two-link arm with friction."""
    path = resource_path('urdf', 'two_link.urdf')
    friction = {'friction': 1.0, 'friction_speed': 0.05, 'damping': 0.5}
    joints = dict.fromkeys(load_urdf(path).joint_names, friction)
    return Robot(load_urdf(path, supplement={'joints': joints}))


def test_the_limiter_is_that_of_the_library():
    robot = arm()
    _, limited, _ = controller_kernels(robot)
    limiter, rng = TorqueLimiter(robot.joint_names), np.random.default_rng(0)
    effort, rate, step = np.array([5.0, 3.0]), np.array([400.0, np.inf]), 0.004
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


@pytest.mark.parametrize('held', [True, False])
def test_the_observer_is_that_of_the_library(held):
    robot, gain = arm(), np.array([30.0, 60.0])
    _, _, step = controller_kernels(robot)
    observer, rng = MomentumObserver(robot, gain=gain, held=held), np.random.default_rng(0)
    memory, last_tau, last_t = np.zeros((3, 2)), np.zeros(2), 0.0
    q, u = rng.uniform(-1.0, 1.0, (2, 2))
    for t in np.cumsum(rng.uniform(0.001, 0.01, 30)):
        q, u, tau = q + 0.01 * u, u + rng.normal(0.0, 0.1, 2), rng.uniform(-5.0, 5.0, 2)
        mean = last_tau if held else 0.5 * (last_tau + tau)
        elapsed = t - last_t if last_t else 0.0
        memory = step(q, u, mean, memory, elapsed, np.exp(-gain * elapsed))
        expected = observer.update(t, q, u, tau)
        np.testing.assert_allclose(memory[0], expected, rtol=1e-9, atol=1e-9)
        last_tau, last_t = tau, t
    assert np.abs(expected).max() > 1.0


def test_a_robot_with_constraints_is_refused():
    with pytest.raises(InputError, match='chosen speeds or constraints'):
        controller_kernels(four_bar('crank'))
    with pytest.raises(InputError, match='robot: a Model; expected a Robot'):
        controller_kernels(arm().model)


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
    robot = Robot(arm().model, friction=False)  # which would slow the way to the steady state
    robot.export_c(tmp_path / 'arm.c', ['forward_dynamics', *controller_kernels(robot)])
    build = tmp_path / 'build'
    strict = '-Wall -Wextra -Wpedantic -Wdouble-promotion -Werror'
    for command in (['cmake', '-S', str(EXAMPLE), '-B', str(build), f'-DARM_DIR={tmp_path}',
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
    assert shown[2] == 'refused 1 4', 'the first position, and the second speed'
