"""The node dies or hangs in motion, and torque_guard holds the arm: over DDS."""

import os
from pathlib import Path
import signal

import guard_rig
from guard_rig import largest_step, mujoco_arm, PERIOD, PLANT_ARM, Rig, sag, turns
from node_process import TORQUE_PATH
import numpy as np
import pytest
from std_msgs.msg import Empty

REACTION = 0.020  # s
SAG = 0.5  # degrees
STALLS = 5  # failed trials that a stall of the machine may excuse
HELD = 0.6  # s for which the guard holds the arm
HELPERS = str(Path(guard_rig.__file__).parent)
# Beside real-time trials, what is tried here needs the processors to itself, too.
pytestmark = pytest.mark.slow


@pytest.fixture(scope='module')
def rig(tmp_path_factory):
    """Return an arm; the main thread of its node can be blocked."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv('PYTHONPATH', HELPERS, prepend=os.pathsep)
        rig = Rig(tmp_path_factory.mktemp('guard'), node='blocked_node')
        yield rig
        rig.close()


def trial(rig, number):
    """Let the node fail in motion and return; return reaction, sag, step, commanders."""
    # A stall of the machine while the arm starts is not what is tried.
    for _ in range(10):
        rig.move()
        if rig.moving():
            break
    assert rig.moving(), rig.logs()
    recorder = rig.recorder
    failed = rig.fail(number)
    recorder.spin(HELD)
    # The machine may have stalled the node before, too.
    guard = [command for command in recorder.of('guard') if command.time >= failed]
    assert guard, rig.logs()
    # A message that blocks the main thread arrives after some commands.
    began = max(failed, max(command.stamp for command in recorder.of('node')
                            if command.stamp <= guard[0].stamp))
    reaction = (guard[0].time - failed) * 1e-9
    far = sag(rig, began, guard[0].stamp)
    held = recorder.states[-1][1]
    n = len(recorder.of('node'))
    recorder.spin(0.1)
    drift = float(np.degrees(np.abs(recorder.states[-1][1] - held).max()))
    if number == signal.SIGKILL:
        rig.node.end(signal.SIGKILL)
        rig.start_node()
    elif number == signal.SIGSTOP:
        os.kill(rig.node.pid, signal.SIGCONT)
    recorder.spin_until(lambda: len(recorder.of('node')) > n + 50, 90.0)
    return (reaction, far + drift, largest_step(recorder.commands, rig.arm.rate),
            turns([command for command in recorder.commands
                   if command.time >= failed - PERIOD * 1e9]))


def took_over_in_time(reaction, far, step, voices):
    """Return whether the guard took over in time, and gave back without a step."""
    return (reaction <= REACTION and far <= SAG and step <= 1.01
            and voices[:3] == ['node', 'guard', 'node'])


# The arm, the node, the guard and the test share the processors in real time.
@pytest.mark.slow
@pytest.mark.parametrize('number', [
    signal.SIGSTOP, signal.SIGKILL, pytest.param(None, marks=pytest.mark.skipif(
        TORQUE_PATH != 'python',
        reason='a native path does not wait for the main thread'))],
                         ids=['stopped', 'killed', 'main thread blocked'])
def test_a_node_that_fails_in_motion_is_replaced_within_20_ms_and_returns_without_step(
        rig, number):
    reaction, far, step, voices = trial(rig, number)
    assert reaction <= REACTION
    assert far <= SAG
    assert step <= 1.01
    # On a busy machine the node may hang once more.
    assert voices[:3] == ['node', 'guard', 'node']
    assert voices[1::2] == ['guard'] * len(voices[1::2])


@pytest.mark.skipif(TORQUE_PATH == 'python',
                    reason='the interpreter waits for its main thread')
def test_a_native_node_whose_main_thread_is_blocked_commands_on_and_keeps_the_guard_away(
        rig):
    rig.move()
    assert 'torque path: native' in rig.node.log
    recorder = rig.recorder
    recorder.forget()
    recorder.block.publish(Empty())
    recorder.spin(0.9)  # of the second for which it is blocked
    assert turns(recorder.commands) == ['node']
    assert len(recorder.of('node')) > 0.95 * len(recorder.states)


def test_a_killed_guard_is_reported_by_the_node_and_a_new_one_is_found(rig):
    rig.wait()
    recorder = rig.recorder

    def misses_guard():
        """Return whether the node's last words about the guard are that it is silent."""
        return rig.node.log.rfind('torque_guard silent for') > rig.node.log.rfind(
            'torque_guard watches')
    # A node that hung may have missed heartbeats before.
    recorder.spin_until(lambda: not misses_guard(), 10.0)
    n = len(recorder.of('node'))
    rig.guard.end(signal.SIGKILL)
    recorder.spin_until(misses_guard, 10.0)
    assert 'start torque_guard' in rig.node.log
    assert len(recorder.of('node')) > n + 50, 'the node goes on'
    rig.start_guard()
    recorder.spin_until(lambda: not misses_guard(), 60.0)


def test_an_interrupted_node_commands_zeros_and_the_guard_does_not_take_over(rig):
    rig.wait()
    rig.recorder.forget()
    takeovers = rig.guard.log.count('commanding')
    rig.node.end(signal.SIGINT, timeout=20.0)
    rig.recorder.spin(0.3)
    assert not rig.recorder.commands[-1].tau.any()
    assert rig.guard.log.count('commanding') == takeovers
    rig.start_node()


@pytest.mark.slow
@pytest.mark.timeout(7200)
@pytest.mark.parametrize('number', [signal.SIGSTOP, signal.SIGKILL],
                         ids=['stopped', 'killed'])
@pytest.mark.parametrize('mujoco', [False, True], ids=['plant_node', 'MuJoCo'])
def test_100_of_100_failures_in_motion_are_caught(tmp_path, mujoco, number):
    rig = Rig(tmp_path, mujoco_arm() if mujoco else PLANT_ARM, mujoco=mujoco)
    excused = []
    try:
        trials = []
        while len(trials) < 100:
            # At another point of motion and period.
            rig.recorder.spin(0.007 * len(trials))
            result = trial(rig, number)
            # A stall is shown by a process that comes before all others.
            if not took_over_in_time(*result) and rig.stalled(HELD) and len(
                    excused) < STALLS:
                excused.append(result)
            else:
                trials.append(result)
    finally:
        rig.close()
    print(f'{len(excused)} failed trials in which the machine stalled were repeated: '
          f'{excused}')
    missed_trials = [outcome for outcome in trials if not took_over_in_time(*outcome)]
    print(f'{len(trials) - len(missed_trials)} of {len(trials)} caught; largest '
          'reaction, sag, step:',
          *np.max([outcome[:3] for outcome in trials], axis=0).round(4))
    assert not missed_trials
