"""
Load mechanisms from MJCF, the format of MuJoCo, with the package mujoco as its parser.

Conventions of MuJoCo: a body's frame is placed in that of its parent, and its joints
move it one after the other, each about or along an axis through its anchor, both given
in the body's frame. The body is where the XML puts it at the joint's reference position
(`ref`). A free joint has the pose of the body in the world. Quaternions are w, x, y, z.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
import math
import os
from pathlib import Path
from typing import Any, NamedTuple
import warnings
from xml.etree import ElementTree

from kane_dynamics._util.optional_imports import extra
from kane_dynamics._util.text import listing
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError, ModelError, ModelWarning
from kane_dynamics.mechanics.constraints.constraint_types.closure import Closure
from kane_dynamics.mechanics.constraints.constraint_types.position_constraints import (
    Coupling)
from kane_dynamics.mechanics.constraints.independent_speeds import (
    choose_independent, coordinates_by_name)
from kane_dynamics.model.builder import ModelBuilder
from kane_dynamics.model.inertial import Inertial
from kane_dynamics.model.model import Limits, Model
import numpy as np
from numpy.polynomial import Polynomial

__all__ = ['is_mjcf', 'load_mjcf', 'MjcfMechanism']

WORLD = 0  # MuJoCo's index of the world
# MuJoCo's friction loss acts in full from about this rate on; our law is smooth below
# it.
FRICTION_SPEED = 0.05


class MjcfMechanism(NamedTuple):
    """
    A mechanism loaded from MJCF: `Robot(mechanism.model, **mechanism.options)`.

    Attributes
    ----------
    model : Model
        Bodies, joints and frames.
    options : dict
        Arguments of `Robot`: `constraints` and the `configuration` at which the loops
        close, if the file has equality constraints; `actuated` joints, if only some have
        actuators, and not fewer than there are independent speeds.

    """

    model: Model
    options: dict[str, Any]


def load_mjcf(source: str | os.PathLike[str], *, strict: bool = True) -> MjcfMechanism:
    """
    Load a mechanism from MJCF; needs the extra `mjcf`.

    Used: bodies, joints of every type, inertial properties (of geoms too, as MuJoCo
    computes them), armature and damping of joints and of actuators on them, friction
    loss, joint springs, position limits, force limits of joints and of actuators on
    joints (also by the limits of their controls), sites, gravity; equality
    constraints `connect`, `weld` and `joint` as rigid constraints, where MuJoCo's are
    soft. Everything else that exerts forces is named by a warning: contacts,
    tendons, muscles, fluid, gravity compensation, and so on.

    The order of the joints is MuJoCo's. A ball joint has x, y, z, w in q, MuJoCo has w,
    x, y, z; a free joint's linear speeds are in world axes in both.

    Parameters
    ----------
    source : path, or str of XML
        Assets such as meshes are read from beside the file, since they may define
        inertias.
    strict : bool
        Whether moments of inertia that no rigid body has, and equality constraints of
        other kinds, are an error instead of a warning.

    Returns
    -------
    MjcfMechanism
        The model, and the arguments of `Robot` for its constraints.

    Warns
    -----
    ModelWarning
        Once, naming all that the file states and the model lacks.

    Raises
    ------
    InputError
        If mujoco is not installed, or the file cannot be read.
    ConstraintError
        If the equality constraints contradict each other.
    ModelError
        If MuJoCo refuses the file (with its reason), or the mechanism has no joint.

    """
    mujoco = extra('mujoco', 'mjcf', 'MJCF files')
    return _Reader(mujoco, _compiled(mujoco, source)).mechanism(strict)


def is_mjcf(source: Any) -> bool:
    """Return whether a source is the path of an XML file with the root <mujoco>."""
    if not isinstance(source, str | os.PathLike):
        return False
    if not os.fspath(source).endswith('.xml'):
        return False
    try:
        events = ElementTree.iterparse(os.fspath(source), events=('start',))
        return bool(next(iter(events))[1].tag == 'mujoco')
    except (OSError, ElementTree.ParseError, StopIteration):
        return False


def _compiled(mujoco: Any, source: str | os.PathLike[str]) -> Any:
    """Return MuJoCo's model of a file or a text."""
    if not isinstance(source, str | os.PathLike):
        raise InputError(f'source: {type(source).__name__}; expected a path, or the XML '
                         'as str')
    # A text begins with a tag; anything else is a path.
    is_text = isinstance(source, str) and source.lstrip('\ufeff \t\r\n').startswith('<')
    if not is_text and not Path(source).is_file():
        raise InputError(f"no such file: '{os.fspath(source)}'; expected the path of an "
                         'MJCF file, or its XML as str')
    try:
        if is_text:
            return mujoco.MjModel.from_xml_string(source)
        return mujoco.MjModel.from_xml_path(os.fspath(source))
    except ValueError as error:
        what = 'MJCF' if is_text else f"'{os.fspath(source)}'"
        raise ModelError(f'{what}: {" ".join(str(error).split())}; expected a file that '
                         'MuJoCo loads') from None


class _Reader:
    """Turns a compiled MuJoCo model into a mechanism of this library."""

    def __init__(self, mujoco: Any, compiled: Any) -> None:
        self.mujoco = mujoco
        self.compiled = compiled
        self.bodies = self._names(mujoco.mjtObj.mjOBJ_BODY, compiled.nbody, 'body')
        self.bodies[WORLD] = 'world'
        self.joints = self._names(mujoco.mjtObj.mjOBJ_JOINT, compiled.njnt, 'joint')
        self.sites = self._names(mujoco.mjtObj.mjOBJ_SITE, compiled.nsite, 'site')
        self.builder: ModelBuilder

    def mechanism(self, strict: bool) -> MjcfMechanism:
        """Return the mechanism; warn of what it lacks."""
        if not self.compiled.njnt:
            raise ModelError(f'{self._title()}: no joint; expected at least one')
        self.builder = ModelBuilder(self._title(), gravity=self._gravity(),
                                    strict=strict)
        for body in range(1, self.compiled.nbody):
            self._add_body(body)
        for site in range(self.compiled.nsite):
            self._add_site(site)
        constraints = self._constraints(strict)  # adds frames
        model = self.builder.model()
        options: dict[str, Any] = {}
        if constraints:
            options['constraints'] = tuple(constraints)
            options['configuration'] = self._reference(model)
        unused = self._unused()
        if self.left_out:
            unused.append(f'equality constraints: {listing(self.left_out)}')
        actuated = self._actuated_joints()
        speeds = model.n
        # Fewer actuators than independent speeds cannot determine tau.
        if constraints and actuated:
            start = coordinates_by_name(model, options['configuration'])
            speeds = len(choose_independent(model, None, constraints,
                                            configuration=start).free)
        if actuated and len(actuated) < speeds:
            unused.append(f'which joints have actuators ({", ".join(actuated)}), for '
                          f'they are fewer than the {speeds} independent speeds, to '
                          'which tau is dual instead')
        elif actuated and constraints:
            options['actuated'] = actuated
        if unused:
            warnings.warn('MJCF: not used: '
                          f'{"; ".join(unused)}', ModelWarning, stacklevel=3)
        return MjcfMechanism(model, options)

    # ------------------------------------------------------------------ names

    def _title(self) -> str:
        """Return the name of the model, the first text of MuJoCo's names."""
        return bytes(self.compiled.names).split(b'\0', 1)[0].decode() or 'mechanism'

    def _names(self, kind: Any, count: int, word: str) -> list[str]:
        """Return a unique name for each object: MuJoCo's, or the word and its index."""
        names: list[str] = []
        for index in range(count):
            name = self.mujoco.mj_id2name(self.compiled, kind, index)
            names.append(name or f'{word}_{index}')
        return names

    def _frame_name(self, name: str) -> str:
        """Return a name that no frame has yet; sites may be called like bodies."""
        taken = self.builder._placements
        return name if name not in taken else f'{name}_site'

    def _disabled(self, flag: str) -> bool:
        """Return whether the file's `option` disables a part of the dynamics."""
        bit = getattr(self.mujoco.mjtDisableBit, flag)
        return bool(self.compiled.opt.disableflags & bit)

    def _gravity(self) -> Array:
        """Return the acceleration of gravity, m/s^2."""
        if self._disabled('mjDSBL_GRAVITY'):
            return np.zeros(3)
        return np.array(self.compiled.opt.gravity)

    # ------------------------------------------------------------------ bodies and
    # joints

    def _add_body(self, body: int) -> None:
        """Add a body with its joints: a chain of massless bodies, then the body."""
        compiled = self.compiled
        parent = self.bodies[compiled.body_parentid[body]]
        first = int(compiled.body_jntadr[body])
        joints = range(first, first + int(compiled.body_jntnum[body]))
        # The pose of the body's frame, moved by -anchor, on the last of the chain.
        on = parent
        at = np.array(compiled.body_pos[body])
        quaternion = _scalar_last(compiled.body_quat[body])
        anchor = np.zeros(3)  # of the last joint, in the body's frame
        for joint in joints:
            kind = int(compiled.jnt_type[joint])
            position = np.array(compiled.jnt_pos[joint])
            if kind == self.mujoco.mjtJoint.mjJNT_FREE:
                # Its coordinates are the pose in the world, wherever the XML puts the
                # body.
                on = 'world'
                at = np.zeros(3)
                quaternion = IDENTITY
                position = np.zeros(3)
            offset = _rotated(quaternion, position - anchor)
            name = f'{self.bodies[body]}/{self.joints[joint]}'
            self._add_joint(name, joint, on, at + offset, quaternion)
            on = name
            at = np.zeros(3)
            quaternion = IDENTITY
            anchor = position
        # The body's frame, carried by the last joint, or fixed to its parent without
        # joints.
        self.builder.body(self.bodies[body], on, 'fixed',
                                                 at=at - anchor, quaternion=quaternion,
                          inertial=self._inertial(body))

    def _add_joint(self, body: str, joint: int, on: str, at: Array,
                   quaternion: Array) -> None:
        """Add one joint of MuJoCo and the body that it moves."""
        compiled = self.compiled
        types = self.mujoco.mjtJoint
        kind = int(compiled.jnt_type[joint])
        name = self.joints[joint]
        place: dict[str, Any] = {'at': at, 'quaternion': quaternion, 'joint': name}
        if kind in (types.mjJNT_FREE, types.mjJNT_BALL):
            word = 'free' if kind == types.mjJNT_FREE else 'ball'
            self.builder.body(body, on, word, **place)
            self._set_damping_of_ball(name, joint, word)
            return
        # A joint of one degree of freedom.
        axis = np.array(compiled.jnt_axis[joint])
        reference = float(compiled.qpos0[compiled.jnt_qposadr[joint]])
        sliding = kind == types.mjJNT_SLIDE
        if reference:
            # At q = ref the body is where the XML puts it, so at q = 0 it is moved back.
            if sliding:
                place['at'] = at - reference * _rotated(quaternion, axis)
            else:
                place['quaternion'] = _product(quaternion, _turn(axis, -reference))
        self.builder.body(body, on, 'prismatic' if sliding else 'revolute', axis=axis,
                          **place, **self._properties(joint))

    def _properties(self, joint: int) -> dict[str, Any]:
        """Return limits, springs and dissipation of a joint of one degree of freedom."""
        compiled = self.compiled
        dof = int(compiled.jnt_dofadr[joint])
        limits = Limits(effort=self._effort_limit(joint))
        # Without a range the joint moves without end.
        if compiled.jnt_limited[joint]:
            lower, upper = compiled.jnt_range[joint]
            limits = replace(limits, lower=float(lower), upper=float(upper))
        properties: dict[str, Any] = {
            'limits': limits,
            'damping': _first(compiled.dof_damping[dof]),
            'friction': float(compiled.dof_frictionloss[dof]),
            'armature': float(compiled.dof_armature[dof])}
        # Actuators add their own, at the joint by the square of the gear.
        for name in ('damping', 'armature'):
            properties[name] += self._of_actuators(name, joint)
        stiffness = _first(compiled.jnt_stiffness[joint])
        if stiffness:
            properties['stiffness'] = stiffness
            properties['rest'] = float(compiled.qpos_spring[compiled.jnt_qposadr[joint]])
        return properties

    def _set_damping_of_ball(self, name: str, joint: int, word: str) -> None:
        """Set damping and friction of the parts of a free or a ball joint."""
        compiled = self.compiled
        dof = int(compiled.jnt_dofadr[joint])
        parts = ['x',
                 'y', 'z', 'wx', 'wy', 'wz'] if word == 'free' else ['wx', 'wy', 'wz']
        for k, part in enumerate(parts):
            properties: dict[str, float] = {}
            if _first(compiled.dof_damping[dof + k]):
                properties['damping'] = _first(compiled.dof_damping[dof + k])
            if compiled.dof_frictionloss[dof + k]:
                properties['friction'] = float(compiled.dof_frictionloss[dof + k])
            if properties:
                self.builder.joint(f'{name}/{part}', **properties)

    def _effort_limit(self, joint: int) -> float:
        """Return the largest force of the actuators on a joint, N m or N."""
        compiled = self.compiled
        limits = []
        if compiled.jnt_actfrclimited[joint]:
            limits.append(float(np.abs(compiled.jnt_actfrcrange[joint]).max()))
        actuators = self._actuators_on(joint)
        if actuators:
            total = 0.0  # an actuator without limit leaves the joint without one
            for k in actuators:
                gear = abs(float(compiled.actuator_gear[k, 0]))
                total += gear * self._largest_force(k) if gear else 0.0
            limits.append(total)
        return min(limits, default=math.inf)

    def _largest_force(self, actuator: int) -> float:
        """Return the largest force of an actuator, N m or N, before its gear."""
        compiled = self.compiled
        forces = [math.inf]
        if compiled.actuator_forcelimited[actuator]:
            forces.append(float(np.abs(compiled.actuator_forcerange[actuator]).max()))
        if self._is_limited_by_control(actuator):
            gain = abs(float(compiled.actuator_gainprm[actuator, 0]))
            forces.append(gain * float(np.abs(compiled.actuator_ctrlrange[actuator]).max()))
        return min(forces)

    def _is_limited_by_control(self, actuator: int) -> bool:
        """Return whether limits of its control limit the force of a motor."""
        if self._disabled('mjDSBL_CLAMPCTRL') or not self._is_motor(actuator):
            return False
        return bool(self.compiled.actuator_ctrllimited[actuator])

    def _is_motor(self, actuator: int) -> bool:
        """Return whether the force of an actuator is its control times a constant."""
        compiled, mujoco = self.compiled, self.mujoco
        if len(compiled.actuator_ctrlrange) != len(compiled.actuator_trntype):
            return False  # an actuator with several controls: theirs have other indices
        return bool(compiled.actuator_gaintype[actuator] == mujoco.mjtGain.mjGAIN_FIXED
                    and compiled.actuator_biastype[actuator] == mujoco.mjtBias.mjBIAS_NONE
                    and compiled.actuator_dyntype[actuator] == mujoco.mjtDyn.mjDYN_NONE)

    def _of_actuators(self, name: str, joint: int) -> float:
        """Return damping or armature of the actuators on a joint (newer releases of MuJoCo)."""
        values = getattr(self.compiled, f'actuator_{name}', None)
        total = 0.0
        if values is not None:
            for k in self._actuators_on(joint):
                gear = float(self.compiled.actuator_gear[k, 0])
                total += gear * gear * _first(values[k])
        return total

    def _actuators_on(self, joint: int) -> list[int]:
        """Return the actuators whose transmission is a joint."""
        compiled = self.compiled
        transmissions = self.mujoco.mjtTrn
        on_joints = (transmissions.mjTRN_JOINT, transmissions.mjTRN_JOINTINPARENT)
        return [k for k in range(compiled.nu)
                if int(compiled.actuator_trntype[k]) in on_joints
                and compiled.actuator_trnid[k, 0] == joint]

    def _actuated_joints(self) -> tuple[str, ...]:
        """Return the joints of one degree of freedom that have actuators."""
        types = self.mujoco.mjtJoint
        single = (types.mjJNT_HINGE, types.mjJNT_SLIDE)
        actuated = []
        for joint, name in enumerate(self.joints):
            kind = int(self.compiled.jnt_type[joint])
            if kind in single and self._actuators_on(joint):
                actuated.append(name)
        return tuple(actuated)

    def _inertial(self, body: int) -> Inertial:
        """Return the inertial properties of a body, in its axes."""
        compiled = self.compiled
        R = _matrix(_scalar_last(compiled.body_iquat[body]))
        inertia = R @ np.diag(compiled.body_inertia[body]) @ R.T
        return Inertial(float(compiled.body_mass[body]),
                        np.array(compiled.body_ipos[body]), 0.5 * (inertia + inertia.T))

    def _add_site(self, site: int) -> None:
        """Add a site as a frame."""
        compiled = self.compiled
        self.builder.frame(self._frame_name(self.sites[site]),
                           self.bodies[compiled.site_bodyid[site]],
                           at=np.array(compiled.site_pos[site]),
                           quaternion=_scalar_last(compiled.site_quat[site]))

    # ------------------------------------------------------------------ constraints

    def _constraints(self, strict: bool) -> list[Closure | Coupling]:
        """Return the active equality constraints; refuse those of tendons and flexes."""
        constraints: list[Closure | Coupling] = []
        self.left_out: list[str] = []
        if self._disabled('mjDSBL_EQUALITY') or self._disabled('mjDSBL_CONSTRAINT'):
            return constraints
        names = self._names(self.mujoco.mjtObj.mjOBJ_EQUALITY, self.compiled.neq,
                            'equality')
        for k in np.flatnonzero(self.compiled.eq_active0).tolist():
            constraint = self._constraint(k, names[k])
            if constraint is None:
                self.left_out.append(names[k])
            else:
                constraints.append(constraint)
        if self.left_out and strict:
            raise ModelError(f'{self._title()}: equality constraints of tendons or '
                             f'flexes: {listing(self.left_out)}; expected connect, weld or '
                             'joint, or strict=False to leave them out')
        return constraints

    def _constraint(self, k: int, name: str) -> Closure | Coupling | None:
        """Return an equality constraint, or None without a counterpart."""
        types = self.mujoco.mjtEq
        kind = int(self.compiled.eq_type[k])
        if kind == types.mjEQ_JOINT:
            return self._coupling(k, name)
        if kind in (types.mjEQ_CONNECT, types.mjEQ_WELD):
            return self._closure(k, name, kind == types.mjEQ_WELD)
        return None

    def _coupling(self, k: int, name: str) -> Coupling:
        """Return y - y0 = a0 + a1 (x - x0) + ... + a4 (x - x0)^4 for joints y, x."""
        compiled = self.compiled
        a = np.array(compiled.eq_data[k, :5])
        first = int(compiled.eq_obj1id[k])
        second = int(compiled.eq_obj2id[k])
        y0 = float(compiled.qpos0[compiled.jnt_qposadr[first]])
        if second < 0:
            return Coupling(self.joints[first], {}, y0 + float(a[0]), name)
        x0 = float(compiled.qpos0[compiled.jnt_qposadr[second]])
        # The same polynomial in powers of x.
        powers = np.zeros(5)
        expanded = Polynomial(a)(Polynomial([-x0, 1.0])).coef
        powers[:len(expanded)] = expanded
        highest = max(1, int(np.flatnonzero(powers).max(initial=1)))
        coefficients = powers[1:highest + 1].tolist()
        return Coupling(self.joints[first], {self.joints[second]: coefficients},
                        y0 + float(powers[0]), name)

    def _closure(self, k: int, name: str, weld: bool) -> Closure:
        """Return the loop closure of a connect or weld; its frames are added to the model."""
        compiled = self.compiled
        first = int(compiled.eq_obj1id[k])
        second = int(compiled.eq_obj2id[k])
        frames = (f'{name}/first', f'{name}/second')
        if int(compiled.eq_objtype[k]) == self.mujoco.mjtObj.mjOBJ_SITE:
            bodies = (compiled.site_bodyid[first], compiled.site_bodyid[second])
            points = [np.array(compiled.site_pos[site]) for site in (first, second)]
            turns = [_scalar_last(compiled.site_quat[site]) for site in (first, second)]
        else:
            bodies = (first, second)
            data = np.array(compiled.eq_data[k])
            if weld:
                # data: the point in the second body (3), then in the first (3), and the
                # orientation of the second in the first (4).
                points = [data[3:6], data[:3]]
                turns = [_scalar_last(data[6:10]), IDENTITY]
            else:
                # data: the point in the first body (3), then in the second (3).
                points = [data[:3], data[3:6]]
                turns = [IDENTITY, IDENTITY]
        for frame, body, point, turn in zip(frames, bodies, points, turns):
            self.builder.frame(frame, self.bodies[body], at=point, quaternion=turn)
        # The last number of a weld scales its rotations; with 0 they are free.
        turns_too = weld and float(compiled.eq_data[k, 10]) != 0.0
        return Closure(*frames, 'weld' if turns_too else 'spherical', name=name)

    def _reference(self, model: Model) -> dict[str, float]:
        """Return the positions in which the XML draws the mechanism, by coordinate."""
        values: dict[str, float] = {}
        for joint, name in enumerate(self.joints):
            start = int(self.compiled.jnt_qposadr[joint])
            # A free joint has position and quaternion, a ball joint a quaternion; MuJoCo
            # has the scalar part first.
            kind = int(self.compiled.jnt_type[joint])
            if kind == self.mujoco.mjtJoint.mjJNT_FREE:
                position = self.compiled.qpos0[start:start + 7]
                parts = [*position[:3], *_scalar_last(position[3:])]
                labels = ['x', 'y', 'z', 'qx', 'qy', 'qz', 'qw']
            elif kind == self.mujoco.mjtJoint.mjJNT_BALL:
                parts = list(_scalar_last(self.compiled.qpos0[start:start + 4]))
                labels = ['qx', 'qy', 'qz', 'qw']
            else:
                values[name] = float(self.compiled.qpos0[start])
                continue
            for label, part in zip(labels, parts):
                values[f'{name}/{label}'] = float(part)
        return values

    # ------------------------------------------------------------------ what is left out

    def _unused(self) -> list[str]:
        """Return the features of the file that the model lacks, each with its names."""
        compiled = self.compiled
        mujoco = self.mujoco
        unused = []
        contacts = np.count_nonzero(compiled.geom_contype | compiled.geom_conaffinity)
        if contacts and not self._disabled('mjDSBL_CONTACT'):
            unused.append(f'contacts of {contacts} geoms')
        # Contacts and tendons.
        if compiled.ntendon:
            tendons = self._names(mujoco.mjtObj.mjOBJ_TENDON, compiled.ntendon, 'tendon')
            unused.append(f'tendons: {listing(tendons)}')
        # Of actuators, only effort limits, damping and armature are read.
        elsewhere = self._actuators_elsewhere()
        if elsewhere:
            unused.append(f'actuators that act on no joint: {listing(elsewhere)}')
        servos = self._servos()
        if servos:
            unused.append(f'control laws of actuators: {listing(servos)}')
        uneven = self._uneven_joints()
        if uneven:
            unused.append('the smaller of two unequal limits of force and effort of '
                          f'{listing(uneven)}')
        if compiled.opt.density or compiled.opt.viscosity:
            unused.append('forces of a fluid')
        # Compensation of single bodies by MuJoCo would make them weightless.
        lifted = [self.bodies[k] for k in np.flatnonzero(compiled.body_gravcomp)]
        if lifted:
            unused.append(f'gravity compensation of {listing(lifted)}')
        # Forces on joints that the model does not have.
        balls = self._springs_of_balls()
        if balls:
            unused.append(f'springs, armature and limits of ball and free joints: '
                          f'{listing(balls)}')
        unused += self._unused_forces()
        for count, what in (('nflex',
                             'flexes'), ('nplugin', 'plugins'), ('nmocap', 'mocap')):
            if getattr(compiled, count, 0):
                unused.append(what)
        return unused

    def _actuators_elsewhere(self) -> list[str]:
        """Return the actuators on tendons, sites or bodies."""
        names = self._names(self.mujoco.mjtObj.mjOBJ_ACTUATOR, self.compiled.nu,
                            'actuator')
        on_joints: set[int] = set()
        for joint in range(self.compiled.njnt):
            on_joints.update(self._actuators_on(joint))
        return [name for k, name in enumerate(names) if k not in on_joints]

    def _uneven_joints(self) -> list[str]:
        """Return the joints and actuators whose force limits differ by direction."""
        compiled = self.compiled
        names = self._names(self.mujoco.mjtObj.mjOBJ_ACTUATOR, compiled.nu, 'actuator')
        uneven = []
        for ranges, limited, owners in (
                (compiled.jnt_actfrcrange, compiled.jnt_actfrclimited, self.joints),
                (compiled.actuator_forcerange, compiled.actuator_forcelimited, names)):
            for name, (lower, upper), is_limited in zip(owners, ranges, limited):
                if is_limited and lower != -upper:
                    uneven.append(name)
        for k, name in enumerate(names):
            if self._is_limited_by_control(k) and name not in uneven:
                lower, upper = compiled.actuator_ctrlrange[k]
                if lower != -upper:
                    uneven.append(name)
        return uneven

    def _servos(self) -> list[str]:
        """Return the actuators whose force depends on the state, such as servos."""
        names = self._names(self.mujoco.mjtObj.mjOBJ_ACTUATOR, self.compiled.nu,
                            'actuator')
        none = self.mujoco.mjtBias.mjBIAS_NONE
        return [name for k, name in enumerate(names)
                if int(self.compiled.actuator_biastype[k]) != none]

    def _springs_of_balls(self) -> list[str]:
        """Return the ball and free joints with springs, armature or limits."""
        compiled = self.compiled
        types = self.mujoco.mjtJoint
        names = []
        for joint, name in enumerate(self.joints):
            kind = int(compiled.jnt_type[joint])
            if kind not in (types.mjJNT_FREE, types.mjJNT_BALL):
                continue
            start = int(compiled.jnt_dofadr[joint])
            # A free joint has three translations before its rotations.
            count = 6 if kind == types.mjJNT_FREE else 3
            dofs = slice(start, start + count)
            if (_first(compiled.jnt_stiffness[joint]) or compiled.jnt_limited[joint]
                    or compiled.dof_armature[dofs].any()):
                names.append(name)
        return names

    def _unused_forces(self) -> Iterable[str]:
        """Return disabled passive forces, and nonlinear ones, which newer MuJoCo has."""
        compiled = self.compiled
        for flag, what in (('mjDSBL_SPRING', 'springs'), ('mjDSBL_DAMPER', 'damping'),
                           ('mjDSBL_FRICTIONLOSS', 'friction loss'),
                           ('mjDSBL_LIMIT', 'position limits'),
                           ('mjDSBL_CONSTRAINT', 'friction loss and position limits')):
            if self._disabled(flag):
                yield f'the option that disables {what}'
        # Older releases of MuJoCo do not have these fields.
        for field, what in (('dof_dampingpoly', 'nonlinear damping'),
                            ('actuator_dampingpoly', 'nonlinear damping of actuators'),
                            ('actuator_delay', 'delays of actuators'),
                            ('jnt_springyield', 'plasticity of joint springs'),
                            ('jnt_stiffnesspoly', 'nonlinear stiffness of joints')):
            if np.any(getattr(compiled, field, 0.0)):
                yield what


IDENTITY = np.array([0.0, 0.0, 0.0, 1.0])


def _first(value: Any) -> float:
    """Return a coefficient, or the linear one of a polynomial."""
    return float(np.atleast_1d(value)[0])


def _scalar_last(quaternion: Any) -> Array:
    """Return MuJoCo's quaternion w, x, y, z as x, y, z, w."""
    w, x, y, z = quaternion
    return np.array([x, y, z, w])


def _matrix(quaternion: Array) -> Array:
    """Return the rotation matrix of a quaternion x, y, z, w."""
    from kane_dynamics.mechanics.algebra.quaternion import rotation_matrix
    matrix: Array = rotation_matrix(quaternion)
    return matrix


def _rotated(quaternion: Array, vector: Array) -> Array:
    """Return a vector of the rotated axes in the original ones."""
    rotated: Array = _matrix(quaternion) @ vector
    return rotated


def _product(first: Array, second: Array) -> Array:
    """Return the quaternion of a rotation, then another about the rotated axes."""
    from kane_dynamics.mechanics.algebra.quaternion import quaternion_product
    return quaternion_product(first, second)


def _turn(axis: Array, angle: float) -> Array:
    """Return the quaternion of a rotation about a unit axis."""
    return np.array([*(math.sin(0.5 * angle) * axis), math.cos(0.5 * angle)])
