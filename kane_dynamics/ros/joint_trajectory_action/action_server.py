"""
The action FollowJointTrajectory.

A goal becomes the desired motion of the torque path, after the same checks as a message
on ~/joint_trajectory. While it is followed, the torque path records its states, and a
timer judges all of them. Without a goal there is neither record nor timer.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from importlib import import_module
from typing import Any

from kane_dynamics.control.terms import Mode
from kane_dynamics.errors import InputError, KaneError
from kane_dynamics.motion.motion import Motion
from kane_dynamics.robot.robot import Robot
from kane_dynamics.ros.common.conversion import (Array, doubles, duration,
                                                 JointNamesError, NANO)
from kane_dynamics.ros.inputs.trajectory_input import (
    PastMotionError, schedule_motion, start_in_words)
from kane_dynamics.ros.joint_trajectory_action.goal_monitor import (GoalMonitor,
                                                                    GoalOutcome,
                                                                    ResultCode)
from kane_dynamics.ros.joint_trajectory_action.goal_tolerances import goal_tolerances
from kane_dynamics.ros.joint_trajectory_action.state_record import StateRecord
from kane_dynamics.ros.joint_trajectory_action.stop_motion import (Demand, limit_demand,
                                                                   stop_along, stop_from)
from kane_dynamics.ros.services.motion_check import refuse_impossible
from kane_dynamics.ros.services.served_robot import ServedRobot
from kane_dynamics.ros.services.services import RESULT_TIMEOUT, Services
from kane_dynamics.ros.torque_path.torque_path import TorquePath
from rclpy.action import ActionServer, CancelResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.task import Future
from trajectory_msgs.msg import JointTrajectoryPoint

NAME = 'follow_joint_trajectory'
# s between two judgements, and two feedback messages. Shorter ones delay torques: each
# takes the interpreter for about a millisecond.
PERIOD = 0.05
COORDINATES = ('planar and floating joints have the coordinates <joint>/x and so on in '
               '`trajectory`')
# Modes whose feedback follows a motion of the joints
FEEDBACK_MODES = ('computed_torque', 'joint_impedance', 'motor_side')


def follow_joint_trajectory_type() -> Any:
    """
    Return the action type, or raise InputError with the reason why there is none.

    It is imported by name, because there are installations without control_msgs.
    """
    try:
        return import_module('control_msgs.action').FollowJointTrajectory
    except (ImportError, AttributeError) as error:
        raise InputError(f'action ~/{NAME}: not served without '
                         f'control_msgs/FollowJointTrajectory ({error}); expected an '
                         'installed package control_msgs') from None


@dataclass(eq=False)
class FollowedGoal:
    """
    A goal whose motion, or whose stop, is followed.

    Attributes
    ----------
    handle : ServerGoalHandle
    path : TorquePath
    robot : Robot
        Of requests.
    motion : Motion
    start : int
        Start of the motion, ns.
    monitor : GoalMonitor
    record : StateRecord
        Of the motion, then of its stop.
    ended : Future
        Done when the goal has an outcome.
    outcome : GoalOutcome
    cancelled : str
        How a cancelled goal ends; empty before.
    rest : int
        Time at which the arm of a cancelled goal rests, ns.

    """

    handle: ServerGoalHandle
    path: TorquePath
    robot: Robot
    motion: Motion
    start: int
    monitor: GoalMonitor
    record: StateRecord
    ended: Future = field(default_factory=Future)
    outcome: GoalOutcome = GoalOutcome(ResultCode.INVALID_GOAL, '')
    cancelled: str = ''
    rest: int = 0

    def progress(self) -> str:
        """Return how much of the motion is done, as text."""
        moment = (self.path.now - self.start) / NANO
        if moment <= 0.0:
            return (f'{-moment:.3f} s before its motion of {self.motion.duration:.3f} s '
                    'began')
        if moment > self.motion.duration:
            late = moment - self.motion.duration
            return f'{late:.3f} s after the end of its motion'
        return f'at {moment:.3f} s of {self.motion.duration:.3f} s'

    def followed_states(self, q: Array, u: Array) -> tuple[Array, Array]:
        """Return positions and rates, (K, n), of the joints that follow the motion."""
        robot = self.robot
        rates = robot.joint_rates(q, u)
        places = list(map(robot.joint_names.index, self.motion.joint_names))
        return q[:, places], rates[:, places]


class JointTrajectoryAction:
    """
    Serves ~/follow_joint_trajectory.

    Parameters
    ----------
    node : Node
    server : Services
        Its robot computes stops.
    running : callable
        Returns the running torque path and the robot of requests; raises InputError if
        the node is not active.
    reject : callable
        Called with the reason of each refused goal.

    Raises
    ------
    InputError
        The package control_msgs is not installed.

    """

    def __init__(self, node: Node, server: Services,
                 running: Callable[[], tuple[TorquePath, ServedRobot]],
                 reject: Callable[[str], None]) -> None:
        self._type = follow_joint_trajectory_type()
        self._node = node
        self._server = server
        self._log = node.get_logger()
        self._running = running
        self._reject = reject
        # Deadlines of goals count in steady time, also while the node's clock is
        # simulated.
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._goal: FollowedGoal | None = None
        self._begun: dict[bytes, FollowedGoal | Exception] = {}  # by identifier
        self._timer: Any = None
        self._action = ActionServer(
            node, self._type, f'~/{NAME}', self._follow, result_timeout=RESULT_TIMEOUT,
            callback_group=ReentrantCallbackGroup(), cancel_callback=self._cancel,
            handle_accepted_callback=self._accept)

    # The beginning and the end of a goal.

    def _accept(self, handle: ServerGoalHandle) -> None:
        """Begin a goal; rclpy would begin it later, after messages that follow it."""
        identifier = bytes(handle.goal_id.uuid)
        try:
            self._begun[identifier] = self._begin(handle)
        except Exception as error:
            self._begun[identifier] = error
        handle.execute()

    async def _follow(self, handle: ServerGoalHandle) -> Any:
        """Return the result of a goal, at its end."""
        goal = self._begun.pop(bytes(handle.goal_id.uuid))
        if isinstance(goal, Exception):
            return self._refuse(handle, goal)
        await goal.ended
        return self._result(goal.outcome)

    def _begin(self, handle: ServerGoalHandle) -> FollowedGoal:
        """Check a goal and schedule its motion, in place of the goal before it."""
        # What refuses any goal, then the message, then its motion.
        path, served = self._running()
        if handle.is_cancel_requested:
            raise InputError('goal: cancelled before it began; expected one to follow')
        values = served.values
        mode = path.controller.mode
        if mode not in FEEDBACK_MODES:
            raise InputError(f'mode: {mode}; expected one with feedback '
                             f'({", ".join(FEEDBACK_MODES)})')
        message = handle.request
        _refuse_coordinates(message)
        _refuse_unknown_joints(message, served.robot, path.controller.followed)
        tolerances = goal_tolerances(message, path.controller.followed,
                                     served.robot.joint_names, values)
        served.apply_loads()
        # The generation shows whether a stop comes between the check and the start.
        generation = path.active_motion.generation
        now = path.now
        motion, start = schedule_motion(path, message.trajectory, now, generation,
                                        values, partial(refuse_impossible, served))
        remark = start_in_words(start, path.now)
        if remark:
            self._log.warning(f'{NAME}: {remark}')
        # The new motion is scheduled, so that the former goal ends.
        if self._goal is not None:
            self._end(self._goal, self._interrupted(self._goal, 'replaced by a new goal'))
        monitor = GoalMonitor(motion, start, tolerances)
        goal = FollowedGoal(handle, path, served.robot, motion, start, monitor,
                            StateRecord(motion))
        path.add_observer(goal.record, need_effort=False)
        self._goal = goal
        self._timer = self._node.create_timer(PERIOD, self._judge, clock=self._steady)
        return goal

    def _refuse(self, handle: ServerGoalHandle, error: Exception) -> Any:
        """End a goal that is not followed; the present motion goes on."""
        text = str(error)
        if not isinstance(error, KaneError):
            text = f'internal error: {type(error).__name__}: {error}'
        if handle.is_cancel_requested:
            handle.canceled()
        else:
            handle.abort()
            self._reject(text)
        return self._result(GoalOutcome(_code(error), text))

    def _end(self, goal: FollowedGoal, outcome: GoalOutcome) -> None:
        """End a goal that was followed."""
        goal.path.remove_observer(goal.record)
        if goal is self._goal:
            self._node.destroy_timer(self._timer)
            self._goal = None
        goal.outcome = outcome
        # The result by how the goal ended.
        if goal.cancelled:
            goal.handle.canceled()
        elif outcome.code is ResultCode.SUCCESSFUL:
            goal.handle.succeed()
        else:
            goal.handle.abort()
            self._log.warning(f'{NAME} aborted: {outcome.text}')
        goal.ended.set_result(None)

    def _result(self, outcome: GoalOutcome) -> Any:
        """Return the message of an outcome."""
        return self._type.Result(error_code=int(outcome.code), error_string=outcome.text)

    def _interrupted(self, goal: FollowedGoal, reason: str) -> GoalOutcome:
        """Return the outcome of a goal whose motion, or whose stop, another replaced."""
        if goal.cancelled:
            text = f'{goal.cancelled}; its stop was {reason}'
            return GoalOutcome(ResultCode.SUCCESSFUL, text)
        return GoalOutcome(ResultCode.INVALID_GOAL, f'{reason} {goal.progress()}')

    def close(self) -> None:
        """End the goal of a node that stopped: a client would wait for its result."""
        self._judge()

    # While a goal is followed.

    def _judge(self) -> None:
        """Judge the states since the last call; an error ends the goal."""
        goal = self._goal
        if goal is None:  # the timer was ready when it was destroyed
            return
        try:
            self._judge_states(goal)
        except Exception as error:
            text = f'internal error: {type(error).__name__}: {error}'
            if not goal.cancelled:  # without judgement the motion does not go on
                self._stop(goal)
                goal.cancelled = ''  # it is the fault of no client
            self._end(goal, GoalOutcome(ResultCode.INVALID_GOAL, text))

    def _judge_states(self, goal: FollowedGoal) -> None:
        """Judge states, publish feedback, and end the goal where it ends."""
        states = goal.record.take()
        outcome = None
        # Whole batches of states, so that judging costs little.
        if states is not None and not goal.cancelled:
            stamps, q, u = states
            outcome = goal.monitor.judge(stamps, *goal.followed_states(q, u))
            self._publish_feedback(goal)
        if outcome is not None:
            if outcome.code is not ResultCode.SUCCESSFUL:
                self._hold(goal)
            self._end(goal, outcome)
        # The path dropped the motion: a stop, a timeout or another mode.
        elif not goal.path.active_motion.holds(goal.record.motion, goal.path.now):
            self._end(goal, self._interrupted(goal, self._reason(goal)))
        elif goal.cancelled and states is not None and states[0][-1] >= goal.rest:
            self._end(goal, GoalOutcome(ResultCode.SUCCESSFUL, goal.cancelled))

    def _reason(self, goal: FollowedGoal) -> str:
        """Return why the motion of a goal is followed no more."""
        motion, _ = goal.path.active_motion.at(goal.path.now)
        if motion is not None:
            return 'replaced by a motion on ~/joint_trajectory'
        return f'dropped ({goal.path.active_motion.reason})'

    def _publish_feedback(self, goal: FollowedGoal) -> None:
        """Publish the last state beside the motion."""
        latest = goal.monitor.latest
        assert latest is not None  # states were judged
        message = self._type.Feedback(joint_names=list(goal.motion.joint_names))
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(latest.stamp, NANO)
        q, u, udot = latest.desired
        since = duration(latest.moment)
        message.desired = JointTrajectoryPoint(
            positions=doubles(q), velocities=doubles(u), accelerations=doubles(udot),
            time_from_start=since)
        message.actual = JointTrajectoryPoint(
            positions=doubles(latest.q), velocities=doubles(latest.u),
            time_from_start=since)
        message.error = JointTrajectoryPoint(
            positions=doubles(q - latest.q), velocities=doubles(u - latest.u),
            time_from_start=since)
        goal.handle.publish_feedback(message)

    # Stops.

    def _cancel(self, handle: ServerGoalHandle) -> CancelResponse:
        """Stop the arm along the path of a cancelled goal."""
        goal = self._goal
        if goal is not None and goal.handle == handle and not goal.cancelled:
            self._stop(goal)
        return CancelResponse.ACCEPT

    def _stop(self, goal: FollowedGoal) -> None:
        """Stop the arm along the path of a goal; where that fails, in the shortest time."""
        try:
            self._stop_along(goal)
        except Exception as error:
            self._log.error(f'{NAME}: no stop along the path: {type(error).__name__}: '
                            f'{error}; stopping in state_check.stop_time')
            goal.path.interrupt(goal.path.now, f'{type(error).__name__}: {error}')

    def _stop_along(self, goal: FollowedGoal) -> None:
        """Schedule the stop along the path, and say where the arm comes to rest."""
        path = goal.path
        active_motion = path.active_motion
        generation = active_motion.generation
        now = path.now
        progress = goal.progress()
        goal.cancelled = f'cancelled {progress}'
        if not path.running:  # the motion ended with the node's activity
            return
        motion, moment = active_motion.at(now)
        if motion is None:
            # The goal has not begun, and the arm holds its pose.
            held = path.desired(now)
            q = goal.motion.positions[0] if held is None else held[0]
            motion = Motion.from_points([0.0], [q], joint_names=goal.motion.joint_names)
            moment = 0.0
        start = now - round(moment * NANO)
        elastic = path.controller.mode == Mode.MOTOR_SIDE
        stop = stop_along(motion, moment, self._demand(goal), elastic=elastic)
        if stop is None:
            # The rest of the motion is the shortest stop.
            rest = motion.duration
            stop = motion
        else:
            rest = moment + 0.5 * stop.duration
            start = now
        goal.record.motion = stop
        goal.rest = start + round(stop.duration * NANO)
        if motion is goal.motion:
            goal.cancelled += f'; the arm rests at {rest:.3f} s of its motion'
        active_motion.follow(stop, start, now, generation)

    def _hold(self, goal: FollowedGoal) -> None:
        """Stop the arm from its last state, unless another motion is scheduled."""
        path = goal.path
        latest = goal.monitor.latest
        generation = path.active_motion.generation
        served = self._server.served
        # Nothing to stop without a state, or if another motion was scheduled.
        if served is None or latest is None:
            return
        if not path.active_motion.holds(goal.motion, path.now):
            return
        elastic = path.controller.mode == Mode.MOTOR_SIDE
        stop = stop_from(served, goal.motion.joint_names, latest.q, latest.u,
                         self._demand(goal), elastic=elastic)
        path.active_motion.follow(stop, latest.stamp, path.now, generation)

    def _demand(self, goal: FollowedGoal) -> Demand:
        """Return the function that compares the efforts of a stop with their limits."""
        served = self._server.served
        if served is None:
            raise InputError('node: not configured; expected a configured node')
        served.apply_loads()
        controller = goal.path.controller
        return partial(limit_demand, served, controller.effort_limit,
                       controller.rate_limit)


def _code(error: Exception) -> ResultCode:
    """Return the result code of a refused goal."""
    if isinstance(error, JointNamesError):
        return ResultCode.INVALID_JOINTS
    if isinstance(error, PastMotionError):
        return ResultCode.OLD_HEADER_TIMESTAMP
    return ResultCode.INVALID_GOAL


def _refuse_coordinates(message: Any) -> None:
    """Raise InputError if a goal has joints with several coordinates."""
    multi = message.multi_dof_trajectory
    if multi.joint_names or multi.points:
        raise InputError(f'multi_dof_trajectory: {len(multi.joint_names)} joints, '
                         f'{len(multi.points)} points; expected none, as {COORDINATES}')
    for field_name in ('component_path_tolerance', 'component_goal_tolerance'):
        count = len(getattr(message, field_name))
        if count:
            raise InputError(f'{field_name}: {count} entries; expected none, as '
                             f'{COORDINATES}')


def _refuse_unknown_joints(message: Any, robot: Robot,
                           followed: tuple[str, ...]) -> None:
    """Raise JointNamesError if a goal names joints that the robot does not have."""
    # A mimic joint is a joint of a body, but no coordinate.
    known = {body.joint.name for body in robot.model.bodies}.union(robot.joint_names)
    unknown = [name for name in message.trajectory.joint_names if name not in known]
    if unknown:
        raise JointNamesError(f'joint_names of the trajectory: {", ".join(unknown)}; '
                              f'expected {", ".join(followed)}')
