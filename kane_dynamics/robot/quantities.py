"""The quantities of a robot's kernels: names, arguments and shapes."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

from kane_dynamics.mechanics.recursive.tree_equations import TORQUE_TERMS
from kane_dynamics.native.tracing.program import Shape


class Sizes(NamedTuple):
    """Numbers of independent speeds, coordinates, bodies, and rows of constraints."""

    n: int
    n_q: int
    bodies: int
    rows: int


@dataclass(frozen=True)
class Quantity:
    """
    The quantity of a kernel.

    Attributes
    ----------
    arguments : tuple of str
        Arguments of the equations' method of that name, before the wrench and the parameters.
    shape : callable
        Shape of the result from the `Sizes` of a robot.
    wrench, parameters : bool
        Whether the method has these arguments.

    """

    arguments: tuple[str, ...]
    shape: Callable[[Sizes], Shape]
    wrench: bool = False
    parameters: bool = True


def _scalar(size: Sizes) -> Shape:
    return ()


def _vector(size: Sizes) -> Shape:
    return (size.n,)


def _joints(size: Sizes) -> Shape:
    return (size.n_q,)


def _rows(size: Sizes) -> Shape:
    return (size.rows,)


def _matrix(size: Sizes) -> Shape:
    return (size.n, size.n)


def _three_matrices(size: Sizes) -> Shape:
    return (3, size.n, size.n)


def _wrench(size: Sizes) -> Shape:
    return (6,)


def _partials(size: Sizes) -> Shape:
    return (6, size.n)


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
    'torque_terms': Quantity(MOTION, lambda size: (len(TORQUE_TERMS), size.n)),
    'body_torques': Quantity(MOTION, lambda size: (size.bodies, size.n)),
    'joint_reactions': Quantity(MOTION, lambda size: (size.bodies, 6), wrench=True),
    'center_of_mass': Quantity(('q',), lambda size: (3,)),
    'center_of_mass_jacobian': Quantity(('q',), lambda size: (3, size.n)),
    'kinetic_energy': Quantity(STATE, _scalar),
    'potential_energy': Quantity(('q',), _scalar),
    'inverse_dynamics_derivatives': Quantity(MOTION, _three_matrices),
    'forward_dynamics_derivatives': Quantity(LOADED, _three_matrices),
    'regressor': Quantity(MOTION, lambda size: (size.n, 10 * size.bodies)),
}
# Where speeds are chosen or constraints given:
CONSTRAINED = {
    'joint_rates': Quantity(STATE, _joints, parameters=False),
    'joint_torques': Quantity(('q', 'tau'), _joints, parameters=False),
    'constraint_forces': Quantity(LOADED, _rows, wrench=True),
    'constraint_residual': Quantity(('q',), _rows, parameters=False),
    'constraint_velocity_residual': Quantity(STATE, _rows, parameters=False),
    'joint_accelerations': Quantity(MOTION, _joints, parameters=False),
}
# Quantities that are valid for open loops and any choice of independent speeds:
UNWATCHED = ('potential_energy', 'friction_force', 'constraint_residual', 'frame_pose')
# Quantities of control and simulation, which a node compiles in configure.
IN_LOOPS = ('inverse_dynamics', 'forward_dynamics', 'mass_matrix', 'inverse_mass_matrix',
            'bias_force', 'gravity_force', 'friction_force', 'torque_terms', 'joint_reactions',
            'kinetic_energy', 'potential_energy')
FRAME_QUANTITIES = {
    'frame_pose': Quantity(('q',), lambda size: (4, 4), parameters=False),
    'frame_velocity': Quantity(STATE, _wrench, parameters=False),
    'frame_acceleration': Quantity(MOTION, _wrench, parameters=False),
    'partial_velocities': Quantity(('q',), _partials, parameters=False),
    'partial_velocity_rates': Quantity(STATE, _partials, parameters=False),
}
JOINT_REACTION = Quantity(MOTION, _wrench, wrench=True)
