"""
Joint impedance: joints held to a desired motion by springs and dampers.

    tau = M udot_r + C(q, u) u_r + gravity + springs + friction(u_r)
          + T_c^T (K (q_d - q_c) + D (q'_d - q'_c))

for the joints c that follow, q'_c = T_c u + X_c, with the speeds u_r at which they have
the desired rates. In joint rates without constraints T_c = 1 and u_r = u_d. D is stated,
or gives every mode of the inertia on the springs a damping ratio (`modal_damping`). The
inertia is not shaped, so that stiffness and damping are those that a hand feels; while
the target rests, kinetic plus spring energy does not rise (`reference_dynamics`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from kane_dynamics._util.checks import finite_row, instance, per_joint
from kane_dynamics._util.fixed_attributes import guarded_class
from kane_dynamics._util.typing import Array, Scalar, Vector
from kane_dynamics.control.computed_torque import followed_joints, law_margin
from kane_dynamics.control.terms import EVERY_TERM, Terms
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.ball_joints import require_angles
from kane_dynamics.mechanics.constraints.conditioning import guarded as nan_unless
from kane_dynamics.mechanics.constraints.mechanism import JointMotion
from kane_dynamics.robot.robot import Robot
from kane_dynamics.robot.robot_function import identifier
from kane_dynamics.task_space.frame_task import inverse_mass
from kane_dynamics.task_space.law_kernel import (checked_terms, LanesOf, Law,
                                                 law_kernel, RunTimeSettings, Settings,
                                                 StateAt)
from kane_dynamics.task_space.modal_damping import joint_damping, RATIO
from kane_dynamics.task_space.reference_dynamics import (compensation_weights,
                                                         reference_dynamics, WEIGHTS)
import numpy as np
from numpy.typing import ArrayLike


@guarded_class
class JointImpedance(RunTimeSettings):
    """
    Joint impedance: a spring and a damper at each joint, with the model compensated.

    Parameters
    ----------
    robot : Robot
        A robot without beams and ball joints.
    stiffness : float or (n,) array_like
        N m/rad or N/m, of the joints that follow.
    damping : float or (n,) array_like, optional
        N m s/rad or N s/m, in place of the damping by ratio.
    damping_ratio : float or (n,) array_like, optional
        Of the modes of the joints' inertia on their springs, at each state; 0.7 by
        default. If the ratios of joints differ, each mode has one between the smallest
        and the largest.
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

    _changeable = ('stiffness', 'damping', 'damping_ratio', 'compensate')

    def __init__(self, robot: Robot, *, stiffness: ArrayLike,
                 damping: ArrayLike | None = None,
                 damping_ratio: ArrayLike | None = None, compensate: Terms = EVERY_TERM,
                 followed: Sequence[str] | None = None) -> None:
        """Check the settings and compile the kernel."""
        instance(robot, Robot, 'robot')
        require_angles(robot.model, 'JointImpedance')
        self._places = followed_joints(robot, followed)
        self.followed = tuple(robot.coordinate_names[k] for k in self._places)
        # Settings in one row, so that they change without a new kernel.
        n = robot.n
        super().__init__(robot, Settings({'stiffness': (n,), 'damping': (n,),
                                          'ratio': (n,), 'weights': (len(WEIGHTS),)}))
        self._zero = np.zeros(n)
        # Damping by ratio takes time, so that it has a kernel of its own.
        self._entries: dict[bool, Callable[..., Array]] = {}
        self.update(stiffness=stiffness, damping=damping, damping_ratio=damping_ratio,
                    compensate=compensate)

    def update(self, **settings: Any) -> None:
        """
        Change settings of the constructor between two calls; the others stay.

        On an InputError no setting changes. Damping by ratio after a stated one, or the
        other way round, is compiled at its first use.
        """
        # Compile before the settings change: calls of other threads have the old ones
        # meanwhile.
        damping = {**self._values, **settings}['damping']
        law = self._entry(damping is None)
        super().update(**settings)
        self._law = law

    def __getstate__(self) -> dict[str, Any]:
        """Return the attributes of a copy, without the entry points of this object."""
        return {**super().__getstate__(), '_entries': {}}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore a copy, and compile its law for its own robot."""
        self.__dict__.update(state)
        self._law = self._entry(self._values['damping'] is None)

    def _entry(self, by_ratio: bool) -> Callable[..., Array]:
        """Return the entry point for a kind of damping, compiled at its first use."""
        if by_ratio not in self._entries:
            self._entries[by_ratio] = self._compiled(by_ratio)
        return self._entries[by_ratio]

    def _checked(self, values: dict[str, Any]) -> dict[str, Any]:
        """Return the numbers of the kernel by name, from checked settings."""
        # Damping is stated by itself or by a ratio; the default is a ratio.
        damping = values['damping']
        ratio = values['damping_ratio']
        if damping is None:
            damping = 0.0
            ratio = RATIO if ratio is None else ratio
        elif ratio is None:
            ratio = 0.0
        else:
            raise InputError('damping, damping_ratio: both given; expected one')
        return {
            'stiffness': per_joint(values['stiffness'], 'stiffness', self.followed),
            'damping': per_joint(damping, 'damping', self.followed),
            'ratio': per_joint(ratio, 'damping_ratio', self.followed),
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
        return law(q, u, q_d, u_d, udot_d, fields['_block'], t)

    def energy(self, q: ArrayLike, q_d: ArrayLike) -> float:
        """Return the energy that the springs store, J."""
        measured = finite_row(q, 'q', self.robot.coordinate_names)[list(self._places)]
        stretch = measured - finite_row(q_d, 'q_d', self.followed)
        stiffness = self._shapes.unpacked(self._block)['stiffness']
        with np.errstate(over='ignore'):  # infinite far beyond every mechanism
            return float(0.5 * stiffness @ stretch**2)

    def _compiled(self, by_ratio: bool) -> Callable[..., Array]:
        """Return the entry point of the law with damping by ratio, or a stated one."""
        robot = self.robot
        n = robot.n
        shapes = self._shapes
        places = self._places

        def law_of(choice: Robot, lanes_of: LanesOf) -> Law:
            return _law(choice, places, shapes, by_ratio, lanes_of)
        inputs = {'q': (robot.n_q,), 'u': (n,), 'q_d': (n,), 'u_d': (n,),
                  'udot_d': (n,), 'settings': (shapes.size,)}
        # Kind of damper and followed joints are part of the program.
        damper = 'by_ratio' if by_ratio else 'stated'
        name = identifier('joint_impedance', damper, *map(str, places))
        kernel = law_kernel(robot, law_of, name, inputs, (robot.n_q,), places)
        return kernel.entry('', kernel)


def compile_dampers(law: JointImpedance) -> None:
    """Compile the law of an object for both kinds of damping, between which it changes."""
    for by_ratio in (False, True):
        law._entry(by_ratio)


def joint_impedance_law(law: JointImpedance, lanes_of: LanesOf) -> Law:
    """
    Return the law of an object as a function over any scalar, for either damping.

    Its arguments are q, u, q_d, u_d, udot_d and the settings of the object.
    """
    return _law(law.robot, law._places, law._shapes, True, lanes_of)


def _law(robot: Robot, followed: Sequence[int], shapes: Settings, by_ratio: bool,
         lanes_of: LanesOf) -> Law:
    """Return the law as a function over any scalar; see the module."""
    equations = robot.equations
    places = list(followed)

    def law(q: Vector, u: Vector, q_d: Vector, u_d: Vector, udot_d: Vector,
            settings: Vector, *, t: Scalar, parameters: Vector) -> Vector:
        values = shapes.unpacked(settings)
        motion = equations.joint_motion(q, u, equations.zeros, t)
        # Spring and damper between the desired and the measured joints.
        rates = u_d - motion.qdot[places]
        force = values['stiffness'] * (q_d - q[places]) + values['damping'] * rates
        if by_ratio:
            # A damper by ratio depends on the mobility of the followed joints, W.
            T_c = motion.T[places]
            lanes = lanes_of(q[0])
            W = T_c @ inverse_mass(equations, q, parameters, t, lanes) @ T_c.T
            force = force + joint_damping(W, values['stiffness'], values['ratio'], rates,
                                          lanes)
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
