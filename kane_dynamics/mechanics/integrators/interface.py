"""The interface between integrators and the systems that they integrate."""

from typing import Any, Protocol

from kane_dynamics._util.typing import Scalar, Vector


class System(Protocol):
    """
    System to integrate over one step; its state is q, u and quadratures.

    `moment` is 0 at the beginning of the step, 1 in the middle and 2 at the end: inputs
    such as a desired motion differ between them.
    """

    @property
    def equations(self) -> Any:
        """Return the equations of motion."""

    def rates(self, state: Vector, moment: int) -> Vector:
        """Return the time derivative of the whole state."""

    def torque(self, q: Vector, u: Vector, moment: int) -> Vector:
        """Return the generalized force of actuators, (n,)."""

    def implicit_stage(self, q: Vector, u: Vector, tau: Vector,
                       first: tuple[Vector, Vector], g: Scalar,
                       moment: int) -> tuple[Vector, Vector]:
        """Return joint rates and udot of a stage, as `rosenbrock.ImplicitStep.stage`."""

    def quadratures(self, q: Vector, u: Vector, moment: int) -> Vector:
        """Return the time derivative of what is integrated beside q and u."""


class Integrator(Protocol):
    """
    A one-step method.

    Attributes
    ----------
    name : str
        Name by which users choose it.
    damps : bool
        Whether it damps vibrations that the step does not resolve. Friction, springs and
        beams then do not limit the step, but their vibrations lose energy.

    """

    @property
    def name(self) -> str:
        """Return the name."""

    @property
    def damps(self) -> bool:
        """Return whether it damps unresolved vibrations."""

    def step(self, system: System, state: Vector, h: Scalar) -> Vector:
        """Return the state after one step of length h, s."""
