"""The quantities of a robot's kernels: names, arguments and shapes."""

from dataclasses import dataclass
from typing import NamedTuple

from kane_dynamics.mechanics.recursive.tree_equations import TORQUE_TERMS
from kane_dynamics.native.tracing.program import Shape


class Sizes(NamedTuple):
    """Numbers of independent speeds, coordinates, joints, bodies, and rows of constraints."""

    n: int
    n_q: int
    joints: int
    bodies: int
    rows: int

    @property
    def inertial_parameters(self) -> int:
        """Return the number of inertial parameters of all bodies."""
        return 10 * self.bodies

    @property
    def slopes(self) -> int:
        """Return the number of columns of dtau/dq, dtau/du and dtau/dudot together."""
        return self.n_q + 2 * self.n

    def shape(self, entries: tuple[int | str, ...]) -> Shape:
        """Return the shape whose entries are numbers or names of these sizes."""
        return tuple(getattr(self, x) if isinstance(x, str) else x for x in entries)


@dataclass(frozen=True)
class Quantity:
    """
    The quantity of a kernel.

    Attributes
    ----------
    arguments : tuple of str
        Arguments of the equations' method of that name, before the wrench and the parameters.
    shape : tuple of int and str
        Shape of the result; names are those of `Sizes`.
    wrench, parameters : bool
        Whether the method has these arguments.

    """

    arguments: tuple[str, ...]
    shape: tuple[int | str, ...]
    wrench: bool = False
    parameters: bool = True


STATE, MOTION, LOADED = ('q', 'u'), ('q', 'u', 'udot'), ('q', 'u', 'tau')
QUANTITIES = {
    'inverse_dynamics': Quantity(MOTION, ('n',), wrench=True),
    'forward_dynamics': Quantity(LOADED, ('n',), wrench=True),
    'mass_matrix': Quantity(('q',), ('n', 'n')),
    'inverse_mass_matrix': Quantity(('q',), ('n', 'n')),
    'bias_force': Quantity(STATE, ('n',)),
    'coriolis_matrix': Quantity(STATE, ('n', 'n')),
    'gravity_force': Quantity(('q',), ('n',)),
    'friction_force': Quantity(('u',), ('n',), parameters=False),
    'external_force': Quantity(('q',), ('n',), wrench=True, parameters=False),
    'torque_terms': Quantity(MOTION, (len(TORQUE_TERMS), 'n')),
    'body_torques': Quantity(MOTION, ('bodies', 'n')),
    'joint_reactions': Quantity(MOTION, ('bodies', 6), wrench=True),
    'center_of_mass': Quantity(('q',), (3,)),
    'center_of_mass_jacobian': Quantity(('q',), (3, 'n')),
    'kinetic_energy': Quantity(STATE, ()),
    'potential_energy': Quantity(('q',), ()),
    'inverse_dynamics_derivatives': Quantity(MOTION, (3, 'n', 'n')),
    'forward_dynamics_derivatives': Quantity(LOADED, (3, 'n', 'n')),
    'regressor': Quantity(MOTION, ('n', 'inertial_parameters')),
}
# Where speeds are chosen or constraints given. In joint rates without constraints, those of joints
# are the argument itself: kernels of them are made only where they are asked for by name.
CONSTRAINED = {
    'joint_rates': Quantity(STATE, ('n_q',), parameters=False),
    'joint_torques': Quantity(('tau', 'q'), ('joints',), parameters=False),
    'constraint_forces': Quantity(LOADED, ('rows',), wrench=True),
    'constraint_residual': Quantity(('q',), ('rows',), parameters=False),
    'constraint_velocity_residual': Quantity(STATE, ('rows',), parameters=False),
    'joint_accelerations': Quantity(MOTION, ('joints',), parameters=False),
    'friction_force': Quantity(('u', 'q'), ('n',), parameters=False),
}
# Quantities that are valid for open loops and any choice of independent speeds:
UNWATCHED = ('potential_energy', 'constraint_residual', 'frame_pose')
# Quantities of control and simulation, which a node compiles in configure.
IN_LOOPS = ('inverse_dynamics', 'forward_dynamics', 'mass_matrix', 'inverse_mass_matrix',
            'bias_force', 'gravity_force', 'friction_force', 'torque_terms', 'joint_reactions',
            'kinetic_energy', 'potential_energy')
FRAME_QUANTITIES = {
    'frame_pose': Quantity(('q',), (4, 4), parameters=False),
    'frame_velocity': Quantity(STATE, (6,), parameters=False),
    'frame_acceleration': Quantity(MOTION, (6,), parameters=False),
    'partial_velocities': Quantity(('q',), (6, 'n'), parameters=False),
    'partial_velocity_rates': Quantity(STATE, (6, 'n'), parameters=False),
}
JOINT_REACTION = Quantity(MOTION, (6,), wrench=True)
