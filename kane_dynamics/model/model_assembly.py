"""Bodies, frames and inertia of a model under construction; whole models mounted on frames."""

from __future__ import annotations

from dataclasses import replace
import warnings

from kane_dynamics._util.text import listing
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import ModelError, ModelWarning
from kane_dynamics.model.builder_checks import check_inertial, check_moments, further, pose
from kane_dynamics.model.joint_expansion import quaternion_names
from kane_dynamics.model.model import Body, Frame, Inertial, Model, WORLD
from kane_dynamics.model.placement import Placement
from numpy.typing import ArrayLike

ORIGIN = (0.0, 0.0, 0.0)
NOTHING = Inertial()


class ModelAssembly:
    """Collection of bodies, coordinates and named frames that becomes a `Model`."""

    def __init__(self, name: str, gravity: Array, strict: bool) -> None:
        """Create a mechanism without bodies."""
        self.name = name
        self.gravity = gravity
        self.strict = strict
        self._impossible: list[str] = []  # bodies with inertias that strict=True refuses
        self._bodies: list[Body] = []
        self._coordinates: list[str] = []  # names of the degrees of freedom
        self._balls: list[int] = []  # as `Model.balls`
        self._placements = {'world': Placement(WORLD)}
        self._base = NOTHING
        self._base_name = 'world'

    def _continue(self, model: Model) -> None:
        """Start with the bodies, joints and frames of a model."""
        self._base_name, self._base = model.base_name, model.base_inertial
        self._bodies, self._coordinates = list(model.bodies), list(model.joint_names)
        self._balls = list(model.balls)
        self._placements = {model.base_name: Placement(WORLD)}
        for frame in model.frames:
            self._placements[frame.name] = Placement(frame.body, frame.rotation,
                                                     frame.translation)

    def load(self, on: str, inertial: Inertial) -> None:
        """
        Add inertia, given in the axes of a frame.

        Raises
        ------
        ModelError
            If the frame does not exist, or the moments of inertia are impossible.

        """
        placement = self._placement(on, 'load')
        check_inertial(on, inertial)
        self._check_moments(on, inertial)
        moved = inertial.moved(placement.rotation, placement.translation)
        if placement.body == WORLD:
            self._base = self._base + moved
        else:
            body = self._bodies[placement.body]
            self._bodies[placement.body] = replace(body, inertial=body.inertial + moved)

    def frame(self, name: str, on: str, *, at: ArrayLike = ORIGIN,
              rpy: ArrayLike = ORIGIN, quaternion: ArrayLike | None = None) -> None:
        """
        Add a frame fixed in another.

        Parameters
        ----------
        name, on : str
            The new frame, and the one in which it is fixed.
        at, rpy : (3,) arrays
            Its pose: m, and roll, pitch, yaw about fixed axes, rad.
        quaternion : (4,) array, optional
            Orientation as x, y, z, w, instead of `rpy`.

        """
        self._check_new(name)
        self._placements[name] = self._placement(on, f"frame '{name}'").frame(
            *pose(at, rpy, f"frame '{name}'", quaternion))

    def mount(self, model: Model, on: str, *, at: ArrayLike = ORIGIN, rpy: ArrayLike = ORIGIN,
              quaternion: ArrayLike | None = None, prefix: str = '') -> None:
        """
        Attach a whole model, such as an arm from `load_urdf`.

        Parameters
        ----------
        model : Model
            The model; its gravity is ignored. Further bodies can be attached to its frames.
        on : str
            Frame to which its base is attached.
        at, rpy : (3,) arrays
            Pose of its base in frame `on`, m and rad.
        quaternion : (4,) array, optional
            Orientation as x, y, z, w, instead of `rpy`.
        prefix : str
            Prefix of the names of its bodies, joints and frames.

        Raises
        ------
        ModelError
            If a name exists already; choose a prefix.

        """
        base = self._placement(on, f"model '{model.name}'").frame(
            *pose(at, rpy, 'mount', quaternion))
        names = {prefix + frame.name for frame in model.frames} | {prefix + model.base_name}
        for name in sorted(names):
            self._check_new(name)
        for body in model.bodies:
            self._check_joint(prefix + body.joint.name)
        first, joints = len(self._bodies), len(self._coordinates)
        for body in model.bodies:
            joint = replace(body.joint, name=prefix + body.joint.name,
                            coordinate=joints + body.joint.coordinate,
                            deflection=further(body.joint.deflection, joints))
            parent = first + body.parent
            if body.parent == WORLD:
                placement = base.frame(joint.rotation, joint.translation)
                parent = placement.body
                joint = replace(joint, rotation=placement.rotation,
                                translation=placement.translation)
            self._bodies.append(Body(prefix + body.name, parent, joint, body.inertial,
                                     further(body.beam, joints)))
        self._coordinates += [prefix + name for name in model.joint_names]
        self._balls += [first + body for body in model.balls]
        self._placements[prefix + model.base_name] = base
        for frame in model.frames:
            start = base if frame.body == WORLD else Placement(first + frame.body)
            self._placements[prefix + frame.name] = start.frame(frame.rotation, frame.translation)
        self.load(prefix + model.base_name, model.base_inertial)

    def model(self) -> Model:
        """Return the model; raise ModelError if it has no body."""
        if not self._bodies:
            raise ModelError(f"mechanism '{self.name}': no body; expected at least one")
        if self._impossible:
            names = ', '.join(dict.fromkeys(self._impossible))
            warnings.warn('inertias that no rigid body can have, accepted by strict=False: '
                          f'{names}', ModelWarning, stacklevel=2)
        frames = [Frame(name, placement.body, placement.rotation, placement.translation)
                  for name, placement in self._placements.items()]
        coordinates = quaternion_names(self._coordinates, [
            self._bodies[k].joint.coordinate for k in self._balls])
        return Model(self.name, self._limited_bodies(), coordinates, tuple(frames), self.gravity,
                     self._base_name, self._base, tuple(self._balls))

    def _limited_bodies(self) -> tuple[Body, ...]:
        """Return the bodies; limits of joints that mimic others narrow those of their masters."""
        bodies = list(self._bodies)
        masters = {name: k for k, body in enumerate(bodies)
                   if (name := body.joint.name) in self._coordinates}
        for body in self._bodies:
            joint = body.joint
            master = masters.get(self._coordinates[joint.coordinate])
            follows = joint.deflection is None and joint.multiplier != 0.0
            if master is None or not follows or joint.name in masters:
                continue
            of_master = bodies[master].joint
            limits = of_master.limits.with_follower(joint.limits, joint.multiplier, joint.offset)
            if limits is None:
                raise ModelError(
                    f"joint '{joint.name}': limits {joint.limits.lower:g} to "
                    f"{joint.limits.upper:g}, which exclude all positions of '{of_master.name}', "
                    'the joint that it follows; expected limits with a common range')
            bodies[master] = replace(bodies[master], joint=replace(of_master, limits=limits))
        return tuple(bodies)

    def _check_moments(self, on: str, inertial: Inertial) -> None:
        """Raise ModelError for impossible moments of inertia, or store them for a warning."""
        try:
            check_moments(on, inertial)
        except ModelError:
            if self.strict:
                raise
            self._impossible.append(on)

    def _placement(self, on: str, what: str) -> Placement:
        if not isinstance(on, str) or on not in self._placements:
            raise ModelError(f"{what}: no body or frame '{on}'; expected one of "
                             f'{listing(self._placements)}')
        return self._placements[on]

    def _check_new(self, name: str) -> None:
        if not isinstance(name, str) or not name:
            raise ModelError(f'name of a body or frame: {name!r}; expected a text')
        if name in self._placements:
            raise ModelError(f"body or frame '{name}': exists already; expected a unique name")

    def _check_joint(self, name: str) -> None:
        if name in (body.joint.name for body in self._bodies):
            raise ModelError(f"joint '{name}': exists already; expected a unique name")
