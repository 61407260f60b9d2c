"""The native kernels of a horizon: its step with feedback, its derivatives, the backward pass."""

from collections.abc import Callable
from functools import partial
from typing import Any

from kane_dynamics.mechanics.integrators.implicit_friction import (implicit_friction_slopes,
                                                                   implicit_friction_step)
from kane_dynamics.native.runtime.argument import Argument
from kane_dynamics.native.runtime.batch_loop import run_batch, Strided
from kane_dynamics.native.runtime.kernel import Kernel
from kane_dynamics.native.runtime.loop_support import repeat
from kane_dynamics.native.runtime.threads import run_concurrently
from kane_dynamics.native.tracing.program import Program, Shape, trace_program
from kane_dynamics.optimal_control.backward_step import backward_step, clipped
from kane_dynamics.optimal_control.stage_cost import cost_slopes, Limits, stage_cost
from kane_dynamics.robot.robot import Robot
import numpy as np

NUMBERS = 3  # at the beginning of the constants: interval, scale of the step, regularization

ARRAYS = ('path', 'trial', 'targets', 'weights', 'slopes', 'policy', 'constants')


class HorizonKernels:
    """
    Kernels of a robot, and the arrays of a horizon on which they work.

    Parameters
    ----------
    robot : Robot
        A tree of rigid bodies with joint rates.
    nodes : int
        Number of intervals, N.

    Attributes
    ----------
    path, trial : (N + 1, 3 n + 1) arrays
        Rows of q, u, the torque of the interval before, and the cost so far.
    targets, weights : (N, 3 n) arrays
        Of q and u at the end of an interval, and of its torque.
    slopes : (N, 3, n, n) array
        Derivatives of udot by q, u and tau.
    policy : (N + 1, ...) array
        Rows of `backward_step.Policy`; its changes of cost are sums up to the end.
    constants : array
        Length of an interval, scale of the step, regularization, limits, and the robot's
        parameters.

    """

    def __init__(self, robot: Robot, nodes: int) -> None:
        """Trace and compile the kernels, or load them from the cache."""
        n = self.n = robot.n
        self.nodes = nodes
        self._equations: Any = robot.equations
        self.path, self.trial = np.zeros((2, nodes + 1, 3 * n + 1))
        self.targets, self.weights = np.zeros((2, nodes, 3 * n))
        self.slopes = np.zeros((nodes, 3, n, n))
        self.policy_parts = np.cumsum([n, 2 * n * n, 1, 1, 2 * n])
        self.policy = np.zeros((nodes + 1, int(self.policy_parts[-1]) + n * (2 * n + 1)))
        self.constants = np.zeros(NUMBERS + 3 * n + len(robot.parameters.block))
        self._places = {name: (array.ctypes.data, array.strides[0] if array.ndim > 1 else 0)
                        for name in ARRAYS for array in [getattr(self, name)]}
        shapes: dict[str, Shape] = {
            'state': (2 * n,), 'tau': (n,), 'slopes': (3, n, n), 'row': (3 * n + 1,),
            'nominal': (2 * n,), 'policy': (self.policy.shape[1],), 'target': (3 * n,),
            'weight': (3 * n,), 'constants': self.constants.shape}
        made: dict[str, Kernel] = {}

        def make(name: str, function: Callable[..., Any], inputs: str, shape: Shape) -> None:
            given = [(key, shapes[key]) for key in [*inputs.split(), 'constants']]
            made[name] = robot.kernels.extra(
                name, lambda: _program(name, function, given),
                [Argument(*each) for each in given[:-1]], np.zeros(shapes['constants']), shape)
            if name == 'horizon_slopes':
                made[name].compile_lanes()
        run_concurrently([partial(make, *each) for each in (
            ('horizon_slopes', self._slopes_of, 'state tau', (3, n, n)),
            ('horizon_policy', self._policy_of, 'slopes state tau target weight policy',
             (self.policy.shape[1],)),
            ('horizon_step', self._step_of, 'row nominal tau policy target weight',
             (3 * n + 1,)))])
        self._kernels = made

    def _limits(self, constants: Any) -> tuple[Limits, Any]:
        n = self.n
        torque, speed, weight, parameters = np.split(
            constants[NUMBERS:], [n, 2 * n, 3 * n])
        return Limits(torque, speed, weight), parameters

    def _slopes_of(self, state: Any, tau: Any, constants: Any) -> Any:
        return implicit_friction_slopes(self._equations, state[:self.n], state[self.n:], tau,
                                        constants[0], self._limits(constants)[1])

    def _policy_of(self, slopes: Any, state: Any, tau: Any, target: Any, weight: Any,
                   after: Any, constants: Any) -> Any:
        limits = self._limits(constants)[0]
        gradient, hessian = cost_slopes(state, tau, target, weight, limits)
        _, _, first, second, v, V = np.split(after, self.policy_parts)
        regular = constants[2] * hessian[2 * self.n:]
        found = backward_step(slopes, tau, constants[0], gradient, hessian, regular, limits, v, V)
        found = found._replace(first=first[0] + found.first, second=second[0] + found.second)
        return np.concatenate([np.ravel(part) for part in found])

    def _step_of(self, row: Any, nominal: Any, tau: Any, policy: Any, target: Any, weight: Any,
                 constants: Any) -> Any:
        n = self.n
        limits, parameters = self._limits(constants)
        k, K = policy[:n], policy[n:n + 2 * n * n].reshape(n, 2 * n)
        wanted = tau + constants[1] * k + K @ (row[:2 * n] - nominal)
        tau = np.array([clipped(x, -most, most) for x, most in zip(wanted, limits.torque)])
        x = np.concatenate(implicit_friction_step(self._equations, row[:n], row[n:2 * n], tau,
                                                  constants[0], parameters))
        cost = row[-1] + stage_cost(x, tau, target, weight, limits)
        return np.concatenate([x, tau, [cost]])

    def linearize(self) -> None:
        """Write `slopes` of `path`."""
        (path, row), (tau, _) = self._place('path'), self._place('path', 1, 2 * self.n)
        slopes, size = self._place('slopes')
        run_batch(self._kernels['horizon_slopes'].lane_address, [
            Strided(path, row), Strided(tau, row), Strided(self._place('constants')[0]),
            Strided(slopes, size)], self.nodes)

    def backward(self, regularization: float) -> None:
        """
        Write `policy` for `path` and `slopes`, from the last interval to the first.

        The weight of a change of torque is `regularization` times that of the torque.
        """
        place, last = self._place, self.nodes - 1
        self.constants[2] = regularization
        self._repeat('horizon_policy', [
            place('slopes', last), place('path', last + 1), place('path', last + 1, 2 * self.n),
            place('targets', last), place('weights', last), place('policy', last + 1),
            place('constants'), place('policy', last)], -1)

    def forward(self, scale: float) -> None:
        """Write `trial`, from its first row on, by `policy` with this scale of k."""
        place = self._place
        self.constants[1] = scale
        self._repeat('horizon_step', [
            place('trial'), place('path'), place('path', 1, 2 * self.n), place('policy'),
            place('targets'), place('weights'), place('constants'), place('trial', 1)], 1)

    def _place(self, name: str, row: int = 0, column: int = 0) -> tuple[int, int]:
        """Return the address of an entry of an array, and the bytes from row to row."""
        address, stride = self._places[name]
        return address + row * stride + 8 * column, stride

    def _repeat(self, name: str, places: list[tuple[int, int]], direction: int) -> None:
        """Call a kernel for every interval, on rows that follow one another."""
        repeat(self._kernels[name].address, [address for address, _ in places],
               [direction * stride for _, stride in places], self.nodes)

    def expected(self) -> tuple[float, float]:
        """Return a, b: the policy at a scale s changes the cost by about s a + s^2 b."""
        at = int(self.policy_parts[1])
        first, second = self.policy[0, at:at + 2].tolist()  # sums up to the end
        return first, second

    def shift(self, intervals: float) -> None:
        """Move `path` and the gains of `policy` by a time in intervals; the end is repeated."""
        place = np.arange(self.nodes + 1) + intervals
        for rows, last in ((self.path[:, :2 * self.n], self.nodes),
                           (self.path[1:, 2 * self.n:-1], self.nodes - 1)):
            moved = np.minimum(place[:len(rows)], last)
            first = moved.astype(int)
            part = (moved - first)[:, None]
            rows[:] = (1.0 - part) * rows[first] + part * rows[np.minimum(first + 1, last)]
        self.policy[:-1] = self.policy[np.minimum(place[:-1].astype(int), self.nodes - 1)]

    def swap(self) -> None:
        """Exchange `path` and `trial`, which keep the same first row."""
        self.path, self.trial = self.trial, self.path
        places = self._places
        places['path'], places['trial'] = places['trial'], places['path']


def _program(name: str, function: Callable[..., Any],
             inputs: list[tuple[str, Shape]]) -> Program:
    """Trace a kernel."""
    return trace_program(name, function, inputs)
