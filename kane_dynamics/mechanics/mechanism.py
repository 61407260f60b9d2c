"""
A model with its generalized speeds and constraints: the motions that it admits.

The independent speeds u_I and the constraints are one linear system for the joint rates,

    [ Y_I ]        [ u_I - Z_I ]
    [  J  ] q'  =  [     b     ],      S q' = s,

and its rate gives q''. The inverse S^-1 = [ T  N ] holds the whole of Kane's method: T are the
partial joint rates of the independent speeds (the nonholonomic ones where constraints are), so a
generalized force is T^T times the joint forces; N are those of the auxiliary speeds J q' - b,
which vanish in every motion: N^T times the joint forces are the constraint forces, brought into
evidence (Kane & Levinson, section 4.9).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from kane_dynamics.errors import ConstraintError
from kane_dynamics.mechanics import frames, kinematics, linear
from kane_dynamics.mechanics.constraints import Constraint, Rows
from kane_dynamics.mechanics.dual import moving, rates
from kane_dynamics.mechanics.linkage import Link
from kane_dynamics.mechanics.speeds import chosen, Speeds
from kane_dynamics.model import Model
import numpy as np


@dataclass(frozen=True, eq=False)
class JointMotion:
    """
    The joints' motion that goes with independent speeds.

    Attributes
    ----------
    qdot, qddot : (n_q,) arrays
        Rates and accelerations of the joints; rad or m, and s.
    T : (n_q, n) array
        Joint rates per unit of each independent speed.
    N : (n_q, m) array
        Joint rates per unit of each constraint's auxiliary speed.

    """

    qdot: Any
    qddot: Any
    T: Any
    N: Any


class Posture:
    """A mechanism at one posture and time: what constraints ask (`constraints.Geometry`)."""

    def __init__(self, model: Model, speeds: Speeds, q: Any, t: Any,
                 links: Sequence[Link] | None = None) -> None:
        """Use the textbook's kinematics, or those of the links that are compiled."""
        self.model, self.q, self.t = model, q, t
        self._speeds = speeds
        self._links = links

    def pose(self, frame: str) -> tuple[Any, Any]:
        """Return axes (3, 3, columns) and origin (3,) of a frame, m."""
        at = self.model.frame(frame)
        if self._links is None:
            return kinematics.frame_pose(self.model, at, self.q)
        T = frames.frame_pose(self._links, at, self.q)
        return T[:3, :3], T[:3, 3]

    def partial_velocities(self, frame: str) -> Any:
        """Return (6, n_q): linear at the frame's origin, then angular, per unit joint rate."""
        at = self.model.frame(frame)
        if self._links is None:
            return kinematics.frame_partial_velocities(self.model, at, self.q)
        return frames.partial_velocities(self._links, at, self.q)

    def speed_rows(self, names: Sequence[str]) -> tuple[Any, Any]:
        """Return rows of Y, (k, n_q), and of Z, (k,), of these speeds."""
        Y, Z = self._speeds.of(self.q, self.t)
        places = speed_places(self._speeds, names)
        return Y[places], Z[places]

    def other_speeds(self, names: Sequence[str]) -> tuple[str, ...]:
        """Return the names of all speeds but these."""
        return tuple(name for name in self._speeds.names if name not in names)


class Mechanism:
    """
    A model, its speeds, its constraints.

    Parameters
    ----------
    model : Model
    speeds : None, Speeds or callable
        See `speeds.chosen`; joint rates by default.
    constraints : sequence of constraints
    free, kept : sequences of int
        Numbers of the independent speeds, and of the rows that are independent of each other;
        `structure.structured` finds them.

    """

    def __init__(self, model: Model, speeds: Any = None, constraints: Sequence[Constraint] = (),
                 free: Sequence[int] | None = None, kept: Sequence[int] | None = None) -> None:
        """Keep the parts; without `free` and `kept` every speed and every row counts."""
        self.model = model
        self.speeds = chosen(model, speeds)
        self.constraints = tuple(constraints)
        self.labels = tuple(label for c in self.constraints for label in c.labels)
        self.free = list(range(model.n)) if free is None else list(free)
        self.kept = list(range(len(self.labels))) if kept is None else list(kept)
        names = [c.name for c in self.constraints]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise ConstraintError(f'constraints must have different names; given twice: {twice}')

    @property
    def n(self) -> int:
        """Return the number of independent speeds."""
        return len(self.free)

    @property
    def speed_names(self) -> tuple[str, ...]:
        """Return the names of the independent speeds, in order."""
        return tuple(self.speeds.names[r] for r in self.free)

    def posture(self, q: Any, t: Any = 0.0, links: Sequence[Link] | None = None) -> Posture:
        """Return the mechanism at q, (n_q,), and t, over any scalar."""
        return Posture(self.model, self.speeds, q, t, links)

    def rows(self, here: Posture) -> Rows:
        """Return the rows of all constraints, in the order of `labels`."""
        parts = [constraint.rows(here) for constraint in self.constraints]
        n_q = self.model.n
        return Rows(np.concatenate([np.zeros((0, n_q)), *(part.J for part in parts)]),
                    np.concatenate([np.zeros(0), *(part.b for part in parts)]),
                    tuple(gap for part in parts for gap in part.gap))

    def system(self, here: Posture) -> tuple[Any, Any]:
        """Return S, (n_q, n_q), and s at u_I = 0, (n_q,)."""
        Y, Z = here.speed_rows(self.speed_names)
        rows = self.rows(here)
        return (np.concatenate([Y, rows.J[self.kept]]),
                np.concatenate([-Z, rows.b[self.kept]]))

    def joint_motion(self, q: Any, u: Any, udot: Any, t: Any = 0.0,
                     links: Sequence[Link] | None = None) -> JointMotion:
        """
        Return the joints' motion.

        Parameters
        ----------
        q : (n_q,) array of scalars
            Coordinates, rad or m.
        u, udot : (n,) arrays of scalars
            Independent speeds and their rates.
        t : scalar
            Time, s.
        links : sequence of Link, optional
            Use their kinematics, the ones that are compiled.

        Raises
        ------
        ConstraintError
            S is singular in every posture.

        """
        S, s = self.system(self.posture(q, t, links))
        try:
            inverse = linear.inverse(S)
        except ZeroDivisionError as error:
            row = error.args[0]
            names = (*self.speed_names, *(self.labels[k] for k in self.kept))
            raise ConstraintError(f"speeds and constraints do not determine the motion: '"
                                  f"{names[row]}' depends on the others in every posture"
                                  ) from None
        none = np.zeros(len(self.kept)).astype(object)
        qdot = inverse @ (np.concatenate([u, none]) + s)
        S_moving, s_moving = self.system(
            self.posture(moving(q, qdot), moving(t, 1.0), links))
        qddot = inverse @ (np.concatenate([udot, none]) + rates(s_moving)
                           - rates(S_moving) @ qdot)
        return JointMotion(qdot, qddot, inverse[:, :self.n], inverse[:, self.n:])


def speed_places(speeds: Speeds, names: Sequence[str]) -> list[int]:
    """Return the numbers of speeds; ConstraintError lists the valid names."""
    for name in names:
        if name not in speeds.names:
            raise ConstraintError(f"no speed '{name}'; valid: {', '.join(speeds.names)}")
    return [speeds.names.index(name) for name in names]
