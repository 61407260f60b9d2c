"""The interface between integrators and the motions that they integrate."""

from typing import Any, Protocol


class System(Protocol):
    """
    The motion during one step; its state is q, u and what is integrated beside them.

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

    def implicit_rates(self, q: Any, u: Any, tau: Any, resistance: Any, g: Any) -> Any:
        """Return udot of the linearly implicit equations; see `rosenbrock.ImplicitStep.rates`."""

    def resistance(self, u: Any) -> Any:
        """Return friction over speed, (n,), N m s or N s/m."""

    def quadratures(self, q: Any, u: Any, moment: int) -> Any:
        """Return the time derivative of what is integrated beside q and u."""


class Integrator(Protocol):
    """
    A one-step method.

    Attributes
    ----------
    name : str
        Name by which users choose it.
    damps : bool
        Whether it damps what the step does not resolve: then friction, springs and beams set no
        longest step, and energy is lost where they vibrate.

    """

    @property
    def name(self) -> str:
        """Return the name."""

    @property
    def damps(self) -> bool:
        """Return whether it damps unresolved vibrations."""

    def supports(self, equations: object) -> bool:
        """Return whether it can integrate these equations of motion."""

    def step(self, system: System, state: Any, h: Any) -> Any:
        """Return the state one step of length h, s, later."""
