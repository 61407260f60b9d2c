"""
Optimal torques over a horizon by differential dynamic programming, in native code.

`TrajectoryOptimizer` minimises a cost over a horizon within the torque limits,
`PredictiveController` repeats that from every measured state.
"""

from kane_dynamics.optimal_control.predictive_controller import PredictiveController
from kane_dynamics.optimal_control.trajectory_optimizer import (CostWeights, OptimizedMotion,
                                                                TrajectoryOptimizer)

__all__ = ['CostWeights', 'OptimizedMotion', 'PredictiveController',
           'TrajectoryOptimizer']
