"""
Joint impedance: joints held to a desired motion by springs and dampers.

    tau = M udot_r + C(q, u) u_r + gravity + springs + friction(u_r)
          + T_c^T (K (q_d - q_c) + D (q'_d - q'_c))

for the joints c that follow, q'_c = T_c u + X_c, with the speeds u_r at which they have
the desired rates. In joint rates without constraints T_c = 1 and u_r = u_d. The inertia
is not shaped, so that stiffness and damping are those that a hand feels; while the
target rests, kinetic plus spring energy does not rise (`reference_dynamics`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from kane_dynamics._util.attribute_hints import guarded
from kane_dynamics._util.checks import finite_row, instance, per_joint
from kane_dynamics._util.typing import Array, Scalar, Vector
from kane_dynamics.control.computed_torque import followed_joints, law_margin
from kane_dynamics.control.terms import EVERY_TERM, Terms
from kane_dynamics.mechanics.ball_joints import require_angles
from kane_dynamics.mechanics.constraints.conditioning import guarded as nan_unless
from kane_dynamics.mechanics.constraints.mechanism import JointMotion
from kane_dynamics.robot.robot import Robot
from kane_dynamics.task_space.law_kernel import (checked_terms, identifier, LanesOf, Law,
                                                 law_kernel, RunTimeSettings, Settings,
                                                 StateAt)
from kane_dynamics.task_space.reference_dynamics import (compensation_weights,
                                                         reference_dynamics, WEIGHTS)
import numpy as np
from numpy.typing import ArrayLike


@guarded
class JointImpedance(RunTimeSettings):
    """
    Joint impedance: a spring and a damper at each joint, with the model compensated.

    Parameters
    ----------
    robot : Robot
        A robot without beams and ball joints.
    stiffness : float or (n,) array_like
        N m/rad or N/m, of the joints that follow.
    damping : float or (n,) array_like
        N m s/rad or N s/m.
    compensate : Terms
        The terms of the model that are compensated. Springs of the model always are.
    followed : sequence of str, optional
        With chosen speeds or constraints: the joints that follow, as for
        `ComputedTorque`.

    Raises
    ------
    InputError
        Names the argument, the joint, the value and what is expected.

    """

    _changeable = ('stiffness', 'damping', 'compensate')

    def __init__(self, robot: Robot, *, stiffness: ArrayLike, damping: ArrayLike,
                 compensate: Terms = EVERY_TERM,
                 followed: Sequence[str] | None = None) -> None:
        """Check the settings and compile the kernel."""
        instance(robot, Robot, 'robot')
        require_angles(robot.model, 'JointImpedance')
        self._places = followed_joints(robot, followed)
        self.followed = tuple(robot.coordinate_names[k] for k in self._places)
        # Settings in one row, so that they change without a new kernel.
        n = robot.n
        super().__init__(robot, Settings({'stiffness': (n,), 'damping': (n,),
                                          'weights': (len(WEIGHTS),)}))
        self._zero = np.zeros(n)
        self.update(stiffness=stiffness, damping=damping, compensate=compensate)
        self._law = self._compiled()

    def _checked(self, values: dict[str, Any]) -> dict[str, Any]:
        """Return the numbers of the kernel by name, from checked settings."""
        return {
            'stiffness': per_joint(values['stiffness'], 'stiffness', self.followed),
            'damping': per_joint(values['damping'], 'damping', self.followed),
            'weights': compensation_weights(checked_terms(values['compensate']))}

    def torque(self, q: ArrayLike, u: ArrayLike, q_d: ArrayLike,
               u_d: ArrayLike | None = None, udot_d: ArrayLike | None = None,
               t: float = 0.0) -> Array:
        """
        Return the torques of the joints, (n_q,).

        Parameters
        ----------
        q, u : (n_q,), (n,) array_like
            The measured state, rad or m, s.
        q_d : (n,) array_like
            Desired positions of the joints that follow.
        u_d, udot_d : (n,) array_like, optional
            Their rates and accelerations. Default: at rest.
        t : float
            Time, s, where speeds or constraints depend on it.

        Raises
        ------
        InputError
            A wrong shape, or a number that is not finite.
        ConstraintError
            The configuration is open or singular, or the joints do not determine the
            motion there.

        """
        # Each attribute of a class with hints takes as long to read as ten of these.
        fields = self.__dict__
        if u_d is None:
            u_d = fields['_zero']
        if udot_d is None:
            udot_d = fields['_zero']
        law: Callable[..., Array] = fields['_law']
        block = fields['_block']
        if fields['_timed']:
            return law(q, u, q_d, u_d, udot_d, block, t)
        return law(q, u, q_d, u_d, udot_d, block)

    def energy(self, q: ArrayLike, q_d: ArrayLike) -> float:
        """Return the energy that the springs store, J."""
        measured = finite_row(q, 'q', self.robot.coordinate_names)[list(self._places)]
        stretch = measured - finite_row(q_d, 'q_d', self.followed)
        stiffness = self._shapes.unpacked(self._block)['stiffness']
        with np.errstate(over='ignore'):  # infinite far beyond every mechanism
            return float(0.5 * stiffness @ stretch**2)

    def _compiled(self) -> Callable[..., Array]:
        """Return the entry point of the law."""
        robot = self.robot
        n = robot.n
        shapes = self._shapes
        places = self._places

        def law_of(choice: Robot, _: LanesOf) -> Law:
            return _law(choice, places, shapes)
        inputs = {'q': (robot.n_q,), 'u': (n,), 'q_d': (n,), 'u_d': (n,),
                  'udot_d': (n,), 'settings': (shapes.size,)}
        name = identifier('joint_impedance', *map(str, places))
        kernel = law_kernel(robot, law_of, name, inputs, (robot.n_q,), places)
        return kernel.entry('', kernel)


def joint_impedance_law(law: JointImpedance) -> Law:
    """
    Return the law of an object as a function over any scalar.

    Its arguments are q, u, q_d, u_d, udot_d and the settings: stiffness, damping, weights
    of the compensation.
    """
    return _law(law.robot, law._places, law._shapes)


def _law(robot: Robot, followed: Sequence[int], shapes: Settings) -> Law:
    """Return the law as a function over any scalar; see the module."""
    equations = robot.equations
    places = list(followed)

    def law(q: Vector, u: Vector, q_d: Vector, u_d: Vector, udot_d: Vector,
            settings: Vector, *, t: Scalar, parameters: Vector) -> Vector:
        values = shapes.unpacked(settings)
        motion = equations.joint_motion(q, u, equations.zeros, t)
        force = (values['stiffness'] * (q_d - q[places])
                 + values['damping'] * (u_d - motion.qdot[places]))
        return compensated_torques(robot, places, (q, u, t, parameters), motion,
                                   (u_d, udot_d), force, values['weights'])
    return law


def compensated_torques(robot: Robot, followed: list[int], at: StateAt,
                        motion: JointMotion, desired: tuple[Vector, Vector],
                        force: Vector, weights: Vector) -> Vector:
    """
    Return the torques of a force beside the compensation, (n_q,), over any scalar.

    Parameters
    ----------
    robot : Robot
        Its speeds are those of u.
    followed : list of int
        The coordinates of the joints on which the force acts.
    at : tuple
        q, u, t and the robot's parameters.
    motion : JointMotion
        At q and u.
    desired : pair of (n,) arrays
        Rates and accelerations of these joints, rad/s, rad/s^2.
    force : (n,) array
        N m or N.
    weights : (4,) array
        Of the terms that are compensated.

    """
    equations = robot.equations
    mechanism = equations.mechanism
    q, u, t, parameters = at
    u_d, udot_d = desired
    T_c = motion.T[followed]

    # The reference motion, of which the joints that follow have the desired rates and
    # accelerations: T_c u_r + X_c = q'_d, T_c u_r' + T_c' u_r + X_c' = q''_d.
    difference = mechanism.solved(T_c, u_d - motion.qdot[followed])
    drift = motion.qddot[followed] + motion.T_rate[followed] @ difference
    udot_r = mechanism.solved(T_c, udot_d - drift)
    compensation = reference_dynamics(equations, q, u, u + difference, udot_r, weights,
                                      parameters, t)
    tau = equations.shared_torques(q, compensation + T_c.T @ force, t)
    if not equations.in_joint_rates:
        tau = nan_unless(tau, law_margin(robot, followed, q, t))
    return tau
