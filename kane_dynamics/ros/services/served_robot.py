"""The robots and settings that serve requests."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from kane_dynamics.control.quasi_static import QuasiStatic
from kane_dynamics.robot.robot import Robot
from kane_dynamics.ros.common.conversion import Array
from kane_dynamics.ros.loads.gravity_payload import GravityAndPayload
from kane_dynamics.ros.loads.wrench_input import WrenchFrames
from kane_dynamics.simulation.contact import Contact


RIGID = 'flexible links treated as rigid'
QUASI_STATIC = ('effort with the quasi-static deflection of flexible links, reactions '
                'and constraint forces without')


@dataclass(frozen=True)
class ServedRobot:
    """
    The robots, loads and settings that serve requests.

    Attributes
    ----------
    robot, simulated : Robot
        The robots of the services' thread and of the simulation thread.
    loads : GravityAndPayload
        Gravity and payload, applied to a robot before each request.
    values : mapping
        The node's parameters; gains.*, simulation.* and trajectory.max_points are used.
    frames : WrenchFrames
        Frames of `robot` at which a request may apply wrenches.
    bending : QuasiStatic, optional
        The flexible arm of which `robot` is the rigid model, for filled trajectories and
        inverse dynamics.
    measured : callable
        Returns the measured positions, (n,), or None.
    measured_speeds : callable
        Returns the speeds of that state, (n,), or None.
    require_kernels : callable
        `LaterKernels.require`; for workers.
    contacts : sequence of Contact
        Of the simulated robot.

    """

    robot: Robot
    simulated: Robot
    loads: GravityAndPayload
    values: Mapping[str, Any]
    frames: WrenchFrames
    bending: QuasiStatic | None = None
    measured: Callable[[], Array | None] = lambda: None
    measured_speeds: Callable[[], Array | None] = lambda: None
    require_kernels: Callable[..., bool] = lambda group, proceed=None: True
    contacts: Sequence[Contact] = ()

    def apply_loads(self) -> None:
        """Set gravity and payload of the robots of the services' thread."""
        self.loads.apply(self.robot)
        if self.bending is not None:
            self.loads.apply(self.bending.robot)
