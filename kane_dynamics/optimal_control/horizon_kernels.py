"""The native kernels of a horizon: its step with feedback, its derivatives, the backward pass."""

from collections.abc import Callable
from functools import partial
from typing import Any

from kane_dynamics.native.runtime.argument import Argument
from kane_dynamics.native.runtime.batch_loop import run_batch, Strided
from kane_dynamics.native.runtime.kernel import Kernel
from kane_dynamics.native.runtime.loop_support import repeat
from kane_dynamics.native.runtime.threads import run_concurrently
from kane_dynamics.native.tracing.program import Program, Shape, trace_program
from kane_dynamics.optimal_control.backward_step import clipped
from kane_dynamics.optimal_control.horizon_layout import constants_of, NUMBERS
from kane_dynamics.optimal_control.mechanism_horizon import MechanismHorizon
from kane_dynamics.optimal_control.tree_horizon import TreeHorizon
from kane_dynamics.robot.robot import Robot
import numpy as np

ARRAYS = ('path', 'trial', 'targets', 'weights', 'slopes', 'policy', 'constants')


class HorizonKernels:
    """
    Kernels of a robot, and the arrays of a horizon on which they work.

    Parameters
    ----------
    robot : Robot
    horizon : TreeHorizon or MechanismHorizon
        The functions to compile.
    nodes : int
        Number of intervals, N.

    Attributes
    ----------
    path, trial : (N + 1, ...) arrays
        Rows of the state, the torque of the interval before with what closes its loops, and the
        cost so far.
    targets, weights : (N, ...) arrays
        Of the state at the end of an interval, and of its torque.
    slopes : (N, ...) array
        Derivatives of each interval.
    policy : (N + 1, ...) array
        Rows of `backward_step.Policy`; its changes of cost are sums up to the end.
    constants : array
        Length of an interval, scale of the step, regularization, limits, and the robot's
        parameters.

    """

    def __init__(self, robot: Robot, horizon: TreeHorizon | MechanismHorizon,
                 nodes: int) -> None:
        """Trace and compile the kernels, or load them from the cache."""
        self._horizon: Any = horizon
        self.nodes, self._begun = nodes, False
        sizes = self.sizes = horizon.sizes
        self.path, self.trial = np.zeros((2, nodes + 1, sizes.row))
        self.targets = np.zeros((nodes, sizes.target))
        self.weights = np.zeros((nodes, 2 * sizes.joints + sizes.torques))
        self.slopes = np.zeros((nodes, sizes.slopes))
        self.policy = np.zeros((nodes + 1, sizes.policy))
        self.constants = np.zeros(NUMBERS + sizes.limits + len(robot.parameters.block))
        self._places = {name: (array.ctypes.data, array.strides[0] if array.ndim > 1 else 0)
                        for name in ARRAYS for array in [getattr(self, name)]}
        # Of an input of a kernel: the array, the row from that of the interval, the column, size.
        self._inputs: dict[str, tuple[str, int, int, int]] = {
            'row': ('trial', 0, 0, sizes.row), 'state': ('path', 0, 0, sizes.state),
            'after': ('path', 1, 0, sizes.row), 'end': ('path', 1, 0, sizes.state),
            'tau': ('path', 1, sizes.state, sizes.torques),
            'target': ('targets', 0, 0, sizes.target),
            'weight': ('weights', 0, 0, self.weights.shape[1]),
            'slopes': ('slopes', 0, 0, sizes.slopes), 'policy': ('policy', 0, 0, sizes.policy),
            'later': ('policy', 1, 0, sizes.policy),
            'constants': ('constants', 0, 0, len(self.constants))}
        self._kernels: dict[str, tuple[Kernel, list[str]]] = {}
        run_concurrently([partial(self._make, robot, *each) for each in (
            ('horizon_slopes', self._slopes_of, horizon.linearization, sizes.slopes),
            ('horizon_policy', self._policy_of, horizon.policy, sizes.policy),
            ('horizon_step', self._step_of, 'row state tau policy target weight', sizes.row))])

    def _make(self, robot: Robot, name: str, function: Callable[..., Any], inputs: str,
              size: int) -> None:
        """Compile a kernel with these inputs and the constants."""
        names = [*inputs.split(), 'constants']
        given: list[tuple[str, Shape]] = [(key, (self._inputs[key][-1],)) for key in names]
        kernel = robot.kernels.extra(
            name, lambda: _program(name, function, given),
            [Argument(*each) for each in given[:-1]], np.zeros(len(self.constants)), (size,))
        if name == 'horizon_slopes':
            kernel.compile_lanes()
        self._kernels[name] = kernel, names

    def _slopes_of(self, *inputs: Any) -> Any:
        *given, block = inputs
        return np.ravel(self._horizon.slopes_of(*given, constants_of(block, self.sizes)))

    def _policy_of(self, *inputs: Any) -> Any:
        *given, later, block = inputs
        _, _, first, second, v, V = np.split(later, self.sizes.policy_parts)
        found = self._horizon.policy_of(*given, v, V, constants_of(block, self.sizes))
        found = found._replace(first=first[0] + found.first, second=second[0] + found.second)
        return np.concatenate([np.ravel(part) for part in found])

    def _step_of(self, row: Any, nominal: Any, tau: Any, policy: Any, target: Any, weight: Any,
                 block: Any) -> Any:
        sizes, constants = self.sizes, constants_of(block, self.sizes)
        x, m = sizes.directions, sizes.torques
        state = row[:sizes.state]
        k, K = policy[:m], policy[m:m + m * x].reshape(m, x)
        wanted = tau + constants.scale * k + K @ self._horizon.change(state, nominal)
        lowest, highest, *_ = constants.limits
        tau = np.array([clipped(*each) for each in zip(wanted, lowest, highest)])
        end, multipliers, cost = self._horizon.step(state, tau, target, weight, constants)
        return np.concatenate([end, tau, multipliers, [row[-1] + cost]])

    def begin(self, state: Any) -> None:
        """Set the state at the beginning."""
        if not self._begun:  # changes from the nominal path must be finite
            self.path[:, :self.sizes.state] = state
            self._begun = True
        for path in (self.path, self.trial):
            path[0, :self.sizes.state] = state

    def forget(self) -> None:
        """Discard feedback and nominal states, which may be too far from the state to begin at."""
        self._begun = False
        self.policy[:] = 0.0

    def linearize(self) -> None:
        """Write `slopes` of `path`."""
        kernel, inputs = self._kernels['horizon_slopes']
        run_batch(kernel.lane_address, [
            Strided(*self._of_input(name, 0)) for name in [*inputs, 'slopes']], self.nodes)

    def backward(self, regularization: float) -> None:
        """
        Write `policy` for `path` and `slopes`, from the last interval to the first.

        The weight of a change of torque is `regularization` times that of the torque.
        """
        self.constants[2] = regularization
        self._repeat('horizon_policy', self._place('policy', self.nodes - 1), -1)

    def forward(self, scale: float) -> None:
        """Write `trial`, from its first row on, by `policy` with this scale of k."""
        self.constants[1] = scale
        self._repeat('horizon_step', self._place('trial', 1), 1)

    def _place(self, name: str, row: int = 0, column: int = 0) -> tuple[int, int]:
        """Return the address of an entry of an array, and the bytes from row to row."""
        address, stride = self._places[name]
        return address + row * stride + 8 * column, stride

    def _of_input(self, name: str, interval: int) -> tuple[int, int]:
        """Return the place of an input of a kernel."""
        array, row, column, _ = self._inputs[name]
        return self._place(array, interval + row, column)

    def _repeat(self, name: str, result: tuple[int, int], direction: int) -> None:
        """Call a kernel for every interval, on rows that follow one another."""
        kernel, inputs = self._kernels[name]
        places = [*(self._of_input(key, 0 if direction > 0 else self.nodes - 1)
                    for key in inputs), result]
        repeat(kernel.address, [address for address, _ in places],
               [direction * stride for _, stride in places], self.nodes)

    def expected(self) -> tuple[float, float]:
        """Return a, b: the policy at a scale s changes the cost by about s a + s^2 b."""
        at = int(self.sizes.policy_parts[1])
        first, second = self.policy[0, at:at + 2].tolist()  # sums up to the end
        return first, second

    @property
    def tau(self) -> Any:
        """Return the torques of `path`, (N, m): a view."""
        return self.path[1:, self.sizes.state:self.sizes.state + self.sizes.torques]

    @property
    def gains(self) -> Any:
        """Return the feedback of `policy`, (N, m, n_x)."""
        x, m = self.sizes.directions, self.sizes.torques
        return self.policy[:-1, m:m + m * x].reshape(-1, m, x).copy()

    def shift(self, intervals: float) -> None:
        """Move `path` and the gains of `policy` by a time in intervals; the end is repeated."""
        place = np.arange(self.nodes + 1) + intervals
        for rows, last in ((self.path[:, :self.sizes.state], self.nodes),
                           (self.tau, self.nodes - 1)):
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
