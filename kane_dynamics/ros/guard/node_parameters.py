"""The parameters of the dynamics node, read by its parameter service."""

from collections.abc import Callable, Mapping
from typing import Any

from kane_dynamics.ros.parameters.parameter_checks import read, with_prefix
from kane_dynamics.ros.parameters.parameter_table import SPECS
from rcl_interfaces.srv import GetParameters
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python

UNUSED = ('imu', 'observer', 'trajectory', 'simulation')
SHARED = tuple(spec for spec in SPECS if spec.name.partition('.')[0] not in UNUSED)
SIMULATED_TIME = 'use_sim_time'
NAMES = (*(spec.name for spec in SHARED), SIMULATED_TIME)


class NodeParameters:
    """
    Reads the parameters of the dynamics node when it says that they changed.

    Parameters
    ----------
    node : Node
        The guard.
    target : str
        Name of the dynamics node.
    use : callable
        Called with the checked values by name, including `use_sim_time`; frame names
        include the prefix. An InputError of a value is passed on to the executor.

    """

    def __init__(self, node: Node, target: str,
                 use: Callable[[Mapping[str, Any]], None]) -> None:
        self._client = node.create_client(GetParameters, f'{target}/get_parameters')
        self._use = use
        self._wanted = False
        self._pending: Any = None

    def request(self) -> None:
        """Read the parameters as soon as the service answers."""
        self._wanted = True
        self.poll()

    def poll(self) -> None:
        """Send the request if one is wanted and the service is there; call regularly."""
        if self._wanted and self._client.service_is_ready():
            self._wanted = False
            if self._pending is not None:
                self._client.remove_pending_request(self._pending)
            request = GetParameters.Request(names=list(NAMES))
            self._pending = self._client.call_async(request)
            self._pending.add_done_callback(self._answered)

    def _answered(self, future: Any) -> None:
        if future is not self._pending:  # of an older configuration
            return
        self._pending = None
        answers = dict(zip(NAMES, map(parameter_value_to_python,
                                      future.result().values)))
        values = {}
        for spec in SHARED:
            value = answers[spec.name]
            values[spec.name] = read(spec, spec.default if value is None else value)
        simulated = bool(answers[SIMULATED_TIME])
        self._use(with_prefix(values) | {SIMULATED_TIME: simulated})
