"""
The node moves a simulated arm over DDS, with a false joint state and without it.

The node is a process of its own. Simulated time advances when a state is answered, so
that how busy the machine is changes no number: both runs are equal up to the fault, to
the last bit, and what differs afterwards is the fault's. The arm is that of
`plant_node`, or in MuJoCo.
"""

import signal
import time

from false_states import arm, FALSE, FAULT, MOST, NANO, PERIOD, SHORT, simulated_arm
from kane_dynamics.demo.demo_settings import FR3
from lifecycle_msgs.msg import Transition
from moved_palletizer import PALLETIZER
from node_process import DEEP, wait_until
import numpy as np
from palletizer import LOOPS, URDF
import pytest
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState

DEMO_ROBOTS = {'fr3': FR3, 'palletizer': PALLETIZER}
START = 40  # states at rest before the motion
LAST = 60  # false states of a fault that lasts
ATTEMPTS = 3  # of runs in which DDS loses a message


class MujocoSide:
    """An arm in MuJoCo with the members of the plant's arm."""

    def __init__(self, name):
        mujoco_plant = pytest.importorskip('kane_dynamics.demo.mujoco_plant')
        self._forward = mujoco_plant.mujoco.mj_forward
        self.robot, _, _ = arm(name)
        self._arm = mujoco_plant.MujocoArm(DEMO_ROBOTS[name])
        model = self._arm.model
        joints = [model.joint(joint) for joint in self.robot.joint_names]
        self._q = [joint.qposadr[0] for joint in joints]
        self._u = [joint.dofadr[0] for joint in joints]
        self._motors = [self.robot.joint_names.index(joint)
                        for joint in DEMO_ROBOTS[name].joints]

    @property
    def q(self):
        return self._arm.data.qpos[self._q].copy()

    @property
    def u(self):
        return self._arm.data.qvel[self._u].copy()

    def reset(self, q):
        self._arm.reset()
        self._arm.data.qpos[self._q] = q
        self._forward(self._arm.model, self._arm.data)

    def step(self, torque):
        self._arm.step(torque[self._motors])


class PlantSide:
    """The arm of `plant_node`, with two steps between states."""

    def __init__(self, name):
        self._arm = simulated_arm(name)

    @property
    def q(self):
        return self._arm.q.copy()

    @property
    def u(self):
        return self._arm.u.copy()

    def reset(self, q):
        self._arm.reset(q)

    def step(self, torque):
        for _ in range(2):
            self._arm.step(torque)


SIDES = {'plant_node': PlantSide, 'MuJoCo': MujocoSide}


class LostError(Exception):
    """DDS has lost a message of a run, which is no evidence then."""


class Lockstep:
    """A node and a simulated arm in simulated time."""

    def __init__(self, client, start, name, engine, torque_path, **parameters):
        self.client, self.name, self.arm = client, name, SIDES[engine](name)
        self.robot, self.home, self.motion = arm(name)
        self.time = 100 * NANO
        self.clock = client.create_publisher(Clock, '/clock', DEEP)
        self.states = client.create_publisher(JointState, 'joint_states', DEEP)
        options = {'urdf': URDF, 'constraints': LOOPS}
        if name == 'fr3':
            options = {'urdf': DEMO_ROBOTS[name].urdf,
                       'joints': f'[{",".join(self.robot.joint_names)}]'}
        self.node = start(real_states=True, use_sim_time='true', mode='computed_torque',
                          gains__kp=100.0, gains__kd=20.0, torque_path=torque_path,
                          diagnostics_rate=20.0, **options, **parameters)
        client.joints = self.robot.joint_names
        self.node.wait_for('active, mode', 600.0)  # compiling, on a busy machine
        assert wait_until(lambda: self.clock.get_subscription_count() >= 1
                          and self.states.get_subscription_count() == 1
                          and client.motions.get_subscription_count() == 1, 60.0)
        self.arm.reset(self.home)
        assert wait_until(self.answers, 30.0)

    def close(self):
        self.client.destroy_publisher(self.clock)
        self.client.destroy_publisher(self.states)

    def answers(self):
        try:
            self.state()
        except LostError:
            return False
        return True

    def publish(self, change=None):
        """Publish time and state; return the stamp of the state."""
        self.time += PERIOD
        message = Clock()
        message.clock.sec, message.clock.nanosec = divmod(self.time, NANO)
        self.clock.publish(message)
        q = self.arm.q
        u = self.arm.u
        age = 0
        if change is not None:
            q, u, age = change(q, u)
        message = JointState(name=list(self.robot.joint_names), position=q.tolist(),
                             velocity=u.tolist())
        stamp = message.header.stamp
        stamp.sec, stamp.nanosec = divmod(self.time - age, NANO)
        self.states.publish(message)
        return self.time - age

    def torque(self, efforts):
        """Return the torques of all joints from those of the motors."""
        names = self.client.names
        torque = np.zeros(len(self.robot.joint_names))
        torque[[self.robot.joint_names.index(joint) for joint in names]] = efforts
        return torque

    def state(self):
        """Publish a true state; return the torques that answer it."""
        stamp = self.publish()
        if not wait_until(lambda: stamp in self.client.torques, 3.0):
            raise LostError(f'no answer: {self.node.log[-1500:]}')
        return self.torque(self.client.torques[stamp])

    def dropped(self):
        """Return how many states are dropped, by reason, once diagnostics settle."""
        key = 'states dropped: '
        self.client.diagnostics.clear()
        for _ in range(4000):
            self.answers()  # the time of the diagnostics is that of the states
            counts = [{name.removeprefix(key): int(x) for name, x in values.items()
                       if name.startswith(key)}
                      for _, _, values in list(self.client.diagnostics)
                      if 'states dropped' in values]
            if len(counts) > 4 and counts[-1] == counts[-2] == counts[-3]:
                return counts[-1]
        raise AssertionError(f'diagnostics: {counts[-3:]}')

    def run(self, change=None, count=1, moving=True):
        """Return the positions of all states of a motion, (K, n); `count` are false."""
        self.arm.reset(self.home)
        for _ in range(START):
            torque = self.state()
            self.arm.step(torque)
        if moving:
            points = [(t, q) for t, q in zip(self.motion.times, self.motion.positions)]
            self.client.follow(points, names=self.motion.joint_names,
                               start=self.time + 10 * PERIOD)
            time.sleep(0.3)
        rows = []
        for k in range(SHORT):
            if change is not None and FAULT <= k < FAULT + count:
                self.publish(change)
                time.sleep(0.03)  # the next one would take its place in a queue of one
            else:
                torque = self.state()
            self.arm.step(torque)
            rows.append(self.arm.q)
        for _ in range(600):  # to the end of the motion
            self.arm.step(self.state())
        return np.array(rows)

    def fault(self, change, count, moving):
        """
        Return positions (K, n) and torques while `count` states in a row are false.

        The last ones are followed by as many true states. The node begins at home.
        """
        assert self.client.transition(Transition.TRANSITION_DEACTIVATE)
        self.arm.reset(self.home)
        assert self.client.transition(Transition.TRANSITION_ACTIVATE)
        assert wait_until(self.answers, 30.0)
        for _ in range(START):
            torque = self.state()
            self.arm.step(torque)
        if moving:
            self.client.follow(list(zip(self.motion.times, self.motion.positions)),
                               names=self.motion.joint_names,
                               start=self.time + 10 * PERIOD)
            time.sleep(0.3)
        rows = []
        torques = []
        for k in range(FAULT + 2 * count):
            if FAULT <= k < FAULT + count:
                torque = self.answer_to_false(change)
            elif k < FAULT or np.any(torque):
                torque = self.state()
            else:
                self.publish()
                time.sleep(0.003)
            self.arm.step(torque)
            rows.append(self.arm.q)
            torques.append(torque)
        return np.array(rows), np.array(torques)

    def lasting_fault(self, reason, change, count, moving):
        """Return positions and torques of a fault, which is reported once."""
        report = f'fault: {reason} for 0.0'
        for _ in range(ATTEMPTS):
            count_before = self.node.log.count(report)
            try:
                rows, torques = self.fault(change, count, moving)
            except LostError as error:
                lost = error
                continue
            assert self.node.log.count(
                report) == count_before + 1, (reason, self.node.log[-1500:])
            return rows, torques
        raise lost

    def answer_to_false(self, change):
        """Publish a false state; return the torque that follows; zeros follow once."""
        commands = self.client.commands
        count = len(commands)
        zero = not np.any(commands[-1])
        self.publish(change)
        if not wait_until(
                lambda: len(commands) > count, 0.01 if zero else 3.0) and not zero:
            raise LostError(f'no command: {self.node.log[-1500:]}')
        return self.torque(commands[-1])

    def after_silence(self, change, timeout):
        """Publish a false state; return the torque that acts once it is answered."""
        count = len(self.client.commands)
        self.publish(change)
        wait_until(lambda: len(self.client.commands) > count, timeout)
        return self.torque(self.client.commands[-1])

    def compared(self, reference, reason, change, count):
        """Return the distance from a run without false states, which are counted."""
        outcome = 'states lost in every run'
        for _ in range(ATTEMPTS):
            count_before = self.dropped().get(reason, 0)
            try:
                rows = self.run(change, count)
            except LostError:
                continue
            away = np.abs(rows - reference)
            counted = self.dropped().get(reason, 0) - count_before
            if counted == count and away[:FAULT].max() < 1e-9:
                return away
            outcome = counted, away[:FAULT].max()
        raise AssertionError((reason, outcome, self.node.log[-1500:]))


LASTING = {'fr3': ('jump', 'small jump', 'degrees', 'not finite'),
           'palletizer': ('jump', 'contradiction', 'another assembly mode')}
CASES = [('fr3', 'plant_node', 'python'), ('fr3', 'plant_node', 'native'),
         ('fr3', 'MuJoCo', 'python'), ('palletizer', 'plant_node', 'python'),
         ('palletizer', 'plant_node', 'native'), ('palletizer', 'MuJoCo', 'python')]


@pytest.mark.slow
@pytest.mark.timeout(1800)
@pytest.mark.parametrize(('name', 'engine', 'torque_path'), CASES)
def test_no_false_state_moves_an_arm_in_motion(client, start, capsys, name, engine,
                                               torque_path):
    lockstep = Lockstep(client, start, name, engine, torque_path)
    try:
        lockstep.run()
        reference = lockstep.run()
        assert np.ptp(reference, axis=0).max() > 0.02, 'it moves'
        again = lockstep.run()
        assert np.abs(again - reference).max() < 1e-9, 'it repeats'
        largest = {}
        for fault, (reason, change) in FALSE[name].items():
            for count in (1, 3):
                away = lockstep.compared(reference, reason, change, count)
                largest[fault, count] = away.max()
                assert away.max() < MOST, (fault, count, away.max())
        with capsys.disabled():
            print(f'\n{name}, {engine}, {torque_path}: {len(largest)} faults, largest '
                  f'{1e3 * max(largest.values()):.3f} mrad '
                  f'({max(largest, key=largest.get)})')
    finally:
        lockstep.close()


@pytest.mark.slow
@pytest.mark.timeout(1800)
@pytest.mark.parametrize(('name', 'engine', 'torque_path'), CASES)
def test_a_fault_that_lasts_ends_as_configured(client, start, capsys, name, engine,
                                               torque_path):
    """At rest and in motion: the grace time, then a stop and hold, or zeros."""
    lockstep = Lockstep(client, start, name, engine, torque_path)
    # States
    grace = 26
    stop = 125
    figures = []
    try:
        for action in ('hold', 'zero'):
            assert client.adjust(state_check__action=action).successful
            for fault in LASTING[name]:
                reason, change = FALSE[name][fault]
                for moving in (False, True):
                    case = (action, fault, moving)
                    rows, torques = lockstep.lasting_fault(reason, change,
                                                           grace + stop + 30, moving)
                    # During the grace time the last command goes on.
                    assert np.ptp(torques[FAULT - 1:FAULT + grace - 2],
                                  axis=0).max() == 0.0, case
                    speeds = np.abs(np.diff(rows, axis=0)).max(axis=1) * (NANO / PERIOD)
                    if action == 'zero':
                        assert not torques[FAULT + grace + 1:].any(), case
                        continue
                    fastest = speeds[:FAULT + grace].max()
                    assert (fastest > 0.3) == moving, case
                    final_speed = speeds[FAULT + grace + stop:].max()
                    assert final_speed < max(0.05 * fastest, 0.01), (case, final_speed)
                    distance = np.abs(rows[FAULT:] - rows[FAULT]).max()
                    assert distance < max(0.19 * fastest, MOST), (case, distance)
                    figures.append((final_speed, distance, fastest, *case))
        with capsys.disabled():
            final_speed, distance, fastest, *case = max(figures)
            print(f'\n{name}, {engine}, {torque_path}: of {len(figures)} faults from up '
                  f'to {fastest:.2f} rad/s at most {final_speed:.4f} rad/s after the '
                  f'stop, moved {distance:.3f} rad ({case})')
    finally:
        lockstep.close()


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize('action', ['hold', 'zero'])
@pytest.mark.parametrize('before', [5, 60], ids=['in the grace time', 'in the stop'])
def test_the_guard_stops_an_arm_whose_node_dies_in_a_fault(
        client, start, capsys, action, before):
    """The states stay false: the guard knows only the motion before the fault."""
    lockstep = Lockstep(client, start, 'fr3', 'plant_node', 'python',
                        guard__enabled='true',
                        guard__lease=1.0, state_check__action=action)
    _, change = FALSE['fr3']['jump']
    try:
        guard = start(module='kane_dynamics.ros.guard.main')
        guard.wait_for('watching kane_dynamics', 300.0)
        assert wait_until(lambda: lockstep.answers() and 'torque_guard watches'
                          in lockstep.node.log, 60.0), lockstep.node.log
        client.follow(list(zip(lockstep.motion.times, lockstep.motion.positions)),
                      names=lockstep.motion.joint_names,
                      start=lockstep.time + 10 * PERIOD)
        time.sleep(0.3)
        for _ in range(FAULT):
            lockstep.arm.step(lockstep.state())
        for _ in range(before):
            lockstep.arm.step(lockstep.answer_to_false(change))
        lockstep.node.end(signal.SIGKILL)
        states = []
        of_node = len(client.commands)
        for _ in range(600):
            # In the silence no command follows; then the guard answers each state.
            acts = len(client.commands) > of_node and np.any(client.commands[-1])
            lockstep.arm.step(lockstep.after_silence(change, 0.2 if acts else 0.004))
            states.append((lockstep.arm.q, lockstep.arm.u))
        q, u = np.array(states).swapaxes(0, 1)
        moved = np.abs(q - q[0]).max()
        fastest = np.abs(u).max()
        final_speed = np.abs(u[-1]).max()
        with capsys.disabled():
            print(
                f'\n{action}, {before} states: at most {fastest:.3f} rad/s, after 1.2 s '
                f'{final_speed:.4f} rad/s, moved {moved:.3f} rad')
        if action == 'zero':
            assert not np.any(client.commands[-1])
            return
        guard.wait_for('stopping by the model and holding', 1.0)
        assert final_speed < 0.05
        # In the silence at its speed, and by half of the time of the stop.
        assert moved < (0.2 + 0.125) * fastest
    finally:
        lockstep.close()
