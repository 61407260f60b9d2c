"""Forces along the joints: rotor inertia, friction and springs, over any scalar."""

from collections.abc import Callable
from typing import Any

from kane_dynamics.mechanics.friction import friction_slope, friction_torque
from kane_dynamics.model.beam import Beam
from kane_dynamics.model.model import Joint, Model
import numpy as np


class JointForces:
    """The methods of `TreeEquations` for rotors, friction and springs."""

    model: Model
    n: int
    friction: bool

    @property
    def zeros(self) -> Any:
        """Return n zeros, which add no operation to a traced program."""
        return np.zeros(self.n).astype(object)

    def armature(self, x: Any) -> Any:
        """Return the diagonal matrix of rotor inertias times x, (n,)."""
        return self._by_coordinate(lambda j: j.multiplier**2 * j.armature * x[j.coordinate])

    def friction_force(self, u: Any) -> Any:
        """Return the friction torque d u + mu tanh(u / u_s) + offset of every joint, (n,)."""
        if not self.friction:
            return self.zeros

        def force(joint: Joint) -> Any:
            rate = joint.multiplier * u[joint.coordinate]
            return joint.multiplier * friction_torque(joint, rate)
        return self._of_beams(self._by_coordinate(force),
                              lambda beam: beam.damping @ u[list(beam.coordinates)])

    def friction_slope(self, u: Any) -> Any:
        """Return d friction_force / du, (n,)."""
        if not self.friction:
            return self.zeros

        def slope(joint: Joint) -> Any:
            rate = joint.multiplier * u[joint.coordinate]
            return joint.multiplier**2 * friction_slope(joint, rate)
        return self._by_coordinate(slope)

    def spring_force(self, q: Any) -> Any:
        """Return the torque that balances springs k (position - rest) and beams K eta, (n,)."""
        springs = self._by_coordinate(lambda j: (j.multiplier * j.stiffness)
                                      * (position(j, q) - j.rest))
        return self._of_beams(springs, lambda beam: beam.stiffness @ q[list(beam.coordinates)])

    def elastic_force(self, beam: Beam, q: Any, u: Any) -> Any:
        """Return the force on a beam's modes that balances elasticity and damping, (m,)."""
        modes = list(beam.coordinates)
        force = beam.stiffness @ q[modes]
        return force + beam.damping @ u[modes] if self.friction else force

    def _of_beams(self, total: Any, force: Callable[[Beam], Any]) -> Any:
        """Return a force, (n,), plus the force of all beams on their modes."""
        result = list(total)
        for body in self.model.bodies:
            if body.beam is not None:
                for k, value in zip(body.beam.coordinates, force(body.beam)):
                    result[k] = result[k] + value
        return np.array(result)

    def _by_coordinate(self, force: Callable[[Joint], Any]) -> Any:
        """Sum a force of every joint on its coordinate, (n,)."""
        total = [0.0] * self.n
        for joint in (body.joint for body in self.model.bodies):
            total[joint.coordinate] = total[joint.coordinate] + force(joint)
        return np.array(total)


def position(joint: Joint, q: Any) -> Any:
    """Return the position of a joint, rad or m."""
    return joint.multiplier * q[joint.coordinate] + joint.offset
