"""
The services, the action of simulations, and the topics of trajectories.

Requests use their own Robot and never the torque path. Simulations run on a worker
thread, which releases the interpreter's lock in native code.
"""

from collections.abc import Callable
import time
from typing import Any

from kane_dynamics.errors import InputError, KaneError
from kane_dynamics.ros.common.conversion import read_message
from kane_dynamics.ros.common.lost_messages import with_info
from kane_dynamics.ros.common.qos import RELIABLE, SERVICES
from kane_dynamics.ros.common.service_errors import later, reported
from kane_dynamics.ros.services.served_robot import ServedRobot
from kane_dynamics.ros.services.service_calls import (explain, forward_dynamics,
                                                      get_dynamics, inverse_dynamics)
from kane_dynamics.ros.services.simulation_request import SimulationRequest
from kane_dynamics.ros.services.trajectory_filling import filled_message
from kane_dynamics.ros.services.worker import Worker
from kane_dynamics_interfaces.action import SimulateMotion
from kane_dynamics_interfaces.srv import (Explain, ForwardDynamics, GetDynamics,
                                          InverseDynamics, SetPayload, Simulate)
from rclpy.action import ActionServer, CancelResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from rclpy.task import Future
from trajectory_msgs.msg import JointTrajectory

FEEDBACK_PERIOD = 0.05  # s between two feedback messages of one goal
RESULT_TIMEOUT = 60     # s for which the result of a goal is kept


class Services:
    """
    Serves the services, the action of simulations, and the topics of trajectories.

    Parameters
    ----------
    node : rclpy.node.Node
    on_trajectory : callable
        Called with each serialized JointTrajectory and the system time of its reception,
        ns.
    on_payload : callable
        Called with each SetPayload request; returns the message of the answer, and
        raises KaneError to refuse the request.
    reject : callable
        Called with the reason why a trajectory cannot be filled in.

    """

    def __init__(self, node: Node, on_trajectory: Callable[[bytes, int], None],
                 on_payload: Callable[[Any], str],
                 reject: Callable[[str], None]) -> None:
        self.served: ServedRobot | None = None
        self.max_waiting = 1
        self.log = node.get_logger()
        self._reject = reject
        self.worker = Worker()

        def set_payload(served: ServedRobot, request: Any, response: Any) -> None:
            response.message = on_payload(request)
        for kind, name, call in ((InverseDynamics, 'inverse_dynamics', inverse_dynamics),
                                 (ForwardDynamics, 'forward_dynamics', forward_dynamics),
                                 (GetDynamics, 'get_dynamics', get_dynamics),
                                 (Explain, 'explain', explain),
                                 (SetPayload, 'set_payload',
                                  set_payload)):
            node.create_service(kind, f'~/{name}', self._answering(call),
                                qos_profile=SERVICES)
        later(node.create_service(Simulate, '~/simulate', self._simulate,
                                  qos_profile=SERVICES))

        def on_message(data: bytes, info: Any) -> None:
            on_trajectory(data, info['received_timestamp'])
        node.create_subscription(JointTrajectory, '~/joint_trajectory',
                                 with_info(reported(on_message, self.log)), RELIABLE,
                                 raw=True)
        # A plain publisher: filled trajectories are no commands, and an inactive node
        # fills too.
        self._filled = node.create_publisher(JointTrajectory, '~/trajectory_with_effort',
                                             RELIABLE)
        node.create_subscription(JointTrajectory, '~/trajectory',
                                 reported(self._fill, self.log), RELIABLE, raw=True)
        # In the default group of callbacks, a goal would block all others until it ends.
        self.action = ActionServer(
            node, SimulateMotion, '~/simulate_motion', self._simulate_motion,
            result_timeout=RESULT_TIMEOUT, callback_group=ReentrantCallbackGroup(),
            cancel_callback=lambda handle: CancelResponse.ACCEPT)

    def stop(self) -> None:
        """End running simulations."""
        self.worker.stop(timeout=0.5)

    def _require(self) -> ServedRobot:
        """
        Return the robot that serves requests.

        Raise InputError before it is configured.
        """
        if self.served is None:
            raise InputError('node: not configured; expected a configured node')
        return self.served

    def _fill(self, data: bytes) -> None:
        """Publish a trajectory with all fields filled in."""
        try:
            served = self._require()
            served.apply_loads()
            message = read_message(data, JointTrajectory)
            self._filled.publish(filled_message(served, message))
        except KaneError as error:
            self._reject(str(error))

    def _failed(self, response: Any, error: BaseException) -> Any:
        """Return the response to a request that raised an error."""
        response.success = False
        if isinstance(error, KaneError):
            response.message = str(error)
        else:
            response.message = f'internal error: {type(error).__name__}: {error}'
            self.log.error(response.message)
        return response

    def _answering(self,
                   call: Callable[[ServedRobot, Any, Any], None]) -> Callable[[Any, Any],
                                                                              Any]:
        """Return a service callback that calls `call` and handles its errors."""
        def callback(request: Any, response: Any) -> Any:
            # Any error is an answer: a service that raises would leave its caller
            # waiting.
            try:
                served = self._require()
                served.apply_loads()
                call(served, request, response)
                response.success = True
            except Exception as error:
                return self._failed(response, error)
            return response
        return callback

    def _simulate(self, request: Simulate.Request,
                  response: Simulate.Response) -> Future:
        """Serve ~/simulate; other requests are served while this one is queued."""
        def run() -> Any:
            try:
                simulation.run(response, lambda t: not self.worker.stopping)
                response.success = not self.worker.stopping
            except Exception as error:
                return self._failed(response, error)
            return response
        try:
            # The worker runs one simulation at a time, in order.
            simulation = SimulationRequest.from_request(request, self._require())
            return self.worker.submit(run, self.max_waiting)
        except Exception as error:
            refused = Future()
            refused.set_result(self._failed(response, error))
            return refused

    async def _simulate_motion(self, handle: ServerGoalHandle) -> SimulateMotion.Result:
        """Execute one goal of the action, with feedback and cancellation."""
        result = SimulateMotion.Result()
        try:
            # The simulation runs in the worker's thread; this coroutine only waits for
            # it.
            simulation = SimulationRequest.from_request(handle.request, self._require())
            report = GoalProgress(handle, simulation.duration, self.worker)
            await self.worker.submit(lambda: simulation.run(result, report),
                                     self.max_waiting)
        except Exception as error:
            handle.abort()
            return self._failed(result, error)
        if handle.is_cancel_requested:
            result.message = (f'cancelled at {report.reached:g} s of '
                              f'{simulation.duration:g} s')
            handle.canceled()
        elif self.worker.stopping:
            result.message = 'the node is shutting down'
            handle.abort()
        else:
            result.success = True
            handle.succeed()
        return result


class GoalProgress:
    """Publishes the progress of a goal, and decides whether its simulation continues."""

    def __init__(self, handle: ServerGoalHandle, duration: float,
                 worker: Worker) -> None:
        self.reached = 0.0
        self._handle = handle
        self._duration = duration
        self._worker = worker
        self._due = time.monotonic()

    def __call__(self, t: float) -> bool:
        """Report the simulated time, s; return False to end the simulation."""
        self.reached = t
        # Returning False ends the simulation at its next chunk.
        if self._worker.stopping or self._handle.is_cancel_requested:
            return False
        if time.monotonic() >= self._due:
            self._due = time.monotonic() + FEEDBACK_PERIOD
            self._handle.publish_feedback(SimulateMotion.Feedback(
                progress=min(t / self._duration, 1.0), simulated_time=t))
        return True
