"""`load_urdf`: a Model from a URDF, from the cache on disk where the same was loaded before."""

from collections.abc import Mapping, Sequence
import os
from typing import Any
import warnings

from kane_dynamics.errors import ModelWarning, UnusedWarning
from kane_dynamics.model.model import GRAVITY, Model
from kane_dynamics.urdf import model_cache
from kane_dynamics.urdf.document import read_source
from kane_dynamics.urdf.notices import NOT_OURS
from numpy.typing import ArrayLike

__all__ = ['load_urdf']


def load_urdf(source: str | bytes | os.PathLike[str], *, base: str | None = None,
              tip: str | None = None, joints: Sequence[str] | None = None,
              locked: Mapping[str, float] | None = None, drop: Sequence[str] = (),
              supplement: Any = None, gravity: ArrayLike = GRAVITY,
              strict: bool = True) -> Model:
    """
    Return the model of a robot described in URDF; meshes are never opened.

    Every joint of the model has one freedom. Fixed and locked joints merge: their masses ride on
    the moving body behind which they stand, or on the base. A mimic joint moves with its master
    and is no freedom. A floating joint becomes <joint>/x, /y, /z (prismatic, axes of the joint's
    frame) and then <joint>/rx, /ry, /rz (revolute, each about the axes that the one before has
    turned); a planar joint becomes <joint>/x, /y (prismatic, in the plane normal to its axis) and
    <joint>/rz (revolute, about its axis). These names serve wherever a joint is named.

    Parameters
    ----------
    source : path, or str or bytes of XML
        UTF-8, UTF-16, UTF-32 or a declared single-byte encoding. Document type and entity
        declarations are refused.
    base : str, optional
        The link to fix in the world, in place of the root; all that is not behind it is cut off.
    tip : str, optional
        Only joints between the base and this link move. What hangs elsewhere or beyond stays,
        locked, with its mass.
    joints : sequence of str, optional
        The joints that move, in the order of q; the others are locked. Without it all move, in
        topological order (parents first), ties in the order of the URDF.
    locked : mapping of str to float, optional
        Positions (rad or m) at which to lock joints; 0 for those locked but not named here. A
        mimic joint whose master is locked stands where the master's position puts it; one whose
        master moves follows it, wherever it is.
    drop : sequence of str, optional
        Links whose own inertial to leave out (not those of links attached to them). Their frames
        stay.
    supplement : path or dict, optional
        What URDF has no words for; see `kane_dynamics.urdf.supplement`.
    gravity : (3,) array
        m/s^2, world axes; the base link's axes are the world's.
    strict : bool
        Whether an indefinite inertia is an error; otherwise a warning.

    Warns
    -----
    ModelWarning
        Once for each kind of doubt, naming all links or joints that it concerns.

    Raises
    ------
    UrdfError
        The URDF or the supplement is malformed.
    ModelError
        It is well-formed, but physically or topologically impossible.
    InputError
        An argument names a link or joint that does not exist or cannot serve.

    """
    text = read_source(source)
    options: dict[str, Any] = {'base': base, 'tip': tip, 'joints': joints, 'locked': locked,
                               'drop': drop, 'gravity': gravity, 'strict': strict}
    name = model_cache.key(text, supplement, options)
    found = None if name is None else model_cache.load(name)
    if found is None:
        from kane_dynamics.urdf.model_reader import read_model  # imports what a hit does not need
        found = read_model(text, supplement, **options)
        if name is not None and name == model_cache.key(text, supplement, options):
            model_cache.store(name, *found)  # unless the supplement's file has just changed
    model, messages = found
    for message in messages:
        category = UnusedWarning if message.startswith(NOT_OURS) else ModelWarning
        warnings.warn(message, category, stacklevel=2)
    return model
