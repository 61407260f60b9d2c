"""
Mass matrix by the composite rigid body algorithm (CRBA).

A unit acceleration of one joint moves its subtree as one composite rigid body. The force
and moment for that, projected on the axes of the joints toward the root, are a column of
the mass matrix (Walker & Orin 1982; Featherstone, Rigid Body Dynamics Algorithms, 6.2).
Joints of a beam's sections share coordinates; their contributions are combined per mode
at the beam's root.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

from kane_dynamics._util.typing import Matrix, Scalar, Vector
from kane_dynamics.mechanics.algebra.vector import is_zero, symmetric
from kane_dynamics.mechanics.recursive.flexible_modes import Modes
from kane_dynamics.mechanics.recursive.inverse_dynamics import JointStep
from kane_dynamics.mechanics.recursive.link import Link, Z
from kane_dynamics.model.model import WORLD
import numpy as np

Weights = dict[int, Scalar]  # coefficients of the speeds in the rate of a joint
# Per accelerating joint: its weights, and the component of the force along an axis.
AxisComponents = list[tuple[Weights, Scalar]]


class UnitAcceleration(NamedTuple):
    """Force, and moment about a link's origin, for a unit acceleration of a joint."""

    weights: Weights
    force: Vector
    moment: Vector


def mass_matrix(links: Sequence[Link], q: Vector) -> Matrix:
    """Return M_rs = sum_k (m v^r . v^s + omega^r . I omega^s), (n, n), by CRBA."""
    n = len(q)
    M: list[list[Scalar]] = np.zeros((n, n)).tolist()
    steps = []
    composite = []  # mass, first and second moment of each subtree
    components: list[AxisComponents] = []
    # Accelerations of the subtree beyond a beam, by the beam's root.
    pending: list[list[UnitAcceleration]] = []
    for link in links:
        steps.append(JointStep(link, q))
        composite.append((link.mass, link.first_moment, link.second_moment))
        components.append([])
        pending.append([])

    # Inward pass: composite bodies of the subtrees, and the forces that accelerate them.
    for i in reversed(range(len(links))):
        link, step = links[i], steps[i]
        mass, h, S = composite[i]
        accelerations = []
        if link.modes is not None:
            accelerations = _combined_by_modes(pending[i], link.modes, M)
        for modal in accelerations:
            components[i].append((modal.weights, _axis_component(step, modal)))
        joint = _joint_acceleration(step, mass, h, S)
        # Half: `_project` adds each component with r, s and with s, r.
        components[i].append((joint.weights, 0.5 * _axis_component(step, joint)))

        # The same forces on the joints toward the root, up to the root of the next beam.
        for acceleration in (*accelerations, joint):
            for k, propagated in _propagated(links, steps, i, acceleration):
                if links[k].beam is not None:
                    pending[k].append(propagated)
                else:
                    component = _axis_component(steps[k], propagated)
                    components[k].append((propagated.weights, component))

        # Add the composite body to that of the parent, about the parent's origin.
        if link.parent != WORLD:
            p = step.offset
            h = step.inward(h)
            S = step.inward_tensor(S)
            parent_mass, parent_h, parent_S = composite[link.parent]
            h_p = h + mass * p
            S_p = S + np.outer(p, h) + np.outer(h_p, p)
            composite[link.parent] = (parent_mass + mass, parent_h + h_p,
                                      parent_S + symmetric(S_p))

    # Projection on the axes of the joints: the upper half of M.
    for step, of_joint in zip(steps, components):
        _project(dict(step.partials), of_joint, M)
    for r in range(n):
        for s in range(r):
            M[r][s] = M[s][r]
    return np.array(M)


def _joint_acceleration(step: JointStep, mass: Scalar, h: Vector,
                        S: Matrix) -> UnitAcceleration:
    """Return the force and moment of a composite body that its joint accelerates."""
    if step.turns:
        # Force z x h and moment int r x (z x r) dm.
        force = np.array([-h[1], h[0], 0.0])
        moment = np.array([-S[0, 2], -S[1, 2], S[0, 0] + S[1, 1]])
    else:
        force = mass * Z
        moment = np.array([h[1], -h[0], 0.0])
    return UnitAcceleration(dict(step.partials), force, moment)


def _axis_component(step: JointStep, acceleration: UnitAcceleration) -> Scalar:
    """Return the component of a force and moment along the axis of the link's joint."""
    return acceleration.moment[2] if step.turns else acceleration.force[2]


def _propagated(links: Sequence[Link], steps: Sequence[JointStep], i: int,
                acceleration: UnitAcceleration
                ) -> Iterator[tuple[int, UnitAcceleration]]:
    """Yield force and moment of link i on each link toward the root, up to a beam."""
    weights, force, moment = acceleration
    while links[i].parent != WORLD:
        force, moment = steps[i].inward_wrench(force, moment)
        i = links[i].parent
        yield i, UnitAcceleration(weights, force, moment)
        if links[i].beam is not None:
            return


def _project(rates: Weights, components: AxisComponents, M: list[list[Scalar]]) -> None:
    """
    Add the axis components of a joint to the upper half of M.

    Each component adds (w_r W_s + W_r w_s) times itself to M_rs, w being the
    coefficients of the joint and W those of the accelerating joint.
    """
    if np.array(list(rates.values())).dtype == object:
        # Traced coefficients: the components are summed before the multiplication.
        total: Weights = {}
        for weights, value in components:
            for s, W in weights.items():
                total[s] = total.get(s, 0.0) + W * value
        components = [(total, 1.0)]
    for weights, value in components:
        if is_zero(value):
            continue
        for s, W in weights.items():
            for r, w in rates.items():
                product = w * W
                if r in weights and s in rates:
                    if r > s:
                        continue  # covered with r and s exchanged
                    product = product + weights[r] * rates[s]
                low, high = min(r, s), max(r, s)
                M[low][high] = M[low][high] + product * value


def _combined_by_modes(accelerations: list[UnitAcceleration], modes: Modes,
                       M: list[list[Scalar]]) -> list[UnitAcceleration]:
    """Combine accelerations per mode of a beam and add the modal mass to M."""
    # Force and moment for a unit acceleration of each mode: of the beam itself, and of
    # what its sections carry.
    modal_wrench = dict(zip(modes.coordinates, zip(modes.momentum, modes.spin)))
    # What bends with the beam adds its force and moment to the modal wrench, with the
    # weight of the mode in its motion.
    joints = []
    for weights, force, moment in accelerations:
        for r, (modal_force, modal_moment) in modal_wrench.items():
            if r in weights:
                modal_wrench[r] = (modal_force + weights[r] * force,
                                   modal_moment + weights[r] * moment)
        # The weights of other coordinates remain accelerations of the joint's side.
        joint_weights = {s: w for s, w in weights.items() if s not in modal_wrench}
        if joint_weights:
            joints.append(UnitAcceleration(joint_weights, force, moment))
    # The modal mass is that of the beam alone; the upper triangle is enough.
    for r, row in zip(modes.coordinates, modes.mass):
        for s, value in zip(modes.coordinates, row):
            if s >= r:
                M[r][s] = M[r][s] + value
    # Each mode continues inwards as a unit acceleration of its own.
    for r, (modal_force, modal_moment) in modal_wrench.items():
        joints.append(UnitAcceleration({r: 1.0}, modal_force, modal_moment))
    return joints
