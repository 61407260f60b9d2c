"""The interface between integrators and the systems that they integrate."""

from typing import Any, NamedTuple, Protocol

from kane_dynamics._util.typing import Scalar, Vector


class StageRates(NamedTuple):
    """
    Rates of one stage of linearly implicit equations.

    They are those of the joints, (n_j,), of the speeds, (n,), and of the deflections of
    bristles, (n_b,).
    """

    joints: Vector
    udot: Vector
    deflections: Vector = ()


class System(Protocol):
    """
    System to integrate over one step; its state is q, u and quadratures.

    If `bristles` is not 0, so many deflections follow the time among the quadratures,
    or u where the equations do not depend on the time.

    `moment` is 0 at the beginning of the step, 1 in the middle and 2 at the end: inputs
    such as a desired motion differ between them.
    """

    @property
    def equations(self) -> Any:
        """Return the equations of motion."""

    @property
    def bristles(self) -> int:
        """Return the number of joints whose friction has a state of its own."""

    def rates(self, state: Vector, moment: int) -> Vector:
        """Return the time derivative of the whole state."""

    def torque(self, q: Vector, u: Vector, moment: int) -> Vector:
        """Return the generalized force of actuators, (n,)."""

    def implicit_stage(self, q: Vector, u: Vector, tau: Vector,
                       first: StageRates, g: Scalar, moment: int,
                       deflections: Vector) -> StageRates:
        """Return the rates of a stage, as `rosenbrock.ImplicitStep.stage`."""

    def quadratures(self, q: Vector, u: Vector, moment: int) -> Vector:
        """Return the time derivative of what is integrated beside q, u and deflections."""


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
        """Return the name of the method, as users choose it."""

    @property
    def damps(self) -> bool:
        """Return whether it damps unresolved vibrations."""

    def step(self, system: System, state: Vector, h: Scalar) -> Vector:
        """Return the state after one step of length h, s."""
