"""
Deviations of the torques along a path from those of the model, for uncertain parameters.

The torque is linear in the uncertain parameters: with their half-widths delta it lies within
tau +- |Y| delta, exactly (`robot.torque_bounds`). Along q(s) the regressor Y is linear in x =
s'^2 and v = s'', but for friction, so that the deviation |Y| delta is a convex function of
both. The limits at a vertex have its tangent at the last profile, as that of friction.
"""

from kane_dynamics._util.typing import Array, Matrix, Scalar, Vector
from kane_dynamics.loop_tracking.driven_mechanism import motion_of_closed
from kane_dynamics.mechanics.equations import Equations
from kane_dynamics.native.runtime.kernel import Kernel
from kane_dynamics.native.tracing.differentiation import forward
from kane_dynamics.native.tracing.subroutine import Subroutines
from kane_dynamics.robot.kernel_set import kernel_per_robot
from kane_dynamics.robot.robot import Robot
from kane_dynamics.robot.torque_bounds import (box_size, deviation_law, torque_deviation,
                                               Uncertainty)
import numpy as np

VALUE = 3  # row of the deviation in the results of `tangent_kernel`


class PathUncertainty:
    """
    Deviations of the torques at the vertices of a section of a path.

    Parameters
    ----------
    robot : Robot
        The robot.
    uncertainty : Uncertainty
        Of its model.
    q, first, second : (N + 1, n_q) arrays
        The path of all joints and its derivatives by s, at the vertices.
    driving : list of int, optional
        With chosen speeds or constraints: the joints that determine the others.

    """

    def __init__(self, robot: Robot, uncertainty: Uncertainty, q: Array, first: Array,
                 second: Array, driving: list[int] | None) -> None:
        self._kernel = tangent_kernel(robot)
        self._q = np.ascontiguousarray(q)
        self._box = np.broadcast_to(uncertainty.box, (len(q), len(uncertainty.box)))
        # Speeds are `rates` times s', their rates `rates` times s'' and `bend` times s'^2.
        self._rates, self._bend = first, second
        if driving is not None:
            whole = motion_of_closed(robot, driving, np.zeros(len(q)), self._q,
                                     first[:, driving], second[:, driving])
            self._rates, self._bend = whole.u, whole.udot
        self.at_rest = torque_deviation(robot, self._q, np.zeros_like(self._rates),
                                        np.zeros_like(self._rates), uncertainty,
                                        of_joints=True)

    def lines(self, x: Array | None, least: float) -> Array:
        """
        Return the tangent of the deviation: factors of v and x, and a constant, (N + 1, 3, n).

        The increase v of x differs before and after a vertex; the tangent is that of the
        larger deviation.

        Parameters
        ----------
        x : (N + 1,) array or None
            The profile; None for a robot at rest.
        least : float
            Least x at which the friction of a moving joint is computed.

        """
        # At rest the deviation does not depend on the speed.
        if x is None:
            lines = np.zeros((len(self._q), 3, self.at_rest.shape[1]))
            lines[:, 2] = self.at_rest
            return lines
        # x' may differ on both sides of a point: the side with the larger deviation
        # counts.
        at = np.maximum(x, least)
        change = np.diff(x)
        before = self._tangents(at, np.insert(change, 0, change[0]))
        after = self._tangents(at, np.append(change, change[-1]))
        larger_after = after[:, VALUE] > before[:, VALUE]
        tangents = np.where(larger_after[:, None], after, before)
        return np.asarray(tangents[:, :VALUE])

    def _tangents(self, x: Array, v: Array) -> Array:
        """Return the results of `tangent_kernel` at profiles of x and v, (N + 1, 4, n)."""
        return np.asarray(self._kernel(self._q, self._rates, self._bend, x, v, self._box))


@kernel_per_robot
def tangent_kernel(robot: Robot) -> Kernel:
    """
    Return the kernel of the tangent of a deviation: factors of v and x, a constant, its value.

    Its arguments are q, the speeds at s' = 1, their rates at s' = 1 without s'', x, v and the
    half-widths of the box; speeds are linear in s', so that they multiply s''.
    """
    equations: Equations = robot.equations

    def tangent(q: Vector, rates: Vector, bend: Vector, x: Scalar, v: Scalar, box: Vector,
                parameters: Vector) -> Matrix:
        # With x = s'^2 and v = s'': u = sqrt(x) r, udot = v r + x b.
        u = np.sqrt(x) * rates
        udot = v * rates + x * bend
        value = deviation_law(equations, q, u, udot, box, parameters, 0.0,
                              of_joints=not equations.in_joint_rates)
        # The tangent in v and x, by forward differentiation of the law.
        by_v = np.array(forward(value, [x, v], [0.0, 1.0], Subroutines()), dtype=object)
        by_x = np.array(forward(value, [x, v], [1.0, 0.0], Subroutines()), dtype=object)
        return np.stack([by_v, by_x, value - by_v * v - by_x * x, value])
    inputs = {'q': (robot.n_q,), 'rates': (robot.n,), 'bend': (robot.n,), 'x': (), 'v': (),
              'box': (box_size(len(equations.model.bodies)),)}
    return robot.kernels.compiled(tangent, 'path_deviation', inputs, (4, robot.n_q),
                                  ahead=False)
