"""What a robot's kernels compute: their names, arguments and shapes."""

from collections.abc import Callable
from dataclasses import dataclass

from kane_dynamics.mechanics.equations import TORQUE_TERMS
from kane_dynamics.native.program import Shape


@dataclass(frozen=True)
class Quantity:
    """
    What a kernel computes.

    Attributes
    ----------
    arguments : tuple of str
        Of `Equations`' method of the same name, before the wrench and the parameters.
    shape : callable
        Shape of the result from the numbers of coordinates and of bodies.
    wrench, parameters : bool
        Whether the method takes these as well.

    """

    arguments: tuple[str, ...]
    shape: Callable[[int, int], Shape]
    wrench: bool = False
    parameters: bool = True


def _scalar(n: int, bodies: int) -> Shape:
    return ()


def _vector(n: int, bodies: int) -> Shape:
    return (n,)


def _matrix(n: int, bodies: int) -> Shape:
    return (n, n)


def _three_matrices(n: int, bodies: int) -> Shape:
    return (3, n, n)


def _wrench(n: int, bodies: int) -> Shape:
    return (6,)


def _partials(n: int, bodies: int) -> Shape:
    return (6, n)


STATE, MOTION, LOADED = ('q', 'u'), ('q', 'u', 'udot'), ('q', 'u', 'tau')
QUANTITIES = {
    'inverse_dynamics': Quantity(MOTION, _vector, wrench=True),
    'forward_dynamics': Quantity(LOADED, _vector, wrench=True),
    'mass_matrix': Quantity(('q',), _matrix),
    'inverse_mass_matrix': Quantity(('q',), _matrix),
    'bias_force': Quantity(STATE, _vector),
    'coriolis_matrix': Quantity(STATE, _matrix),
    'gravity_force': Quantity(('q',), _vector),
    'friction_force': Quantity(('u',), _vector, parameters=False),
    'external_force': Quantity(('q',), _vector, wrench=True, parameters=False),
    'torque_terms': Quantity(MOTION, lambda n, bodies: (len(TORQUE_TERMS), n)),
    'body_torques': Quantity(MOTION, lambda n, bodies: (bodies, n)),
    'kinetic_energy': Quantity(STATE, _scalar),
    'potential_energy': Quantity(('q',), _scalar),
    'inverse_dynamics_derivatives': Quantity(MOTION, _three_matrices),
    'forward_dynamics_derivatives': Quantity(LOADED, _three_matrices),
    'regressor': Quantity(MOTION, lambda n, bodies: (n, 10 * bodies)),
}
# What control and simulation call: a node compiles these before it serves.
IN_LOOPS = ('inverse_dynamics', 'forward_dynamics', 'mass_matrix', 'inverse_mass_matrix',
            'bias_force', 'gravity_force', 'friction_force', 'torque_terms', 'kinetic_energy',
            'potential_energy')
FRAME_QUANTITIES = {
    'frame_pose': Quantity(('q',), lambda n, bodies: (4, 4)),
    'frame_velocity': Quantity(STATE, _wrench),
    'frame_acceleration': Quantity(MOTION, _wrench),
    'partial_velocities': Quantity(('q',), _partials),
    'partial_velocity_rates': Quantity(STATE, _partials),
}
JOINT_REACTION = Quantity(MOTION, _wrench, wrench=True)
