"""The native kernels of a horizon: step with feedback, derivatives, backward pass."""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

from kane_dynamics._util.typing import Array, Scalar, Vector
from kane_dynamics.native.runtime.kernel import Kernel
from kane_dynamics.native.runtime.threads import run_concurrently
from kane_dynamics.native.tracing.program import Shape
from kane_dynamics.optimal_control.backward_step import clipped_all
from kane_dynamics.optimal_control.horizon import constants_of, Horizon, NUMBERS
from kane_dynamics.robot.robot import Robot
import numpy as np


class Input(NamedTuple):
    """Entries of an array that a kernel reads; `row` is counted from that of the interval."""

    array: str
    row: int
    column: int
    size: int


class HorizonKernels:
    """
    Kernels of a robot, and the arrays of a horizon on which they work.

    Parameters
    ----------
    robot : Robot
    actuators : list of int
        Indices of the joints with actuators.
    nodes : int
        Number of intervals, N.

    Attributes
    ----------
    path, trial : (N + 1, ...) arrays
        Rows of the state, the torque of the interval before with what closes its loops,
        and the cost so far.
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

    def __init__(self, robot: Robot, actuators: list[int], nodes: int) -> None:
        """Trace and compile the kernels, or load them from the cache."""
        self._horizon = Horizon(robot, actuators)
        self.nodes = nodes
        self._begun = False
        sizes = self._horizon.sizes
        self.sizes = sizes
        # Two paths take turns as the nominal one and the trial.
        self.path = np.zeros((nodes + 1, sizes.row))
        self.trial = np.zeros((nodes + 1, sizes.row))
        self.targets = np.zeros((nodes, sizes.target))
        self.weights = np.zeros((nodes, 2 * sizes.joints + sizes.torques))
        self.slopes = np.zeros((nodes, sizes.slopes))
        self.policy = np.zeros((nodes + 1, sizes.policy))
        self.constants = np.zeros(NUMBERS + sizes.limits + len(robot.parameters.block))
        # What kernels read, by name: the array, the row relative to the current one, and
        # the columns.
        self._inputs = {
            'row': Input('trial', 0, 0, sizes.row),
            'state': Input('path', 0, 0, sizes.state),
            'after': Input('path', 1, 0, sizes.row),
            'tau': Input('path', 1, sizes.state, sizes.torques),
            'target': Input('targets', 0, 0, sizes.target),
            'weight': Input('weights', 0, 0, self.weights.shape[1]),
            'slopes': Input('slopes', 0, 0, sizes.slopes),
            'policy': Input('policy', 0, 0, sizes.policy),
            'later': Input('policy', 1, 0, sizes.policy)}
        self._rows = self._views(self.path, self.trial)
        self._swapped_rows = self._views(self.trial, self.path)
        self._kernels: dict[str, tuple[Kernel, list[str]]] = {}

        # Three kernels, compiled side by side: slopes along the path, the backward pass,
        # and a step of the trial.
        run_concurrently([
            partial(self._compile, robot, 'horizon_slopes', self._slopes,
                    'state after target weight', sizes.slopes),
            partial(self._compile, robot, 'horizon_policy', self._policy,
                    'slopes tau later', sizes.policy),
            partial(self._compile, robot, 'horizon_step', self._step,
                    'row state tau policy target weight', sizes.row)])

    def _compile(self, robot: Robot, name: str, function: Callable[..., Vector],
                 inputs: str, size: int) -> None:
        """Compile a kernel with these inputs and the constants."""
        names = inputs.split()
        shapes: dict[str, Shape] = {key: (self._inputs[key].size,) for key in names}
        kernel = robot.kernels.compiled(function, name, shapes, (size,),
                                        constants=self.constants.shape)
        if name == 'horizon_slopes':  # of all intervals at once
            kernel.compile_lanes()
        self._kernels[name] = kernel, names

    # The functions of the kernels, over any scalar.

    def _slopes(self, state: Vector, after: Vector, target: Vector, weight: Vector,
                constants: Vector) -> Vector:
        """Return the derivatives of an interval and of its cost."""
        return self._horizon.slopes_of(state, after, target, weight,
                                       constants_of(constants, self.sizes))

    def _policy(self, slopes: Vector, tau: Vector, later: Vector,
                constants: Vector) -> Vector:
        """Return the policy of an interval, with the changes of cost up to the end."""
        _, _, first, second, v, V = np.split(later, self.sizes.policy_parts)
        policy = self._horizon.policy_of(slopes, tau, v, V,
                                         constants_of(constants, self.sizes))
        policy = policy._replace(first=first[0] + policy.first,
                                 second=second[0] + policy.second)
        return np.concatenate([np.ravel(part) for part in policy])

    def _step(self, row: Vector, nominal: Vector, tau: Vector, policy: Vector,
              target: Vector, weight: Vector, constants: Vector) -> Vector:
        """Return the row of the path after a step with the torques of the policy."""
        sizes = self.sizes
        numbers = constants_of(constants, sizes)
        x = sizes.directions
        m = sizes.torques
        # tau + scale k + K (change of the state from the nominal one), within the
        # limits.
        state = row[:sizes.state]
        k = policy[:m]
        K = policy[m:m + m * x].reshape(m, x)
        feedback = K @ self._horizon.change(state, nominal)
        tau = clipped_all(tau + numbers.scale * k + feedback,
                          numbers.limits.lowest_torque, numbers.limits.highest_torque)
        end, multipliers, cost = self._horizon.step(state, tau, target, weight, numbers)
        total: Scalar = row[-1] + cost
        return np.concatenate([end, tau, multipliers, [total]])

    # What they do with the arrays.

    def begin(self, state: Array) -> None:
        """Set the state at the beginning."""
        if not self._begun:  # changes from the nominal path must be finite
            self.path[:, :self.sizes.state] = state
            self._begun = True
        for path in (self.path, self.trial):
            path[0, :self.sizes.state] = state

    def forget(self) -> None:
        """Discard feedback and nominal states, which may be far from the state."""
        self._begun = False
        self.policy[:] = 0.0

    def linearize(self) -> None:
        """Write `slopes` of `path`."""
        kernel, inputs = self._kernels['horizon_slopes']
        rows = [self._rows[name] for name in inputs]
        kernel.run(rows, self.slopes, self.nodes, constants=self.constants)

    def backward(self, regularization: float) -> None:
        """
        Write `policy` for `path` and `slopes`, from the last interval to the first.

        The weight of a change of torque is `regularization` times that of the torque.
        """
        self.constants[2] = regularization
        kernel, inputs = self._kernels['horizon_policy']
        rows = [self._rows[name] for name in inputs]
        kernel.scan(rows, self.policy[:-1], constants=self.constants, reverse=True)

    def forward(self, scale: float) -> None:
        """Write `trial`, from its first row on, by `policy` with this scale of k."""
        self.constants[1] = scale
        kernel, inputs = self._kernels['horizon_step']
        rows = [self._rows[name] for name in inputs]
        kernel.scan(rows, self.trial[1:], constants=self.constants)

    def _views(self, path: Array, trial: Array) -> dict[str, Array]:
        """Return the rows of the inputs of kernels, one for each interval."""
        arrays = {'path': path, 'trial': trial, 'targets': self.targets,
                  'weights': self.weights, 'slopes': self.slopes, 'policy': self.policy}
        views = {}
        for name, (array, row, column, size) in self._inputs.items():
            views[name] = arrays[array][row:row + self.nodes, column:column + size]
        return views

    def expected(self) -> tuple[float, float]:
        """Return a, b: the policy at a scale s changes the cost by about s a + s^2 b."""
        place = int(self.sizes.policy_parts[1])
        first, second = self.policy[0, place:place + 2].tolist()  # sums up to the end
        return first, second

    @property
    def tau(self) -> Array:
        """Return the torques of `path`, (N, m): a view."""
        first = self.sizes.state
        return self.path[1:, first:first + self.sizes.torques]

    @property
    def gains(self) -> Array:
        """Return the feedback of `policy`, (N, m, n_x)."""
        x = self.sizes.directions
        m = self.sizes.torques
        return self.policy[:-1, m:m + m * x].reshape(-1, m, x).copy()

    def shift(self, intervals: float) -> None:
        """Move `path` and the gains by a time in intervals; the end is repeated."""
        place: Array = np.arange(self.nodes + 1.0) + intervals
        _interpolate(self.path[:, :self.sizes.state], place)
        _interpolate(self.tau, place[:-1])
        later = np.minimum(place[:-1].astype(int), self.nodes - 1)
        self.policy[:-1] = self.policy[later]

    def swap(self) -> None:
        """Exchange `path` and `trial`, which keep the same first row."""
        self.path, self.trial = self.trial, self.path
        self._rows, self._swapped_rows = self._swapped_rows, self._rows


def _interpolate(rows: Array, place: Array) -> None:
    """Replace rows, in place, by those at real numbers of rows; the last is repeated."""
    last = len(rows) - 1
    moved = np.minimum(place, last)
    first = moved.astype(int)
    part = (moved - first)[:, None]
    rows[:] = (1.0 - part) * rows[first] + part * rows[np.minimum(first + 1, last)]
