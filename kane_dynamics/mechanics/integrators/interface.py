"""The interface between integrators and the systems that they integrate."""

from typing import Any, Protocol


class System(Protocol):
    """
    System to integrate over one step; its state is q, u and further quantities (quadratures).

    `moment` is 0 at the beginning of the step, 1 in the middle and 2 at the end: inputs such as a
    desired motion differ between them.
    """

    @property
    def equations(self) -> Any:
        """Return the equations of motion."""

    def rates(self, state: Any, moment: int) -> Any:
        """Return the time derivative of the whole state."""

    def torque(self, q: Any, u: Any, moment: int) -> Any:
        """Return the generalized force of actuators, (n,)."""

    def implicit_stage(self, q: Any, u: Any, tau: Any, before: tuple[Any, Any], g: Any,
                       moment: int) -> tuple[Any, Any]:
        """Return joint rates and udot of a stage; see `rosenbrock.ImplicitStep.stage`."""

    def quadratures(self, q: Any, u: Any, moment: int) -> Any:
        """Return the time derivative of the quadratures, which are integrated beside q and u."""


class Integrator(Protocol):
    """
    A one-step method.

    Attributes
    ----------
    name : str
        Name by which users choose it.
    damps : bool
        Whether it damps vibrations that the step does not resolve. Friction, springs and beams
        then do not limit the step, but their vibrations lose energy.

    """

    @property
    def name(self) -> str:
        """Return the name."""

    @property
    def damps(self) -> bool:
        """Return whether it damps unresolved vibrations."""

    def step(self, system: System, state: Any, h: Any) -> Any:
        """Return the state after one step of length h, s."""
