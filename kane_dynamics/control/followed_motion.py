"""
Desired motion of a whole robot from the desired motion of its followed joints.

As many joints as there are independent speeds follow; the loops are closed from one
desired configuration to the next. In joint rates without constraints all joints follow,
and their motion is that of the robot.
"""

from collections.abc import Callable, Sequence

from kane_dynamics._util.fork_safety import lazy_property
from kane_dynamics._util.typing import Array, Scalar, Vector
from kane_dynamics.control.computed_torque import (followed_joints, followed_rates,
                                                   motion_columns, require_closed)
from kane_dynamics.errors import InputError
from kane_dynamics.loop_tracking.loop_tracker import LoopTracker
from kane_dynamics.mechanics.constraints.conditioning import SINGULAR
from kane_dynamics.motion.motion import Motion, State
from kane_dynamics.robot.robot import Robot


class FollowedMotion:
    """
    Desired configurations, speeds and rates, for motions of the followed joints.

    Parameters
    ----------
    robot : Robot
    followed : sequence of str, optional
        As for `ComputedTorque`.

    Attributes
    ----------
    direct : bool
        Whether the motion of the joints is that of the robot: in joint rates.
    places, names : list of int, tuple of str
        The joints that follow.

    """

    def __init__(self, robot: Robot, followed: Sequence[str] | None) -> None:
        """Find the joints that follow; kernels compile on first use."""
        self._robot = robot
        self._equations = robot.equations
        self.direct = robot.equations.in_joint_rates
        self.places = list(followed_joints(robot, followed))
        self.names = tuple(robot.coordinate_names[k] for k in self.places)
        self._is_tracking = False  # whether the last motion was one of the same joints

    def check(self, motion: Motion) -> None:
        """Raise InputError unless a motion has these joints, or all of closed loops."""
        motion_columns(self._robot, self.places, motion.joint_names)
        require_closed(self._robot, motion.positions, motion.times)

    def restart(self) -> None:
        """Close the loops from the next measured state on."""
        self._is_tracking = False

    def compile(self) -> None:  # noqa: A003
        """Compile what desired motions need: the loop closure and the speeds' rates."""
        if not self.direct:
            self._tracker  # noqa: B018
            self._solved_rates  # noqa: B018

    def desired(self, motion: Motion, moment: float) -> State:
        """Return q, u, udot of the joints that follow at a time of the motion, s."""
        state = motion.sample(moment)
        if self.direct or motion.n == len(self.places):
            return state
        q, u, udot = state
        return q[self.places], u[self.places], udot[self.places]

    def state(self, measured: Array, motion: Motion, moment: float, t: float
              ) -> tuple[State, Array]:
        """
        Return q (n_q,), u, udot of the robot, and accelerations of followed joints.

        The branch of the loops is that of the measured configuration at the first call
        after `restart`, or that of the motion if it is one of all joints.
        """
        q, rates, accelerations = self.desired(motion, moment)
        if self.direct:
            return (q, rates, accelerations), accelerations
        # A motion of all joints states the branch of the loops, too.
        whole = None
        if motion.n == self._robot.n_q:
            whole = motion.sample(moment)[0]
        q_d, u_d = self._closed(measured, whole, q, rates, t)
        udot_d = self.speed_rates(q_d, u_d, accelerations, t)
        return (q_d, u_d, udot_d), accelerations

    def _closed(self, measured: Array, whole: Array | None, q: Array, rates: Array,
                t: float) -> tuple[Array, Array]:
        """Return configuration and speeds of all joints from those that follow."""
        tracker = self._tracker
        # A velocity constraint leaves the configuration to the history of the motion.
        if tracker.path_rows and whole is None:
            raise InputError(f'motion: of {len(q)} joints, with '
                             f'{", ".join(tracker.path_rows)}; expected a motion of all '
                             'joints, because a constraint on velocities leaves the '
                             'configuration to the path, or computed torque')
        # With the whole configuration known the loops start there; otherwise they follow
        # on from the last cycle.
        if whole is not None:
            tracker.restart(whole, t)
        elif not self._is_tracking:
            tracker.restart(measured, t)
        self._is_tracking = False  # an error leaves no configuration to go on from
        tracker.update(q, rates, t=t)
        self._is_tracking = whole is None
        return tracker.q.copy(), tracker.u.copy()

    @lazy_property
    def _tracker(self) -> LoopTracker:
        """Return the loop closure of desired motions."""
        return LoopTracker(self._robot, self.names, max_figure=SINGULAR)

    def speeds(self, q: Array, rates: Array, t: float) -> Array:
        """Return u, (n,), for rates of the joints that follow."""
        if self.direct:
            return rates
        return self._solved_speeds(q, rates, t)

    def speed_rates(self, q: Array, u: Array, accelerations: Array, t: float) -> Array:
        """Return udot, (n,), for accelerations of the joints that follow."""
        if self.direct:
            return accelerations
        return self._solved_rates(q, u, accelerations, t)

    @lazy_property
    def _solved_speeds(self) -> Callable[..., Array]:
        """Return the entry point of u, of q and rates: T_c u = rates - X_c."""
        def speeds(q: Vector, rates: Vector, *, t: Scalar) -> Vector:
            motion = self._equations.at_rest(q, t)
            right = rates - motion.qdot[self.places]
            result: Vector = self._equations.mechanism.solved(motion.T[self.places], right)
            return result
        return self._compiled('followed_speeds', speeds, q=(self._robot.n_q,),
                              rates=(len(self.places),))

    @lazy_property
    def _solved_rates(self) -> Callable[..., Array]:
        """Return the entry point of udot, of q, u and accelerations."""
        def rates(q: Vector, u: Vector, accelerations: Vector, *, t: Scalar) -> Vector:
            return followed_rates(self._equations, self.places, q, u, accelerations, t)
        robot = self._robot
        return self._compiled('followed_rates', rates, q=(robot.n_q,), u=(robot.n,),
                              accelerations=(len(self.places),))

    def _compiled(self, name: str, function: Callable[..., Vector], **shapes: tuple[int]
                  ) -> Callable[..., Array]:
        """Return the entry point of a function of arrays and the time."""
        label = f'{name}_{"_".join(map(str, self.places))}'
        kernel = self._robot.compiled(function, name=label, shape=(self._robot.n,),
                                      **shapes)
        return kernel.entry('', kernel)
