"""Largest torques, speeds, powers and accelerations in quintic segments, by one traced kernel."""

from collections.abc import Sequence
from typing import Any

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.native.runtime.argument import Argument
from kane_dynamics.native.runtime.batch_loop import run_batch, Strided
from kane_dynamics.native.runtime.kernel import Kernel
from kane_dynamics.native.tracing.program import trace_program
from kane_dynamics.robot.robot import Robot
import numpy as np

QUANTITIES = ('effort', 'velocity', 'power', 'acceleration')


def peaks_kernel(robot: Robot, names: Sequence[str]) -> Kernel:
    """
    Return the kernel of some of `QUANTITIES`, (len(names), n), at a place of a segment.

    Its arguments are the coefficients (6, n) of the positions as polynomials in x from 0 to 1,
    the reciprocal duration of the segment, 1/s, and x.
    """
    name, block = '_'.join(('peaks', *names)), robot.parameters.block
    inputs: list[tuple[str, tuple[int, ...]]] = [('coefficients', (6, robot.n)), ('rate', ()),
                                                 ('x', ())]

    def values(coefficients: Any, rate: Any, x: Any, parameters: Any) -> Any:
        power, rate, x = np.arange(6.0)[:, None], rate[()], x[()]
        first = (power * coefficients)[1:]
        state = [_polynomial(rows, x) for rows in (coefficients, first,
                                                   (power[:5] * first)[1:])]
        u, udot = rate * state[1], rate * rate * state[2]
        tau = robot.equations.inverse_dynamics(state[0], u, udot, None, parameters)
        found = {'effort': tau, 'velocity': u, 'power': tau * u, 'acceleration': udot}
        return np.array([found[name] for name in names])
    return robot.kernels.extra(
        name, lambda: trace_program(name, values, [*inputs, ('parameters', block.shape)]),
        [Argument(*each) for each in inputs], block, (len(names), robot.n))


def _polynomial(coefficients: Any, x: Any) -> Any:
    """Return the value of polynomials at x."""
    value = coefficients[-1]
    for each in coefficients[-2::-1]:
        value = value * x + each
    return value


def segment_peaks(robot: Robot, names: Sequence[str], coefficients: Array, durations: Array,
                  x: Array) -> tuple[Array, Array]:
    """
    Return the largest absolute values in segments and their ranges, (len(names), S, n).

    Parameters
    ----------
    robot : Robot
        A robot in joint rates.
    names : sequence of str
        Some of `QUANTITIES`.
    coefficients : (S, 6, n) array
        Of the positions, as polynomials in x from 0 to 1.
    durations : (S,) array
        Durations of the segments, s.
    x : (m,) array
        Places in every segment at which the values are computed.

    """
    kernel, count = peaks_kernel(robot, names), len(durations)
    shape, rates = (count, len(names) * robot.n), 1.0 / durations
    low, high, result = np.full(shape, np.inf), np.full(shape, -np.inf), np.empty(shape)
    parameters = kernel.parameters.copy()
    rows = [Strided(coefficients.ctypes.data, coefficients.strides[0]),
            Strided(rates.ctypes.data, rates.strides[0]),
            Strided(x.ctypes.data, 0, x.strides[0]), Strided(parameters.ctypes.data),
            Strided(result.ctypes.data, result.strides[0])]
    if run_batch(kernel.lane_address, rows, count, steps=len(x), extremes=(low, high)):
        raise InputError('path: the torques along it are not finite; expected a path with '
                         'finite torques')
    largest, ranges = (np.ascontiguousarray(values.reshape(
        count, len(names), robot.n).swapaxes(0, 1))
        for values in (np.maximum(high, -low), high - low))
    return largest, ranges
