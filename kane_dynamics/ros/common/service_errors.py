"""
The services that ROS itself offers on a node, answered whatever a request holds.

rclpy lets errors through of transitions that are not possible now and of parameter values of no
type. They are the requester's, who gets an answer; no torque stops for them.
"""

from collections.abc import Callable
from typing import Any

from rcl_interfaces.msg import SetParametersResult
from rclpy.node import Node


def guard_services(node: Node) -> None:
    """Let every service that a node has by now answer that it failed, rather than not at all."""
    for service in node.services:
        service.callback = _answering(service.callback, node.get_logger())


def _answering(callback: Callable[[Any, Any], Any], log: Any) -> Callable[[Any, Any], Any]:
    """Return a service's callback that does not raise."""
    def answer(request: Any, response: Any) -> Any:
        try:
            return callback(request, response)
        except Exception as error:
            reason = f'{type(error).__name__}: {error}'
            log.error(f'a request was refused: {reason}')
            refused = SetParametersResult(successful=False, reason=reason)
            if hasattr(response, 'results'):  # of several parameters, those before hold
                done = list(response.results)
                response.results = done + [refused] * (len(request.parameters) - len(done))
            elif isinstance(getattr(response, 'result', None), SetParametersResult):
                response.result = refused
            return response  # success, where a response has it, is false by default
    return answer
