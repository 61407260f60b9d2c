"""Model predictive control: the first torque of a horizon, optimized again from every state."""

from kane_dynamics._util.checks import integer
from kane_dynamics._util.typing import Array
from kane_dynamics.motion.motion import Motion
from kane_dynamics.optimal_control.trajectory_optimizer import Solution, TrajectoryOptimizer
import numpy as np
from numpy.typing import ArrayLike

FIRST = 100  # iterations from the first state


class PredictiveController:
    """
    Predictive controller: one or a few iterations of an optimizer in every cycle.

    The first cycle begins with the torque of gravity and optimizes until it converges; compile and
    call it before the arm must move. Later ones continue from the torques of the last, moved in
    time (real-time iteration, Diehl et al., SIAM J. Control Optim. 43 (2005)).

    Parameters
    ----------
    optimizer : TrajectoryOptimizer
        Its target is that of the controller.
    iterations : int
        In each cycle but the first.

    Attributes
    ----------
    solution : Solution or None
        Of the last cycle.

    """

    def __init__(self, optimizer: TrajectoryOptimizer, *, iterations: int = 1) -> None:
        """Store the optimizer."""
        self.optimizer = optimizer
        self.iterations = integer(iterations, 'iterations', 1)
        self.solution: Solution | None = None
        self._target: ArrayLike | Motion | None = None
        self._t = 0.0

    def set_target(self, target: ArrayLike | Motion, t: float = 0.0) -> None:
        """Set a configuration to rest at, or a motion whose time is t at the next cycle."""
        self.optimizer.set_target(target, t)
        self._target = None
        if isinstance(target, Motion):
            self._target = target
        elif self.optimizer.robot.equations.timed:
            self._target = np.array(target)
        self._t = float(t)

    def torque(self, q: ArrayLike, u: ArrayLike, elapsed: float) -> Array:
        """
        Return the torques of the actuators, (m,), N m or N, never beyond their limits.

        Parameters
        ----------
        q, u : (n_q,), (n,) array_like
            The measured state.
        elapsed : float
            Time since the state of the last call, s; ignored in the first.

        Raises
        ------
        InputError
            The state or the time is not finite; names it.
        ConstraintError
            The loops of the measured configuration are open beyond `closure_tolerance`.

        """
        optimizer = self.optimizer
        if self.solution is None:
            optimizer.start(optimizer.holding_torques(q))
            self.solution = optimizer.solve(q, u, iterations=FIRST)
        else:
            optimizer.shift(elapsed)
            self._t += elapsed
            if self._target is not None:
                optimizer.set_target(self._target, self._t)
            self.solution = optimizer.solve(q, u, iterations=self.iterations)
        tau: Array = self.solution.tau[0]
        return tau
