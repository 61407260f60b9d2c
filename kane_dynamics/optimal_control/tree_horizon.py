"""The functions of a horizon for a tree of rigid bodies in joint rates, over any scalar."""

from typing import Any

from kane_dynamics.mechanics.integrators.implicit_friction import (implicit_friction_slopes,
                                                                   implicit_friction_step)
from kane_dynamics.optimal_control.backward_step import (backward_step, expansion_of_tree, Policy,
                                                         symmetric, TorqueCost)
from kane_dynamics.optimal_control.horizon_layout import Constants, Sizes
from kane_dynamics.optimal_control.stage_cost import cost_slopes, stage_cost
from kane_dynamics.robot.robot import Robot
import numpy as np


class TreeHorizon:
    """
    Step, derivatives and policy of a tree, in the interface of `HorizonKernels`.

    The state is q and u, and the slopes of an interval are the derivatives of udot by q, u and
    tau, (3, n, n). The targets are those of q, u and tau.
    """

    linearization = 'state tau'
    policy = 'slopes end tau target weight later'

    def __init__(self, robot: Robot) -> None:
        """Store the equations."""
        n = self.n = robot.n
        self._equations: Any = robot.equations
        self.sizes = Sizes(state=2 * n, directions=2 * n, torques=n, joints=n, multipliers=0,
                           target=3 * n, slopes=3 * n * n)

    def slopes_of(self, state: Any, tau: Any, constants: Constants) -> Any:
        """Return the derivatives of an interval."""
        n = self.n
        return implicit_friction_slopes(self._equations, state[:n], state[n:], tau, constants.h,
                                        constants.parameters)

    def policy_of(self, slopes: Any, end: Any, tau: Any, target: Any, weight: Any, v: Any,
                  V: Any, constants: Constants) -> Policy:
        """Return the policy of an interval; v and V are the cost-to-go at its end."""
        n, (_, _, limits, _, regular) = self.n, constants
        gradient, hessian = cost_slopes(np.concatenate([end, tau]) - target, end[n:], weight,
                                        limits)
        before = expansion_of_tree(slopes.reshape(3, n, n), constants.h, v + gradient[:2 * n],
                                   symmetric(V, 2 * n) + np.diag(hessian[:2 * n]))
        torques = TorqueCost(tau, gradient[2 * n:], hessian[2 * n:], limits.lowest_torque,
                             limits.highest_torque)
        return backward_step(before, torques, regular * torques.hessian)

    def change(self, state: Any, nominal: Any) -> Any:
        """Return the change of the state from another one, (2 n,)."""
        return state - nominal

    def step(self, state: Any, tau: Any, target: Any, weight: Any,
             constants: Constants) -> tuple[Any, Any, Any]:
        """Return the state at the end of an interval, no multipliers, and the cost."""
        n = self.n
        x = np.concatenate(implicit_friction_step(self._equations, state[:n], state[n:], tau,
                                                  constants.h, constants.parameters))
        cost = stage_cost(np.concatenate([x, tau]) - target, x[n:], weight, constants.limits)
        return x, np.zeros(0), cost
