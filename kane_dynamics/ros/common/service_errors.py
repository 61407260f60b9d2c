"""
Callbacks of requests whose errors do not stop the torque path.

rclpy raises on a lifecycle transition that is not possible and on a parameter value
without type. The error is returned to the client.
"""

from collections.abc import Callable
from functools import wraps
from typing import Any

from rcl_interfaces.msg import SetParametersResult
from rclpy.node import Node


def answer_service_errors(node: Node) -> None:
    """Make each service of a node answer with a failure when its callback raises."""
    for service in node.services:
        service.callback = _answering(service.callback, node.get_logger())


def reported(callback: Callable[..., None], log: Any) -> Callable[..., None]:
    """Return a callback of a timer or a topic that logs its errors and does not raise."""
    @wraps(callback)
    def call(*arguments: Any, **options: Any) -> None:
        try:
            callback(*arguments, **options)
        except Exception as error:
            log.error(f'request failed: {type(error).__name__}: {error}')
    return call


def later(service: Any) -> None:
    """Let the callback of a service return a future, whose result is the answer."""
    send = service.send_response

    def send_when_done(answer: Any, header: Any) -> None:
        answer.add_done_callback(lambda done: send(done.result(), header))
    # rclpy's EventsExecutor awaits no callback of a service.
    service.send_response = send_when_done


def _answering(callback: Callable[[Any, Any], Any], log: Any) -> Callable[[Any, Any],
                                                                          Any]:
    """Return a service callback that logs errors and does not raise."""
    def answer(request: Any, response: Any) -> Any:
        try:
            return callback(request, response)
        except Exception as error:
            reason = f'{type(error).__name__}: {error}'
            log.error(f'request refused: {reason}')
            refused = SetParametersResult(successful=False, reason=reason)
            if hasattr(response, 'results'):  # parameters before the faulty one are set
                done = list(response.results)
                missing = len(request.parameters) - len(done)
                response.results = done + [refused] * missing
            elif isinstance(getattr(response, 'result', None), SetParametersResult):
                response.result = refused
            return response  # `success` is false by default
    return answer
