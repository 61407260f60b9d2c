"""
The services and the action, on a plain node of their own in a thread of their own.

Nothing here touches the torque path: requests are answered with a Robot of their own, and long
work runs on a worker that calls native code without the interpreter's lock.
"""

from collections.abc import Callable
import time
from typing import Any

from kane_dynamics.errors import InputError, KaneError
from kane_dynamics.robot.robot import Robot, TORQUE_TERMS
from kane_dynamics.ros.common.conversion import as_wrench, doubles, Index, vector
from kane_dynamics.ros.services.explanation_message import explanation_message
from kane_dynamics.ros.services.simulation_request import (closed, Order, ServedRobot,
                                                           SimulationRequest)
from kane_dynamics.ros.services.worker import Worker
from kane_dynamics.ros.torque_path.wrench_input import wrenches_of_request
from kane_dynamics_interfaces.action import SimulateMotion
from kane_dynamics_interfaces.srv import (Explain, ForwardDynamics, GetDynamics, InverseDynamics,
                                          SetPayload, Simulate)
import numpy as np
from rclpy.action import ActionServer, CancelResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile
from trajectory_msgs.msg import JointTrajectory

FEEDBACK_PERIOD = 0.05  # s between two progress reports of one simulation
RESULT_TIMEOUT = 60     # s for which the result of an action is kept for its client
MOST_REQUESTS = 1000    # that may wait unread for each service, so that a flood is answered too


class Services(Node):
    """
    The node behind the services.

    Parameters
    ----------
    front : rclpy.node.Node
        The node under whose name the services appear.
    on_trajectory : callable
        Takes each serialised JointTrajectory, and when it was received, ns of the system's time;
        called in the services' thread, so that neither reading nor fitting a long one stalls the
        torque path.
    on_payload : callable
        Takes each SetPayload request; raises KaneError to refuse it.

    """

    def __init__(self, front: Node, on_trajectory: Callable[[bytes, int], None],
                 on_payload: Callable[[Any], None]) -> None:
        super().__init__(f'{front.get_name()}_services', namespace=front.get_namespace(),
                         use_global_arguments=False, start_parameter_services=False,
                         enable_rosout=False)
        self.served: ServedRobot | None = None
        self.max_waiting = 1
        self.log = front.get_logger()
        self.spinner = SingleThreadedExecutor()
        self.spinner.add_node(self)
        self.worker = Worker(self.spinner.wake)
        services = QoSProfile(depth=MOST_REQUESTS)
        # In the ordinary group a simulation would keep everything else out until it ends.
        waiting = ReentrantCallbackGroup()
        for kind, name, call in ((InverseDynamics, 'inverse_dynamics', inverse_dynamics),
                                 (ForwardDynamics, 'forward_dynamics', forward_dynamics),
                                 (GetDynamics, 'get_dynamics', get_dynamics),
                                 (Explain, 'explain', explain),
                                 (SetPayload, 'set_payload',
                                  lambda served, request, response: on_payload(request))):
            self.create_service(kind, front.resolve_service_name(f'~/{name}'),
                                self._answering(call), qos_profile=services)
        self.create_service(Simulate, front.resolve_service_name('~/simulate'), self._simulate,
                            qos_profile=services, callback_group=waiting)
        self.create_subscription(
            JointTrajectory, front.resolve_topic_name('~/joint_trajectory'),
            lambda data, info: on_trajectory(data, info['received_timestamp']),
            QoSProfile(depth=1), raw=True)
        self.action = ActionServer(
            self, SimulateMotion, front.resolve_service_name('~/simulate_motion'),
            self._simulate_motion, result_timeout=RESULT_TIMEOUT, callback_group=waiting,
            cancel_callback=lambda handle: CancelResponse.ACCEPT)

    def spin(self) -> None:
        """Serve until `stop`; whatever goes wrong in one request, the next one is served."""
        while self.context.ok() and not self.worker.stopping:
            try:
                self.spinner.spin_once(timeout_sec=5.0)
            except Exception as error:
                if self.context.ok() and not self.worker.stopping:
                    self.log.error(f'a request failed: {type(error).__name__}: {error}')

    def stop(self) -> None:
        """End running simulations early and let `spin` return; call from another thread."""
        self.worker.stop(timeout=0.5)
        self.spinner.create_task(lambda: None)  # waking alone would not end a spin_once

    def _require(self) -> ServedRobot:
        """Return what requests are answered with, or say that there is nothing yet."""
        if self.served is None:
            raise InputError('not configured')
        return self.served

    def _guard(self, response: Any, error: BaseException) -> Any:
        """Turn an error into the answer to the request that caused it."""
        response.success = False
        if isinstance(error, KaneError):
            response.message = str(error)
        else:
            response.message = f'internal error: {type(error).__name__}: {error}'
            self.log.error(response.message)
        return response

    def _answering(self,
                   call: Callable[[ServedRobot, Any, Any], None]) -> Callable[[Any, Any], Any]:
        """Return a service callback around `call`."""
        def callback(request: Any, response: Any) -> Any:
            try:
                served = self._require()
                served.loads.apply(served.robot)
                call(served, request, response)
                response.success = True
            except Exception as error:
                return self._guard(response, error)
            return response
        return callback

    async def _simulate(self, request: Simulate.Request,
                        response: Simulate.Response) -> Simulate.Response:
        """Answer the service; other requests are served while this one waits for its turn."""
        try:
            simulation = SimulationRequest.from_request(request, self._require())
            await self.worker.submit(
                lambda: simulation.run(response, lambda t: not self.worker.stopping),
                self.max_waiting)
            response.success = not self.worker.stopping
        except Exception as error:
            return self._guard(response, error)
        return response

    async def _simulate_motion(self, handle: ServerGoalHandle) -> SimulateMotion.Result:
        """Carry out one goal of the action, with progress reports and cancelling."""
        result = SimulateMotion.Result()
        try:
            simulation = SimulationRequest.from_request(handle.request, self._require())
            report = Progress(handle, simulation.duration, self.worker)
            await self.worker.submit(lambda: simulation.run(result, report), self.max_waiting)
        except Exception as error:
            handle.abort()
            return self._guard(result, error)
        if handle.is_cancel_requested:
            result.message = f'cancelled at {report.reached:g} s of {simulation.duration:g} s'
            handle.canceled()
        elif self.worker.stopping:
            result.message = 'the node is shutting down'
            handle.abort()
        else:
            result.success = True
            handle.succeed()
        return result


class Progress:
    """Reports how far a goal has got, and says whether to go on with it."""

    def __init__(self, handle: ServerGoalHandle, duration: float, worker: Worker) -> None:
        self.reached = 0.0
        self._handle, self._duration, self._worker = handle, duration, worker
        self._due = time.monotonic()

    def __call__(self, t: float) -> bool:
        """Take the simulated time; return False to end the simulation."""
        self.reached = t
        if self._worker.stopping or self._handle.is_cancel_requested:
            return False
        if time.monotonic() >= self._due:
            self._due = time.monotonic() + FEEDBACK_PERIOD
            self._handle.publish_feedback(SimulateMotion.Feedback(
                progress=min(t / self._duration, 1.0), simulated_time=t))
        return True


def _state(robot: Robot, request: Any, *fields: str) -> tuple[Any, ...]:
    """Return the order of a request and its vectors; velocity may be left out: at rest."""
    order = Order.of(robot, request.joint_names)
    q = closed(robot, vector(request.position, order.joints, robot.n_q, 'position'))
    return order, q, *(vector(getattr(request, field), order.speeds, robot.n, field,
                              0.0 if field == 'velocity' else None) for field in fields)


def _back(values: Any, index: Index | None) -> Any:
    """Return an (n,) or (n, n) array in the order of the request."""
    if index is None:
        return values
    result = np.empty_like(values)
    result[index if values.ndim == 1 else np.ix_(index, index)] = values
    return result


def _constraint_forces(robot: Robot, response: Any, *state: Any) -> None:
    """Fill in what the constraints exert."""
    response.constraint_names = list(robot.constraint_names)
    if robot.constraint_names:
        response.constraint_forces = doubles(robot.constraint_forces(*state))


def inverse_dynamics(served: ServedRobot, request: Any, response: Any) -> None:
    """Answer with the torques of a motion, and with what joints and constraints transmit."""
    robot = served.robot
    order, q, u, udot = _state(robot, request, 'velocity', 'acceleration')
    tau = robot.inverse_dynamics(q, u, udot)
    names = response.joint_names = order.joint_names
    response.effort = doubles(_back(robot.joint_torques(tau, q), order.joints))
    joints = [body.joint.name for body in robot.model.bodies]
    reactions = robot.joint_reactions(q, u, udot)
    response.joint_reactions = [as_wrench(reactions[joints.index(name)]) for name in names]
    _constraint_forces(robot, response, q, u, tau)


def forward_dynamics(served: ServedRobot, request: Any, response: Any) -> None:
    """Answer with the accelerations that torques cause."""
    robot = served.robot
    order, q, u, tau = _state(robot, request, 'velocity', 'effort')
    response.joint_names = order.speed_names
    response.acceleration = doubles(_back(robot.forward_dynamics(q, u, tau), order.speeds))
    _constraint_forces(robot, response, q, u, tau)


def get_dynamics(served: ServedRobot, request: Any, response: Any) -> None:
    """Answer with mass matrix, forces and energies."""
    robot = served.robot
    order, q, u = _state(robot, request, 'velocity')
    response.joint_names = order.speed_names
    response.mass_matrix = doubles(_back(robot.mass_matrix(q), order.speeds))
    friction = robot.torque_terms(q, u, np.zeros(robot.n))[TORQUE_TERMS.index('friction')]
    for field, values in (('bias_force', robot.bias_force(q, u)),
                          ('gravity_force', robot.gravity_force(q)),
                          ('friction_force', friction)):
        setattr(response, field, doubles(_back(values, order.speeds)))
    response.kinetic_energy = float(robot.kinetic_energy(q, u))
    response.potential_energy = float(robot.potential_energy(q))


def explain(served: ServedRobot, request: Any, response: Any) -> None:
    """Answer with the torques of a motion by source and by body, and their power."""
    robot = served.robot
    order, q, u, udot = _state(robot, request, 'velocity', 'acceleration')
    wrench = wrenches_of_request(served.frames, q, request.wrenches)
    response.explanation = explanation_message(robot, (q, u, udot), wrench,
                                               order.speed_names, order.speeds)
