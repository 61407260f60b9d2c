"""
Batches on a GPU compared with this library's batches on all processors of the host.

A million states of the FR3, seven axes. Results are compared with those of the
processors first. Times of a kernel are those of the device's events, over several
launches after a warm-up, without transfers and without the work of Python in a call,
which may take longer. That of a call, until its result is there, and those of the
processors are of the wall clock. Without a device, this says so and measures nothing.
`--record` writes the table to a file beside this program, named by the device.
"""

import argparse
from collections.abc import Callable, Sequence
from ctypes import byref, c_float, c_void_p
import os
from pathlib import Path
import re
import statistics
import sys
import time
from typing import Any
from unittest import mock

from kane_dynamics import DeviceError, gpu, load_urdf, Robot, simulate
from kane_dynamics._util.resources import resource_path
from kane_dynamics._util.typing import Array
from kane_dynamics.gpu.cuda_driver import Driver, driver
from kane_dynamics.gpu.device_arrays import DeviceMemory
from kane_dynamics.gpu.dlpack import contiguous
import numpy as np

STATES = 1_000_000
HORIZON = 100
LAUNCHES = 20
ROUNDS = 5
GATE = 20.0  # least ratio of the time on the processors to that on the device
TOLERANCE = {'float64': 1e-12, 'float32': 1e-4}  # of the largest entry
QUANTITIES = ('inverse_dynamics', 'forward_dynamics', 'mass_matrix',
              'inverse_dynamics_derivatives')
Row = tuple[str, float, float, float]
COALESCED = 'coalesced'
ROWS = 'one state after the other'


def on_device(cuda: Driver, array: Array, dtype: str, layout: str) -> DeviceMemory:
    """Return a copy of an array of states on device 0."""
    x = array.astype(dtype)
    count = len(x)
    strides = contiguous(x.shape)
    if layout == COALESCED:
        inner = contiguous(x.shape[1:])
        x = np.moveaxis(x, 0, -1)
        strides = (1, *(count * stride for stride in inner))
    x = np.ascontiguousarray(x)
    with cuda.on(0):
        memory = DeviceMemory(cuda, 0, array.shape, strides, dtype)
        cuda.call('cuMemcpyHtoD_v2', memory.__cuda_array_interface__['data'][0],
                  x.ctypes.data, x.nbytes)
    return memory


def on_host(cuda: Driver, memory: DeviceMemory, layout: str) -> Array:
    """Return the content of a result as an array."""
    interface = memory.__cuda_array_interface__
    count, *inner = memory.shape
    stored = (*inner, count) if layout == COALESCED else memory.shape
    stored_array = np.empty(stored, dtype=interface['typestr'])
    with cuda.on(0):
        cuda.call('cuMemcpyDtoH_v2', stored_array.ctypes.data, interface['data'][0],
                  stored_array.nbytes)
    return np.moveaxis(stored_array, -1, 0) if layout == COALESCED else stored_array


def device_times(
        cuda: Driver, call: Callable[[], Any], launches: int) -> tuple[float, float]:
    """Return the time of one launch by events of the device, and of a whole call, s."""
    with mock.patch.object(cuda, 'launch') as launch:
        call()
    arguments_of_launch = launch.call_args.args

    def finished() -> None:
        call()
        with cuda.on(0):
            cuda.synchronize(0)
    whole = host_time(finished)
    with cuda.on(0):
        events = [c_void_p() for _ in range(2)]
        for event in events:
            cuda.call('cuEventCreate', byref(event), 0)
        times = []
        for _ in range(1 + ROUNDS):
            cuda.call('cuEventRecord', events[0], 0)
            for _ in range(launches):
                cuda.launch(*arguments_of_launch)
            cuda.call('cuEventRecord', events[1], 0)
            cuda.call('cuEventSynchronize', events[1])
            ms = c_float()
            cuda.call('cuEventElapsedTime', byref(ms), *events)
            times.append(1e-3 * ms.value / launches)
        for event in events:
            cuda.call('cuEventDestroy_v2', event)
    return statistics.median(times[1:]), whole


def host_time(call: Callable[[], Any]) -> float:
    """Return the time of a call on the processors, s."""
    call()
    times = []
    for _ in range(ROUNDS):
        began = time.perf_counter()
        call()
        times.append(time.perf_counter() - began)
    return statistics.median(times)


def require_equal(name: str, found: Array, expected: Array, dtype: str) -> None:
    """Raise ValueError unless results agree."""
    error = np.abs(found - expected).max() / np.abs(expected).max()
    if not error <= TOLERANCE[dtype]:
        raise ValueError(
            f'{name}: error {error:.1e} of the largest entry; expected at most '
            f'{TOLERANCE[dtype]:.0e}')


def rows(cuda: Driver, robot: Robot, states: Sequence[Array]) -> list[Row]:
    """Return what is measured: its name, the times of kernel, call and processors, s."""
    lines = []
    for name in QUANTITIES:
        given = states[:1] if name == 'mass_matrix' else states
        method = getattr(robot, name)
        few = [x[:1000] for x in given]
        expected = np.asarray(method(*few))
        if name == 'inverse_dynamics_derivatives':
            expected = np.moveaxis(expected, 0, 1)
        host = host_time(lambda method=method, given=given: method(*given))
        for dtype in TOLERANCE:
            for layout in (COALESCED, ROWS):
                function = gpu.function(robot, name, dtype=dtype)
                require_equal(name, on_host(cuda, function(*(
                    on_device(cuda, x, dtype, layout) for x in few)), layout), expected,
                              dtype)
                arrays = [on_device(cuda, x, dtype, layout) for x in given]
                out = function(*arrays)

                def call(function: Any = function, arrays: Any = arrays,
                         out: Any = out) -> None:
                    function(*arrays, out=out, stream=0)
                lines.append((f'{name}, {dtype}, {layout}',
                              *device_times(cuda, call, LAUNCHES), host))
    return lines


def rollout_rows(cuda: Driver, robot: Robot, states: Sequence[Array]) -> list[Row]:
    """Return, as `rows`, Runge-Kutta steps of all states, to the last one."""
    lines = []
    program = robot.forward_dynamics
    # The dynamics of all stages alone.
    host = 4 * HORIZON * host_time(lambda: program(*states))
    few = [x[:1000] for x in states]
    end = simulate(robot, few[0], few[1], 1e-3 * HORIZON, torque=np.repeat(
        few[2][:, None], HORIZON, axis=1), sample=1e-3 * HORIZON)
    expected = np.concatenate([end.q, end.u], axis=2)[:, -1]
    for dtype in TOLERANCE:
        motion = gpu.rollout(robot, dtype=dtype)
        require_equal('rollout', on_host(cuda, motion(*(
            on_device(cuda, x, dtype, COALESCED) for x in few), h=1e-3, steps=HORIZON,
            every_step=False), COALESCED), expected, dtype)
        arrays = [on_device(cuda, x, dtype, COALESCED) for x in states]
        out = motion(*arrays, h=1e-3, steps=HORIZON, every_step=False)

        def call(motion: Any = motion, arrays: Any = arrays, out: Any = out) -> None:
            motion(*arrays, h=1e-3, steps=HORIZON, every_step=False, out=out, stream=0)
        lines.append((f'{HORIZON} steps of Runge-Kutta, {dtype}, {COALESCED}',
                      *device_times(cuda, call, 1), host))
    return lines


def main() -> int:
    """Print the table; return 1 if the gate does not hold."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--record', action='store_true',
                        help='write the table to a file')
    record = parser.parse_args().record
    try:
        cuda = driver()
        device = cuda.devices[0] if cuda.devices else None
    except DeviceError as error:
        print(f'NOT RUN: {error}')
        return 0
    if device is None:
        print('NOT RUN: the driver lists no device')
        return 0
    robot = Robot(load_urdf(resource_path('urdf', 'fr3.urdf'), tip='fr3_link7'))
    states = np.random.default_rng(0).normal(size=(3, STATES, 7))
    measured = rows(cuda, robot, states) + rollout_rows(cuda, robot, states)
    title = (f'{STATES} states of the FR3 on {device}, against '
             f'{len(os.sched_getaffinity(0))} processors of its host (of the steps: '
             'against four forward dynamics each)')
    lines = [title, '', '| | kernel, ms | call, ms | host, ms | host / kernel |',
             '|---|---|---|---|---|']
    lines += [f'| {name} | {1e3 * ours:.3f} | {1e3 * call:.3f} | {1e3 * there:.1f} | '
              f'{there / ours:.0f} |' for name, ours, call, there in measured]
    print('\n'.join(lines))
    if record:
        file = Path(__file__).with_name(f'gpu_{re.sub("[^A-Za-z0-9]+", "_", device)}.md')
        file.write_text('\n'.join([*lines, '']), encoding='utf-8')
        print(f'written to {file}')
    ratio = next(there / ours for name, ours, _, there in measured
                 if name == f'inverse_dynamics, float64, {COALESCED}')
    if ratio < GATE:
        print(f'FAILED: inverse dynamics {ratio:.1f} times as fast as on the host; '
              f'expected {GATE:g}')
    return int(ratio < GATE)


if __name__ == '__main__':
    sys.exit(main())
