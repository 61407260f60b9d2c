"""
Round trip of the node compared with empty echo nodes, in one shuffled run.

Four processes live together (node_contenders.py): the dynamics node with a seven-axis
arm, an empty rclpy node that answers each joint state with an array of the same size on
rclpy's default executor, the same on the EventsExecutor, and the same in C. One driver
visits them in shuffled order, one visit every 2 ms on average, with a jittered period,
so that every contender meets the same noise; visits of one round belong together. Rounds
come in blocks, and through every other block a fifth process calls the node's simulation
service back to back.

The gates: the median of the paired ratios to the echoes, and beside simulations the node
loses less than 2 % of the states. With the argument `realtime` the node runs with its
real-time settings (which need the rights). With the argument `palletizer` it is that of
an arm of four motors with three closed loops, whose other six joints follow from loop
closure; only the gates to the echo on the default executor hold there. With `native` the
torque path does without the interpreter, also with `palletizer`, each with gates of its
own; otherwise the interpreter computes the commands. With the name of a mode, such as
`cartesian_impedance`, the node runs in it; by default in computed_torque. With
`--no-gates` missed gates are printed and no failure.

With `--tail N` the node and the echo in C alone are visited N times each under each
load, one after the other without a pause. All percentiles are printed up to the longest
of N, and the histogram: how many took longer than each of some times.
"""

import argparse
from collections.abc import Sequence
import os
import random
import sys
import time
from typing import IO

from gates import exit_status, NO_GATES
from kane_dynamics.demo.demo_settings import DemoRobot
from kane_dynamics.ros.parameters.parameter_table import LAW_MODES
from node_contenders import (BEST_EFFORT, compile_echo, contenders, DEFAULT, EVENTS,
                             IN_C, NAMESPACES, OURS, REALTIME, RELIABLE, ROBOTS)
import numpy as np
import rclpy
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

PALLETIZER = 'palletizer'
NATIVE = 'native'
FRAMES = {'fr3': 'fr3_hand', PALLETIZER: 'tool'}
IDLE = 'idle'
BUSY = 'beside simulations'
PERIOD = 2e-3  # s between visits, on average
# rounds, with pauses and without
BLOCK = 250
LONG_BLOCK = 2500
PERCENTILES = (50.0, 90.0, 99.0, 99.9, 99.99, 99.999, 100.0)
# Limits of the histogram, s.
LIMITS = (1e-4, 2e-4, 3e-4, 5e-4, 1e-3, 2e-3, 3e-3, 5e-3, 1e-2, 2e-2)
WARM_UP = 200  # rounds
# Most paired ratio by load and contender, and most states lost.
MOST_RATIO = {'fr3': {(IDLE, DEFAULT): 0.70, (BUSY, DEFAULT): 0.65, (IDLE, IN_C): 2.0},
              PALLETIZER: {(IDLE, DEFAULT): 0.80, (BUSY, DEFAULT): 0.80},
              NATIVE: {(IDLE, EVENTS): 0.68, (BUSY, EVENTS): 0.65, (IDLE, IN_C): 1.15,
                       (BUSY, IN_C): 1.2},
              f'{NATIVE} {PALLETIZER}': {(IDLE, IN_C): 1.3, (BUSY, IN_C): 1.3}}
MOST_LOST = 0.02
PATIENCE = 20e-3  # s after which an answer counts as lost


class Driver(Node):
    """Sends a joint state to one contender and waits for its answer."""

    def __init__(self, robot: DemoRobot, names: Sequence[str]) -> None:
        super().__init__('driver')
        self._robot = robot
        self._answered = ''
        self._at = 0.0
        self._publishers_to = {}
        for name in names:
            namespace = NAMESPACES[name]
            self._publishers_to[name] = self.create_publisher(
                JointState, f'{namespace}/joint_states', BEST_EFFORT)
            self.create_subscription(Float64MultiArray, f'{namespace}/commands',
                                     lambda message, name=name: self._on_answer(name),
                                     RELIABLE)
        self._message = JointState(name=robot.joints)
        self._executor = EventsExecutor()
        self._executor.add_node(self)

    def _on_answer(self, name: str) -> None:
        self._at = time.perf_counter()
        self._answered = name

    def visit(self, name: str, patience: float = PATIENCE) -> float:
        """Return the seconds of one round trip; nan if there is no answer."""
        message = self._message
        robot = self._robot
        rates = 2.0 * np.pi * self._robot.frequency
        phases = rates * time.perf_counter()
        message.position = (robot.home + 0.5 * robot.amplitude * np.sin(phases)).tolist()
        message.velocity = (0.5 * robot.amplitude * rates * np.cos(phases)).tolist()
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(
            time.time_ns(), 10**9)
        self._answered = ''
        began = time.perf_counter()
        self._publishers_to[name].publish(message)
        while self._answered != name:
            left = patience - (time.perf_counter() - began)
            if left <= 0.0:
                return float('nan')
            self._executor.spin_once(left)
        return self._at - began

    def pause(self, until: float) -> None:
        """Wait for a time of perf_counter; late answers are taken meanwhile."""
        while (left := until - time.perf_counter()) > 0.0:
            self._executor.spin_once(left)


def rounds(driver: Driver, names: Sequence[str], number: int, chance: random.Random,
           period: float = PERIOD) -> dict[str, np.ndarray]:
    """
    Return the round trips of `number` rounds, s; entries of one round belong together.

    Two visits are a period apart on average, s; 0: the next follows the answer.
    """
    trips: dict[str, list[float]] = {name: [] for name in names}
    order = list(names)
    for _ in range(number):
        chance.shuffle(order)
        for name in order:
            due = time.perf_counter() + period * chance.uniform(0.5, 1.5)
            trips[name].append(driver.visit(name))
            driver.pause(due)
    return {name: np.array(values) for name, values in trips.items()}


def measure(robot: DemoRobot, names: Sequence[str], samples: int, switch: IO[str],
            period: float = PERIOD) -> dict[str, dict[str, np.ndarray]]:
    """Return the round trips under each load; a line to `switch` changes the load."""
    block = BLOCK if period else LONG_BLOCK
    driver = Driver(robot, names)
    deadline = time.monotonic() + 60.0
    for name in names:
        while np.isnan(driver.visit(name, 0.1)):
            if time.monotonic() > deadline:
                raise RuntimeError(f'{name} does not answer')
    chance = random.Random(0)
    rounds(driver, names, WARM_UP, chance)
    blocks: dict[str, list[dict[str, np.ndarray]]] = {IDLE: [], BUSY: []}
    for _ in range(-(-samples // block)):
        for blocks_of_load in blocks.values():
            # The last simulation ends, the next begins.
            driver.pause(time.perf_counter() + 0.2)
            blocks_of_load.append(rounds(driver, names, block, chance, period))
            switch.write('\n')
            switch.flush()
    driver.destroy_node()
    return {which: {name: np.concatenate([block[name] for block in several])
                    for name in names} for which, several in blocks.items()}


def show_tail(which: str, trips: dict[str, np.ndarray]) -> None:
    """Print the percentiles of many round trips under one load, us."""
    heads = ' | '.join(f'p{percentile:g}' for percentile in PERCENTILES[:-1])
    print(f'\n{which}, us:\n\n| | visits | lost | {heads} | max |')
    print('|---' * (len(PERCENTILES) + 3) + '|')
    for name, values in trips.items():
        figures = np.nanpercentile(values, PERCENTILES) * 1e6
        row = ' | '.join(f'{figure:.0f}' for figure in figures)
        print(f'| {name} | {len(values)} | {np.isnan(values).sum()} | {row} |')


def show_histogram(trips: dict[str, np.ndarray]) -> None:
    """Print how many round trips took longer than each of some times; lost ones did."""
    print(f'\n| longer than | {" | ".join(trips)} |\n{"|---" * (len(trips) + 1)}|')
    for limit in LIMITS:
        counts = []
        for values in trips.values():
            counts.append(str(np.count_nonzero(~(values <= limit))))
        print(f'| {limit * 1e3:g} ms | {" | ".join(counts)} |')


def show(which: str, trips: dict[str, np.ndarray]) -> dict[tuple[str, str], float]:
    """Print the figures under one load; return paired ratios by load and contender."""
    print(f'\n{which}:\n\n| | p50, us | p99, us | lost | over {PERIOD * 1e3:g} ms |')
    print('|---|---|---|---|---|')
    for name, values in trips.items():
        p50, p99 = np.nanpercentile(values, [50, 99]) * 1e6
        print(f'| {name} | {p50:.0f} | {p99:.0f} | {np.isnan(values).mean():.2%} '
              f'| {(values > PERIOD).mean():.2%} |')
    ours = trips[OURS]
    paired = {}
    for name in list(trips)[1:]:
        paired[which, name] = float(np.nanmedian(ours / trips[name]))
        p99 = np.nanpercentile(ours, 99) / np.nanpercentile(trips[name], 99)
        difference = np.nanmedian(ours - trips[name]) * 1e6
        print(
            f'node / {name}: median of the paired ratios '
            f'{paired[which, name]:.2f}, of the '
            f'paired differences {difference:+.0f} us; ratio of the p99 {p99:.2f}')
    return paired


def main(*arguments: str, samples: int = 2500, tail: int = 0) -> int:
    """Print the comparison; return 1 if a gate does not hold, of a tail always 0."""
    machine_load = os.getloadavg()[0]
    robot = PALLETIZER if PALLETIZER in arguments else 'fr3'
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    os.environ.setdefault('ROS_DOMAIN_ID', str(random.SystemRandom().randint(1, 100)))
    left_out = compile_echo()
    visited = (OURS, IN_C) if tail else NAMESPACES
    names = [name for name in visited if not (left_out and name == IN_C)]
    rclpy.init()
    settings = list(REALTIME) if 'realtime' in arguments else []
    settings += ['-p', f'torque_path:={NATIVE if NATIVE in arguments else "python"}']
    for mode in set(arguments) & set(LAW_MODES):
        settings += ['-p', f'mode:={mode}', '-p',
                     f'cartesian.frame:={FRAMES[robot]}']
    with contenders(robot, names[1:], *settings) as loader:
        assert loader.stdin is not None
        assert loader.stdout is not None
        loader.stdout.readline()
        period = 0.0 if tail else PERIOD
        trips = measure(ROBOTS[robot], names, tail or samples, loader.stdin, period)
    simulations = int(loader.stdout.readline())
    rclpy.shutdown()
    print(f'Round trip, joint state to torques, {robot}, one shuffled run, '
          f'{len(trips[IDLE][OURS])} visits each; {simulations} simulations meanwhile; '
          f'load of the machine before {machine_load:.2f}')
    if tail:
        for which, several in trips.items():
            show_tail(which, several)
            show_histogram(several)
        return 0
    ratios = show(IDLE, trips[IDLE]) | show(BUSY, trips[BUSY])
    lost = np.isnan(trips[BUSY][OURS]).mean()
    kind = robot
    if NATIVE in arguments:
        kind = f'{NATIVE} {robot}' if robot == PALLETIZER else NATIVE
    gates = MOST_RATIO[kind]
    failed = [f'{which}: the paired ratio to the {name} is {ratios[which, name]:.2f}, '
              f'more than {limit}' for (which, name), limit in gates.items()
              if (which, name) in ratios and not ratios[which, name] <= limit]
    failed += [words for words, bad in (
        (f'{lost:.2%} lost beside simulations, {MOST_LOST:.0%} or more',
         lost >= MOST_LOST),
        ('no simulation was answered', simulations == 0)) if bad]
    if left_out:
        print(f'LEFT OUT: {IN_C}, its gate is not checked: {left_out}')
    for words in failed:
        print(f'FAILED: {words}')
    return exit_status(not failed)


if __name__ == '__main__':
    parser = argparse.ArgumentParser(description=__doc__.partition('.')[0])
    parser.add_argument('settings', nargs='*', help='see the top of the file',
                        choices=['realtime', PALLETIZER, NATIVE, *LAW_MODES, []])
    parser.add_argument('--tail', type=int, default=0, metavar='N')
    parser.add_argument(NO_GATES, action='store_true')
    options = parser.parse_args()
    sys.exit(main(*options.settings, tail=options.tail))
