"""
The torque path's own computation: a serialized joint state in, serialized torques out.

The node's torque path runs without DDS: its publishers only keep the bytes. A seven-axis
arm follows a motion in mode computed_torque. Two processes, one with the real-time
settings of the node (realtime.priority, lock_memory) and one without,
alternate in blocks; the machine should be idle otherwise. Each cycle is timed from the
call with the bytes of the state to its return, after both messages are published. The
path pauses for a fifth of the time, because Linux suspends SCHED_FIFO threads for 50 ms
if they leave others less than that in a second. The cycle after a pause has cold caches,
as every cycle at the rates of an arm; these cycles are listed separately too.

With `--native` the native path is measured, in one process: blocks of its cycles
alternate with blocks of the same loop without a cycle, which shows what of the tail is
the machine's: a pause of the machine strikes both alike, so both loops run for the same
time, in which the loop without a cycle makes many more turns. The histograms of both are
printed, and drawn with `--picture FILE`. With `--beside-compilers` a process on each
processor compiles meanwhile.

Memory in steady state: what Python's allocator and the C heap hold after many cycles and
did not hold before. The gate: nothing.
"""

import argparse
from array import array
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
import ctypes
import gc
import json
import os
from pathlib import Path
import resource
import subprocess
import sys
import time
import tracemalloc
from typing import Any

from kane_dynamics import load_urdf, Motion
from kane_dynamics._util.resources import resource_path
from kane_dynamics.ros.common import realtime
from kane_dynamics.ros.common.cdr import PreparedMessage, write_joint_state
from kane_dynamics.ros.common.configuration_files import load_model
from kane_dynamics.ros.common.conversion import NANO
from kane_dynamics.ros.common.node_statistics import Statistics
from kane_dynamics.ros.common.rcl_functions import _library, handle_address
from kane_dynamics.ros.parameters.parameter_checks import read
from kane_dynamics.ros.parameters.parameter_table import CONSTANTS, SPECS
from kane_dynamics.ros.torque_path.native_loop import function_address
from kane_dynamics.ros.torque_path.path_controller import path_controller
from kane_dynamics.ros.torque_path.torque_path import TorquePath
import numpy as np
from rclpy.clock import Clock, ClockType

URDF = resource_path('urdf', 'fr3.urdf')
OFF = 'realtime.* off'
ON = 'realtime.* on'
REALTIME = {'realtime.priority': 50, 'realtime.lock_memory': True}
CYCLES = 10_000_000
BLOCK = 100_000  # cycles of one process before the other runs
# Cycles between two pauses; s.
BURST = 250
PAUSE = 2e-3
STATES = 1024    # different joint states
WARM_UP = 5_000  # cycles
STEADY = 100_000  # cycles between two readings of the memory in use
BLOCKS = 'blocks of Python'
BYTES = 'bytes of the C heap'
PERCENTILES = (50.0, 90.0, 99.0, 99.9, 99.99, 99.999, 100.0)
# Of the native path.
WORK = 'cycles'
NO_WORK = 'the same loop without a cycle'
CHUNK = 1000  # cycles of one call, whose reports fit the ring
LONG_CHUNK = 15 * CHUNK  # the same time without a cycle, which reports nothing
TURN = 100  # chunks of cycles before the same time without
EDGES = np.geomspace(10.0, 1e9, 801)  # ns, of the bins of histograms
STARTING = 3.0  # s, for compilers
COMPILER = """
import os
os.environ['KANE_DYNAMICS_CACHE'] = 'off'
from kane_dynamics import load_urdf, Robot
while True:
    Robot(load_urdf({urdf!r})).compile('inverse_dynamics', 'forward_dynamics')
"""
DECADES = (1e3, 2e3, 5e3, 1e4, 1e5, 5e5, 1e6, 1e7)  # ns


class Sink:
    """Stands for a publisher: keeps the bytes."""

    def __init__(self) -> None:
        self.data = b''

    def publish(self, data: bytes) -> None:
        """Keep one serialized message."""
        self.data = data


class Rig:
    """
    The torque path of the node with its states and its results.

    Parameters
    ----------
    settings : str
        OFF or ON.
    cycles : int
        Number of cycles that will be timed.

    """

    def __init__(self, settings: str, cycles: int) -> None:
        joints = tuple(n for n in load_urdf(URDF).joint_names if 'finger' not in n)
        # So do the torques; N m/s, checked as any other limit.
        values = CONSTANTS | {spec.name: read(spec, spec.default) for spec in SPECS} | {
            'mode': 'computed_torque', 'joints': joints, 'state_timeout': 5.0,
            'arm_compensates': ('none',), 'state_check.noise': 1.0,
            'state_check.position_margin': 1.0,  # the states jump
            'limits.rate': np.array(1e9)}
        values |= REALTIME if settings == ON else {}
        controller = path_controller(load_model(URDF, values, _ignore), values)
        controller.compile()
        self.statistics, self.commands, self.torques = Statistics(), Sink(), Sink()
        self.path = TorquePath(controller, self.commands, self.torques, time.time_ns,
                               values, self.statistics, _refuse)
        rng = np.random.default_rng(0)
        n = len(joints)
        pose = controller.robot.neutral() + 0.2
        self.motion = Motion.from_points(
            np.arange(1.0, 11.0), pose + rng.uniform(-0.05, 0.05, (10, n)),
            joint_names=joints)
        self._states = pose + rng.uniform(-0.05, 0.05, (STATES, n))
        self._speeds = rng.uniform(-0.1, 0.1, (STATES, n))
        writer, (positions, velocities, _) = write_joint_state(joints, '', (n, n, n))
        self._message = PreparedMessage(writer, positions, n)
        self._velocities = self._message.doubles(velocities, n)
        self.took = array('L', bytes(array('L').itemsize * cycles))  # ns
        self.done = 0
        self.refused: list[str] = []
        self.path.start()
        gc.collect()
        gc.freeze()  # as the node does
        realtime.apply_realtime_settings(values, self.refused.append)
        if cycles:
            self.run(WARM_UP, timed=False)

    def message(self) -> bytes:
        """Return the first state, with the present time."""
        self._message.numbers[:] = self._states[0]
        self._velocities[:] = self._speeds[0]
        self._message.stamp(*divmod(time.time_ns(), NANO))
        return self._message.serialized()

    def run(self, count: int, *, timed: bool = True) -> None:
        """Run `count` cycles along the motion from its beginning."""
        now = time.time_ns()
        assert self.path.active_motion.follow(self.motion, now, now,
                                              self.path.active_motion.generation)
        self.go_on(count, timed=timed)

    def go_on(self, count: int, *, timed: bool = False) -> None:
        """Run `count` cycles along the motion that was begun."""
        for begin in range(0, count, BURST):
            time.sleep(PAUSE)
            self._burst(min(BURST, count - begin), timed)

    def _burst(self, count: int, timed: bool) -> None:
        message = self._message
        velocities = self._velocities
        took = self.took
        first = self.done
        on_state = self.path.on_state
        clock = time.perf_counter_ns
        for k in range(count):
            message.numbers[:] = self._states[(first + k) % STATES]
            velocities[:] = self._speeds[(first + k) % STATES]
            message.stamp(*divmod(time.time_ns(), NANO))
            data = message.serialized()
            began = clock()
            on_state(data)
            ended = clock()
            if timed:
                took[first + k] = ended - began
        self.done += timed * count


class HeapUse(ctypes.Structure):
    """The struct mallinfo2 of glibc."""

    _fields_ = [(name, ctypes.c_size_t) for name in (
        'arena', 'ordblks', 'smblks', 'hblks', 'hblkhd', 'usmblks', 'fsmblks',
        'uordblks', 'fordblks', 'keepcost')]


C_LIBRARY = ctypes.CDLL(None)
C_LIBRARY.mallinfo2.restype = HeapUse


def _ignore(warning: str) -> None:
    """Ignore a warning about the URDF."""


def _refuse(reason: str, detail: str) -> None:
    raise RuntimeError(f'joint state dropped: {reason}: {detail}')


def memory_in_use() -> dict[str, int]:
    """Return what this process holds and counts of events that allocations cause."""
    heap = C_LIBRARY.mallinfo2()
    return {BLOCKS: sys.getallocatedblocks(),
            BYTES: heap.uordblks + heap.hblkhd,
            'page faults': resource.getrusage(resource.RUSAGE_SELF).ru_minflt,
            'garbage collections': sum(generation['collections']
                                       for generation in gc.get_stats())}


def stolen() -> float:
    """Return how long other virtual machines had this machine's processors so far, s."""
    ticks = Path('/proc/stat').read_text(encoding='utf-8').splitlines()[0].split()[8]
    return int(ticks) / os.sysconf('SC_CLK_TCK')


def steady_memory(rig: Rig, cycles: int = STEADY) -> dict[str, int]:
    """
    Return the increase of each figure of `memory_in_use` over some cycles.

    As many cycles and two readings come before: Python keeps what it once needed for
    short-lived numbers, of clamped torques too, and the readings' own memory is not
    counted.
    """
    rig.run(1, timed=False)
    for count in (cycles, 1, cycles):
        memory_before = memory_in_use()
        rig.go_on(count)
        memory_after = memory_in_use()
    return {name: memory_after[name] - memory_before[name] for name in memory_before}


def transient_memory(rig: Rig) -> int:
    """Return the largest number of bytes one cycle holds for a time, with its state."""
    tracemalloc.start()
    try:
        rig.run(BURST, timed=False)
        memory_before = tracemalloc.get_traced_memory()[0]
        tracemalloc.reset_peak()
        rig.run(BURST, timed=False)
        return tracemalloc.get_traced_memory()[1] - memory_before
    finally:
        tracemalloc.stop()


def serve(settings: str, cycles: int) -> None:
    """Run a block for each line of standard input; then print the results as JSON."""
    rig = Rig(settings, cycles)
    memory = steady_memory(rig)
    sent = rig.statistics.commands
    switched = resource.getrusage(resource.RUSAGE_SELF).ru_nivcsw
    collecting = taken = 0.0
    for line in sys.stdin:
        stolen_before = stolen()
        rig.run(int(line))
        taken += stolen() - stolen_before
        began = time.perf_counter()
        # In the node at each report, in the services' thread.
        realtime.collect_if_disabled()
        collecting = max(collecting, time.perf_counter() - began)
        print(flush=True)
    switched = resource.getrusage(resource.RUSAGE_SELF).ru_nivcsw - switched
    assert rig.statistics.commands - sent == rig.done == cycles
    took = np.array(rig.took)
    result = {'all': np.percentile(took, PERCENTILES).tolist(),
              'after a pause': np.percentile(took[::BURST], PERCENTILES).tolist(),
              'refused': rig.refused, 'memory': memory, 'preempted': switched,
              'stolen': taken,
              'collecting': collecting, 'transient': transient_memory(rig)}
    print(json.dumps(result))


def measure(cycles: int) -> dict[str, dict[str, Any]]:
    """Return the results of both settings, whose processes alternate."""
    running = {}
    for settings in (OFF, ON):
        running[settings] = subprocess.Popen(
            [sys.executable, __file__, '--cycles', str(cycles), '--settings', settings],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    try:
        for begin in range(0, cycles, BLOCK):
            for process in running.values():
                print(min(BLOCK, cycles - begin), file=process.stdin, flush=True)
                if not process.stdout.readline():
                    raise RuntimeError('the process of the torque path ended')
        return {settings: json.loads(process.communicate()[0])
                for settings, process in running.items()}
    finally:
        for process in running.values():
            process.kill()


def measure_native(settings: str, cycles: int) -> dict[str, np.ndarray]:
    """Return the histograms of the loop without Python, and of an empty one."""
    rig = Rig(settings, 0)
    path = rig.path
    clock = Clock(clock_type=ClockType.SYSTEM_TIME)
    path.native.publish_to(0, 0)
    now_function = ctypes.cast(_library('librcl').rcl_clock_get_now, ctypes.c_void_p)
    path.native.set_fields(clock=now_function.value, clock_handle=handle_address(clock),
                           steady=function_address(C_LIBRARY.clock_gettime))
    for _ in range(3):  # the layout is learned, and a first state is confirmed
        path.on_state(rig.message())
    now = time.time_ns()
    assert path.active_motion.follow(rig.motion, now, now, path.active_motion.generation)
    loop = path.native
    for _ in range(WARM_UP // CHUNK):
        loop.durations(rig.message(), CHUNK)
    histograms = {kind: np.zeros(len(EDGES) - 1, dtype=np.int64)
                  for kind in (WORK, NO_WORK)}
    spent = dict.fromkeys(histograms, 0)  # ns
    for begin in range(0, cycles, CHUNK * TURN):
        chunks = min(TURN, -(-(cycles - begin) // CHUNK))
        for _ in range(chunks):
            took = loop.durations(rig.message(), CHUNK)
            histograms[WORK] += np.histogram(took, EDGES)[0]
            spent[WORK] += int(took.sum())
        # Linux suspends real-time threads that never wait.
        time.sleep(PAUSE * chunks / 4)
        while spent[NO_WORK] < spent[WORK]:
            took = loop.durations(rig.message(), LONG_CHUNK, works=False)
            histograms[NO_WORK] += np.histogram(took, EDGES)[0]
            spent[NO_WORK] += int(took.sum())
        time.sleep(PAUSE * chunks / 4)
    path.read_reports()
    assert path.commanding and not path.fault, 'every state is answered'
    return histograms


@contextmanager
def compilers() -> Iterator[None]:
    """Let a process on each processor compile the kernels of a robot all the time."""
    running = [subprocess.Popen([sys.executable, '-c', COMPILER.format(urdf=str(URDF))])
               for _ in range(os.cpu_count() or 1)]
    try:
        time.sleep(STARTING)
        yield
        if any(process.poll() is not None for process in running):
            raise RuntimeError('a compiler ended')
    finally:
        for process in running:
            process.kill()
            process.wait()


def exceeded(histogram: np.ndarray, limit: float) -> int:
    """Return how many durations lie in bins from a limit on, ns."""
    return int(histogram[np.searchsorted(EDGES, limit) - 1:].sum())


def percentile(histogram: np.ndarray, share: float) -> float:
    """Return the upper edge of the bin with a percentile, ns."""
    counts = np.cumsum(histogram)
    return float(EDGES[1 + np.searchsorted(counts, share / 100.0 * counts[-1])])


def native_markdown(
        histograms: dict[str, np.ndarray], settings: str, load: float) -> str:
    """Return percentiles and numbers of long durations as Markdown, with the machine."""
    system = os.uname()
    machine = (f'{os.cpu_count()} processors, {system.sysname} {system.release} '
               f'{system.machine}; load before {load:.2f}')
    lines = [
        f'Native torque path, bytes to bytes, 7 joints, {settings}, us; {machine}', '',
        '| | number | ' + ' | '.join(f'p{p:g}' for p in PERCENTILES[:-1]) + ' | max |',
        '|---' * (2 + len(PERCENTILES)) + '|']
    for kind, histogram in histograms.items():
        row = [f'{percentile(histogram, p) / 1e3:.2f}' for p in PERCENTILES]
        lines.append(f'| {kind} | {histogram.sum()} | ' + ' | '.join(row) + ' |')
    lines += ['', '| longer than, us | ' + ' | '.join(histograms) + ' |',
              '|---|---|---|']
    for limit in DECADES:
        row = [str(exceeded(histogram, limit)) for histogram in histograms.values()]
        lines.append(f'| {limit / 1e3:g} | ' + ' | '.join(row) + ' |')
    return '\n'.join(lines)


def draw(histograms: dict[str, np.ndarray], file: Path) -> None:
    """Draw how many take longer than a time, in the same time, on logarithmic axes."""
    from matplotlib.figure import Figure
    figure = Figure(figsize=(7.0, 4.0), layout='constrained')
    axes = figure.subplots()
    for kind, histogram in histograms.items():
        longer = np.cumsum(histogram[::-1])[::-1]
        label = f'{kind}: {histogram.sum():,}'
        axes.loglog(EDGES[:-1][longer > 0] / 1e3, longer[longer > 0], label=label)
    axes.set_xlabel('time, us')
    axes.set_ylabel('number of longer ones, in equal times')
    axes.grid(True)
    axes.legend()
    figure.savefig(file)


def markdown(found: dict[str, dict[str, Any]], cycles: int, load: float) -> str:
    """Return the results as Markdown."""
    heads = [f'p{p:g}' for p in PERCENTILES[:-1]] + ['max']
    title = (
        f'Torque path, bytes to bytes, 7 joints, {cycles} cycles each, us; load of the '
        f'machine before {load:.2f}')
    lines = [title, '', '| | ' + ' | '.join(heads) + ' |',
             '|---' * (1 + len(heads)) + '|']
    for settings, result in found.items():
        for which in ('all', 'after a pause'):
            lines.append(f'| {settings}, {which} | ' + ' | '.join(
                f'{ns / 1e3:.1f}' for ns in result[which]) + ' |')
    lines.append('')
    for settings, result in found.items():
        lines += [f'{settings}: {warning}' for warning in result['refused']]
        lines.append(
            f'{settings}: memory held after {STEADY} cycles and not before: '
            + ', '.join(f'{count} {name}' for name, count in result['memory'].items())
            + f'; at most {result["transient"]} bytes during a cycle; '
            f'preempted {result["preempted"]} times, processors given to other virtual '
            f'machines for {result["stolen"]:.2f} s; a garbage collection between '
            f'blocks at most {result["collecting"] * 1e3:.2f} ms')
    return '\n'.join(lines)


def main() -> int:
    """Print both distributions; return 1 if the memory grows in steady state."""
    parser = argparse.ArgumentParser(description=__doc__.partition('.')[0])
    parser.add_argument('--cycles', type=int, default=CYCLES,
                        help='default: %(default)s')
    parser.add_argument('--settings', choices=(OFF, ON), help=argparse.SUPPRESS)
    parser.add_argument('--native', action='store_true', help='measure the native path')
    parser.add_argument('--realtime', action='store_true',
                        help='with --native: with realtime.*, which needs the rights')
    parser.add_argument('--beside-compilers', action='store_true',
                        help='with --native: while each processor compiles')
    parser.add_argument('--picture', type=Path,
                        help='with --native: draw the histograms')
    options = parser.parse_known_args()[0]  # some are for other benchmarks
    if options.settings:
        serve(options.settings, options.cycles)
        return 0
    load = os.getloadavg()[0]
    if options.native:
        settings = ON if options.realtime else OFF
        with compilers() if options.beside_compilers else nullcontext():
            histograms = measure_native(settings, options.cycles)
        if options.beside_compilers:
            settings += ', beside compilers on all processors'
        print(native_markdown(histograms, settings, load))
        if options.picture:
            draw(histograms, options.picture)
        return 0
    figures = measure(options.cycles)
    print(markdown(figures, options.cycles, load))
    grown = [settings for settings, result in figures.items()
             if any(result['memory'][what] > 0 for what in (BLOCKS, BYTES))]
    for settings in grown:
        print(f'FAILED: {settings}: memory grows in steady state')
    return 1 if grown else 0


if __name__ == '__main__':
    sys.exit(main())
