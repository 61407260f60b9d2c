"""
Arms in MuJoCo led through singular configurations by a node, over DDS.

The experiments of benchmarks/task_space_laws.py with the node in the loop: the target
comes as ~/target_pose at 100 Hz. `pytest -m slow -s` prints the table that
docs/task_space.md summarizes.
"""

from pathlib import Path
import sys

from kane_dynamics import CartesianImpedance, load_urdf, PoseMotion, PosePath, Robot
from kane_dynamics.ros.parameters.task_settings import cartesian_settings
from node_process import Process
from node_values import node_values
import numpy as np
import pytest

pytest.importorskip('mujoco')
sys.path.append(str(Path(__file__).resolve().parents[2] / 'benchmarks'))

import task_space_laws as experiments  # noqa: E402, I100

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900),
              pytest.mark.filterwarnings('ignore::kane_dynamics.errors.ModelWarning')]
ARMS = experiments.arms()
STOP = 'a stop at the '
CASES = [(passage.arm, passage.what) for passage in experiments.PASSAGES]
CASES += [(passage.arm, STOP + passage.what) for passage in experiments.PASSAGES]
CASES += [(name, edge) for name in ARMS for edge in experiments.EDGES]
TARGETS = 10  # cycles between two targets
SETTLING = 3.0  # s of rest after the passage
STILL = 1.0  # s after the last target, from which the target rests
POSTURE_STIFFNESS = 5.0  # N m/rad: the default
ORDINARY = {'speed of the target'}  # what may be at its limit outside
SETTINGS = {'cartesian.stiffness': experiments.STIFFNESS.tolist(),
            'cartesian.max_force': 200.0,
            'cartesian.max_moment': 40.0,
            'arm_compensates': ['friction']}


def motion_of(robot, arm, what):
    """Return where a passage starts, and the motion of its target."""
    if what in experiments.EDGES:
        return arm.home, experiments.to_the_edge(robot, arm.frame, arm.home,
                                                 experiments.EDGES[what])
    passage = next(passage for passage in experiments.PASSAGES
                   if (passage.arm, passage.what) == (arm.name, what.removeprefix(STOP)))
    if what.startswith(STOP):
        return (np.array(passage.start),
                experiments.to_a_stop_at(robot, arm.frame, passage))
    return np.array(passage.start), experiments.through(robot, arm.frame, passage)


class Record:
    """Records of the cycles of one run."""

    def __init__(self, robot):
        self._limits = robot.limits
        self.torque = self.speed = 0.0
        self.energies = []

    def add(self, cycle):
        self.torque = max(self.torque, np.max(np.abs(cycle.tau) / self._limits.effort))
        self.speed = max(self.speed, np.max(np.abs(cycle.u) / self._limits.velocity))


def lead(lockstep, motion, record, energy=None):
    """Stream the poses of a motion, then let the target rest."""
    for k in range(int((motion.duration + SETTLING) * experiments.RATE)):
        moment = k / experiments.RATE
        if k % TARGETS == 0 and moment <= motion.duration + 0.1:
            lockstep.send_target(motion.sample(min(moment, motion.duration)).pose)
            lockstep.wait_for_node()
        cycle = lockstep.cycle()
        if cycle.tau is None:
            return
        record.add(cycle)
        if energy is not None and moment > motion.duration + STILL:
            record.energies.append(energy())


def errors_of(states):
    """Return the distances, m, of the frame from the pose that the law uses."""
    return np.array([[state.position_error.x, state.position_error.y,
                      state.position_error.z] for state in states])


def first_limited(states):
    """Return the index of the first state at which the law limits anything."""
    limited = [bool(set(state.saturated) - ORDINARY) for state in states]
    return limited.index(True) if any(limited) else len(limited)


@pytest.mark.parametrize(('name', 'what'), CASES)
def test_an_arm_is_led_through_a_singular_configuration_over_dds(
        participant, name, what):
    from lockstep_arm import LockstepArm
    arm = ARMS[name]
    robot = Robot(load_urdf(arm.urdf, tip=arm.frame), friction=False)
    plant = experiments.Plant(robot, arm.urdf)
    start, motion = motion_of(robot, arm, what)
    plant.reset(start)
    lockstep = LockstepArm(plant)
    # An arm that rests at a singular configuration leaves it on the side of its posture.
    posture_stiffness = POSTURE_STIFFNESS if what.startswith(STOP) else 0.0
    node = Process(urdf=arm.urdf, tip=arm.frame, arm_compensates='[friction]',
                   mode='cartesian_impedance', cartesian__frame=arm.frame,
                   cartesian__stiffness=experiments.STIFFNESS.tolist(),
                   cartesian__posture_stiffness=posture_stiffness,
                   cartesian__max_force=SETTINGS['cartesian.max_force'],
                   cartesian__max_moment=SETTINGS['cartesian.max_moment'],
                   target__max_speed=0.5, target__max_angular_speed=1.5,
                   use_sim_time='true', state_timeout=1.0, real_states=True,
                   diagnostics_rate=20)
    settings = cartesian_settings(node_values(
        {**SETTINGS, 'cartesian.posture_stiffness': posture_stiffness}), robot)
    law = CartesianImpedance(robot, arm.frame, **{'posture': start, **settings})
    end = motion.sample(motion.duration).pose
    aside = end.copy()
    aside[:3, 3] += [0.0, 0.05, -0.05]
    ordinary = PoseMotion(PosePath.through([end, aside, end]), experiments.LIMITS)
    record = Record(robot)
    try:
        node.wait_for('active, mode')
        lockstep.connect()
        lockstep.task_states.clear()
        lead(lockstep, motion, record,
             lambda: plant.kinetic_energy() + law.energy(plant.state[0], end))
        passage = list(lockstep.task_states)
        lockstep.task_states.clear()
        lead(lockstep, ordinary, record)
    finally:
        lockstep.close()
        code = node.end()[0]
    assert code == 0 and 'Traceback' not in node.log, node.log
    assert lockstep.unanswered == 0, node.log
    ordinary_states = lockstep.task_states
    distances = np.linalg.norm(errors_of(passage), axis=1)
    last = np.linalg.norm(errors_of(ordinary_states), axis=1)
    entered = first_limited(passage)
    limited = first_limited(ordinary_states)
    # At rest before and after the ordinary motion the arm is at its target in any case.
    outside = max(distances[:entered].max(initial=0.0), last[:limited].max(initial=0.0),
                  last[0], last[-1])
    inside = max(distances[entered:].max(initial=0.0), last[limited:].max(initial=0.0))
    rise = np.diff(record.energies).max()
    smallest = min(state.smallest_singular_value for state in passage)
    refused = node.log.count('out of reach')
    print(f'\n| {name} | {what} | {smallest:.1e} | {record.torque:.0%} | '
          f'{record.speed:.0%} | '
          f'{1e3 * outside:.2g} mm | {1e3 * inside:.2g} mm | {rise:.1e} J | {refused} |')
    assert record.torque <= 1.0 + 1e-9
    assert record.speed <= 1.0
    if not posture_stiffness:  # the pull of a posture has no energy of its own
        assert rise <= experiments.RISE
    assert outside <= experiments.OUTSIDE
    assert last.max() <= experiments.ORDINARY_ERROR
