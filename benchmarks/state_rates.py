"""
The rate of joint states at which the node begins to lose them, idle or loaded.

A driver publishes states at rising rates to the dynamics node with a seven-axis arm and
counts the states without a command. The node's diagnostics give the number that it knows
to be lost. A driver that cannot hold a rate says so: the rate that it reached is in the
table.

The gate: at the lowest rate, without simulations, less than 2 % have no command. With
the argument `realtime` the node runs with its real-time settings (which need the
rights). With `native` the native torque path computes the commands, and the gate is that
no state is lost up to 4 kHz, also beside simulations.
"""

from dataclasses import dataclass
import os
import random
import sys
import time

from diagnostic_msgs.msg import DiagnosticArray
from gates import exit_status
from kane_dynamics.demo.demo_settings import FR3
from kane_dynamics.ros.common.cdr import PreparedMessage, write_joint_state
from kane_dynamics.ros.common.conversion import NANO
from node_contenders import BEST_EFFORT, contenders, NAMESPACES, OURS, REALTIME
from node_latency import BUSY, IDLE, MOST_LOST, NATIVE
import rclpy
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

RATES = (500, 1000, 1500, 2000)  # Hz
NATIVE_RATES = (1000, 2000, 4000)
SECONDS = 3.0
JITTER = 1e-4  # rad, by which the states differ
SETTLE = 0.3     # s for the last commands of a rate
REPORT = 1.5     # s in which the node reports once
BEGIN = 0.001    # share without a command at which losses begin
ALL = QoSProfile(depth=1000)


@dataclass(frozen=True)
class Result:
    """One rate under one load."""

    load: str
    rate: int         # Hz, asked for
    reached: float    # Hz
    unanswered: float  # share of the states
    # States that the node's diagnostics call lost, since the last result.
    reported: str


class Driver(Node):
    """Publishes joint states at a rate and counts the commands."""

    def __init__(self) -> None:
        super().__init__('driver')
        name = NAMESPACES[OURS]
        self._states = self.create_publisher(JointState, f'{name}/joint_states',
                                             BEST_EFFORT)
        self.create_subscription(Float64MultiArray, f'{name}/commands', self._on_command,
                                 ALL, raw=True)
        self.create_subscription(DiagnosticArray, '/diagnostics', self._on_diagnostics,
                                 ALL)
        n = len(FR3.joints)
        writer, offsets = write_joint_state(FR3.joints, '', (n, n, n))
        self._message = PreparedMessage(writer, offsets[0], n)
        self.commands = 0
        self.lost = '0'
        self._executor = EventsExecutor()
        self._executor.add_node(self)

    def _on_command(self, data: bytes) -> None:
        self.commands += 1

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            for pair in status.values:
                if pair.key == 'states lost':
                    self.lost = pair.value

    def send(self) -> None:
        """Publish one state with the present time."""
        self._message.stamp(*divmod(time.time_ns(), NANO))
        # Within the limits and the speeds of the arm: the node refuses other states.
        self._message.numbers[:] = FR3.home + JITTER * random.random()
        self._states.publish(self._message.serialized())

    def spin(self, until: float) -> None:
        """Receive until a time of perf_counter."""
        while (left := until - time.perf_counter()) > 0.0:
            self._executor.spin_once(left)

    def connect(self) -> None:
        """Wait until the node answers."""
        deadline = time.perf_counter() + 60.0
        while not self.commands:
            if time.perf_counter() > deadline:
                raise RuntimeError('the node does not answer')
            self.send()
            self.spin(time.perf_counter() + 0.05)

    def drive(self, load: str, rate: int) -> Result:
        """Publish at a rate; states due while the driver is late are left out."""
        self.spin(time.perf_counter() + SETTLE)
        commands_before = self.commands
        lost = self.lost
        sent = 0
        began = due = time.perf_counter()
        while due - began < SECONDS:
            self.spin(due)
            self.send()
            sent += 1
            due = max(due + 1.0 / rate, time.perf_counter())
        reached = sent / (time.perf_counter() - began)
        self.spin(time.perf_counter() + REPORT)
        known = lost.isdigit() and self.lost.isdigit()
        return Result(load, rate, reached,
                      1.0 - (self.commands - commands_before) / sent,
                      str(int(self.lost) - int(lost)) if known else self.lost)


def table(results: list[Result]) -> str:
    """Return the results as Markdown, and the rates at which losses begin."""
    lines = ['| | rate, Hz | reached, Hz | without a command | lost by diagnostics |',
             '|---|---|---|---|---|']
    lines += [f'| {result.load} | {result.rate} | {result.reached:.0f} | '
              f'{result.unanswered:.2%} '
              f'| {result.reported} |' for result in results]
    for load in dict.fromkeys(result.load for result in results):
        first = next((result for result in results
                      if result.load == load and result.unanswered > BEGIN), None)
        lines.append(f'{load}: more than {BEGIN:.1%} lost ' + (
            f'from {first.rate} Hz on' if first
            else f'at no rate up to {results[-1].rate} Hz'))
    return '\n'.join(lines)


def main(*arguments: str) -> int:
    """Print the losses at each rate; return 1 if the gate does not hold."""
    load = os.getloadavg()[0]
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    os.environ.setdefault('ROS_DOMAIN_ID', str(random.SystemRandom().randint(1, 100)))
    rclpy.init()
    is_native = NATIVE in arguments
    settings = list(REALTIME) if 'realtime' in arguments else []
    settings += ['-p', f'torque_path:={NATIVE if is_native else "python"}']
    rates = NATIVE_RATES if is_native else RATES
    with contenders('fr3', [], *settings) as loader:
        assert loader.stdin is not None
        assert loader.stdout is not None
        loader.stdout.readline()
        driver = Driver()
        driver.connect()
        results = []
        for which in (IDLE, BUSY):
            results += [driver.drive(which, rate) for rate in rates]
            loader.stdin.write('\n')  # the simulations begin, or end
            loader.stdin.flush()
        driver.destroy_node()
    rclpy.shutdown()
    print(
        f'Joint states of {len(FR3.joints)} joints, {SECONDS:g} s at each rate; '
        f'load of the machine before {load:.2f}\n\n{table(results)}')
    judged = results[:1]
    largest_loss = MOST_LOST
    if is_native:
        judged = results
        largest_loss = BEGIN
    failed = [result for result in judged if not result.unanswered < largest_loss]
    for result in failed:
        print(
            f'FAILED: {result.unanswered:.2%} lost at {result.rate} Hz, {result.load}; '
            f'expected less than {largest_loss:.1%}')
    return exit_status(not failed)


if __name__ == '__main__':
    sys.exit(main(*sys.argv[1:]))
