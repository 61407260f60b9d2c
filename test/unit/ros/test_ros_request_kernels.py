"""Kernels of requests: what is ready compiles nothing later, others are awaited."""

from dataclasses import replace
import threading

from kane_dynamics import CompileError, InputError, Motion, Robot
from kane_dynamics.native.machine_code import llvm
from kane_dynamics.native.runtime.threads import run_concurrently
from linkages import at_angle, four_bar_model, PIN
from mechanisms import random_model, random_state
import numpy as np
import pytest

pytest.importorskip('rclpy')

from kane_dynamics.ros.services.motion_check import motion_efforts  # noqa: E402, I100
from kane_dynamics.ros.services.request_kernels import (  # noqa: E402
    compile_answers, compile_simulations, LaterKernels, SIMULATIONS)
from kane_dynamics.ros.services.service_calls import (  # noqa: E402
    explain, forward_dynamics, get_dynamics, inverse_dynamics)
from kane_dynamics.ros.services.simulation_request import SimulationRequest  # noqa: E402
from kane_dynamics.ros.services.trajectory_filling import filled_message  # noqa: E402
from kane_dynamics_interfaces.srv import (  # noqa: E402
    Explain, ForwardDynamics, GetDynamics, InverseDynamics, Simulate)
from node_values import served_robot  # noqa: E402
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint  # noqa: E402

PATIENCE = 30.0  # s


def limited(robot):
    robot.limits = replace(robot.limits, effort=np.full(robot.n_q, 300.0),
                           velocity=np.full(robot.n_q, 2.0))
    return robot


def tree():
    model = random_model(3, 5)
    q, u, _ = random_state(model, 0)
    return limited(Robot(model)), 0.1 * q, u


def loop():
    q = at_angle(0.8)
    robot = Robot(four_bar_model(), constraints=[PIN], independent=['crank'],
                  configuration=q)
    return limited(robot), q, np.array([0.5])


def refused(*arguments, **options):
    raise AssertionError('a kernel compiles')


@pytest.mark.parametrize('made', [tree, loop])
def test_requests_compile_nothing_once_their_kernels_are_ready(monkeypatch, made):
    monkeypatch.setenv('KANE_DYNAMICS_CACHE', 'off')
    robot, q, u = made()
    compile_answers([robot], locks=False)
    served = served_robot(robot, {'trajectory.limit_factor': 1e6})
    state = {'position': q.tolist(), 'velocity': u.tolist()}
    assemble = llvm.assemble
    monkeypatch.setattr(llvm, 'assemble', refused)
    still = np.zeros(robot.n).tolist()
    for kind, call, fields in (
            (InverseDynamics, inverse_dynamics, {'acceleration': still}),
            (ForwardDynamics, forward_dynamics, {'effort': still}),
            (GetDynamics, get_dynamics, {}),
            (Explain, explain, {'acceleration': still})):
        call(served, kind.Request(**state, **fields), kind.Response())
    names = list(robot.actuated_names)
    places = [robot.coordinate_names.index(name) for name in names]
    rows = np.array([q[places], q[places] + 0.05])
    message = JointTrajectory(joint_names=names)
    for second, row in enumerate(rows):
        point = JointTrajectoryPoint(positions=row.tolist())
        point.time_from_start.sec = second
        message.points.append(point)
    filled = filled_message(served, message)
    assert np.isfinite([point.effort for point in filled.points]).all()
    motion = Motion.from_points([0.0, 1.0], rows, joint_names=names)
    times = np.array([0.0, 0.5])
    assert np.isfinite(motion_efforts(served, motion, times, motion.sample(times))).all()

    # The requests that a worker answers compile nothing after their groups.
    monkeypatch.setattr(llvm, 'assemble', assemble)
    compile_simulations(served.simulated, ['rk4'],
                        sticking=False, stops=False, locks=False)
    monkeypatch.setattr(llvm, 'assemble', refused)
    if not robot.constraint_names:  # of which forces follow by kernels of their own
        SimulationRequest.from_request(
            Simulate.Request(**state, duration=0.01), served).run(
                Simulate.Response(), lambda t: True)


def test_worker_requests_wait_for_their_kernels():
    robot, q, u = tree()
    asked = []
    served = served_robot(robot)

    def require(group, proceed=None):
        asked.append(group)
        return True
    object.__setattr__(served, 'require_kernels', require)
    SimulationRequest.from_request(Simulate.Request(
        position=q.tolist(), velocity=u.tolist(), duration=0.01),
        served).run(Simulate.Response(), lambda t: True)
    assert asked == [SIMULATIONS]


class Groups:
    """Three groups that compile when they are allowed to."""

    def __init__(self):
        self.allowed = {name: threading.Event() for name in 'abc'}
        self.begun = []
        self.lines = []
        self.errors = []
        self.first = threading.Event()
        self.later = LaterKernels(
            {name: lambda name=name: self.compile(name) for name in 'abc'},
            self.lines.append, self.errors.append)

    def compile(self, name):  # noqa: A003
        self.begun.append(name)
        self.first.set()
        assert self.allowed[name].wait(PATIENCE)
        if name == 'b':
            raise CompileError('no such instruction')


def threads():
    return [thread for thread in threading.enumerate() if thread.name == 'kernels']


def test_a_request_waits_for_its_group_which_is_the_next_one():
    groups = Groups()
    groups.later.start()
    assert groups.first.wait(PATIENCE)
    answered = []

    def ask():
        groups.later.require('c')
        answered.append('c')
    request = threading.Thread(target=ask)
    request.start()
    # Order of use, but for what is asked for.
    while list(groups.later._waiting) != ['c', 'b']:
        assert request.is_alive()
    assert not answered
    groups.allowed['a'].set()
    groups.allowed['c'].set()
    request.join(PATIENCE)
    assert answered == ['c']
    groups.allowed['b'].set()
    with pytest.raises(CompileError,
                       match='kernels of b: CompileError: no such instruction'):
        groups.later.require('b')
    for thread in threads():
        thread.join(PATIENCE)
    assert groups.begun == ['a', 'c', 'b']
    assert groups.errors == ['kernels of b: CompileError: no such instruction']
    assert groups.lines[-1].startswith('kernels of a and b and c ready after ')
    groups.later.require('a')  # at once


def test_a_simulation_that_waits_for_its_kernels_can_be_cancelled():
    robot, q, u = tree()
    groups = Groups()
    groups.later.start()
    served = served_robot(robot)
    object.__setattr__(served, 'require_kernels',
                       lambda group, proceed: groups.later.require('c', proceed))
    times = []

    def proceed(t):
        times.append(t)
        return len(times) < 3
    response = Simulate.Response()
    SimulationRequest.from_request(Simulate.Request(
        position=q.tolist(), velocity=u.tolist(), duration=0.01), served).run(
            response, proceed)
    assert times == [0.0, 0.0, 0.0]
    assert not response.trajectory.points
    for event in groups.allowed.values():
        event.set()
    for thread in threads():
        thread.join(PATIENCE)


def test_cleanup_ends_waiting_requests_at_once_and_the_thread_after_its_kernel():
    done = []
    begun = threading.Event()
    allowed = threading.Event()

    def kernel(k):
        begun.set()
        assert allowed.wait(PATIENCE)
        done.append(k)
    later = LaterKernels(
        {'a': lambda: run_concurrently([lambda k=k: kernel(k) for k in range(5)])},
        done.append, done.append)
    later.start()
    assert begun.wait(PATIENCE)
    reasons = []

    def ask():
        with pytest.raises(InputError, match='node: not configured') as refused:
            later.require('a')
        reasons.append(refused.value)
    request = threading.Thread(target=ask)
    request.start()
    later.close()
    request.join(PATIENCE)
    assert len(reasons) == 1
    allowed.set()
    for thread in threads():
        thread.join(PATIENCE)
    assert done == [0]
