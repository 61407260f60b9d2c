"""Load a Model from a URDF, or from the cache on disk."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import os
from typing import Any
import warnings

from kane_dynamics._util.deferred_import import forks_wait
from kane_dynamics.errors import ModelWarning, UnusedWarning
from kane_dynamics.model.model import GRAVITY, Model
from kane_dynamics.urdf import model_cache
from kane_dynamics.urdf.document import read_source
from kane_dynamics.urdf.notices import NOT_OURS
from numpy.typing import ArrayLike

__all__ = ['load_urdf']

# Nearly every URDF has transmissions. Filters that users set come before this one.
warnings.simplefilter('ignore', UnusedWarning, append=True)


def load_urdf(source: str | bytes | os.PathLike[str], *, base: str | None = None,
              tip: str | None = None, joints: Sequence[str] | None = None,
              locked: Mapping[str, float] | None = None, drop: Sequence[str] = (),
              supplement: Any = None, gravity: ArrayLike = GRAVITY,
              strict: bool = True, floating: str = 'angles',
              root_joint: str = 'fixed') -> Model:
    """
    Load the model of a robot from URDF; meshes are never opened.

    Every joint of the model has one degree of freedom. Links on fixed and locked joints
    are merged into the moving body that carries them, or into the base. A mimic joint
    moves with its master and has no coordinate. A floating joint becomes <joint>/x, /y,
    /z (prismatic, along the axes of the joint's frame) and then <joint>/rx, /ry, /rz
    (revolute, each about the axis rotated by the previous ones); see `floating`. A
    planar joint becomes <joint>/x, /y (prismatic, in the plane normal to its axis) and
    <joint>/rz (revolute, about its axis). These names are valid wherever a joint is
    named.

    Parameters
    ----------
    source : path, or str or bytes of XML
        The path may end in .xacro; `expand_xacro` takes the arguments of such a file.
        XML is UTF-8, UTF-16, UTF-32 or of a declared single-byte encoding. Document type
        and entity declarations are refused.
    base : str, optional
        The link to fix in the world instead of the root; only links behind it are kept.
    tip : str, optional
        Only joints between the base and this link move. All other links are kept,
        locked, with their mass.
    joints : sequence of str, optional
        The joints that move, in the order of q; the others are locked. Default: all, in
        topological order (parents first), ties in the order of the URDF.
    locked : mapping of str to float, optional
        Positions (rad or m) of locked joints; default 0. A mimic joint is at the
        position that its master determines, locked or moving.
    drop : sequence of str, optional
        Links whose own inertial is removed; attached links and frames are kept.
    root_joint : {'fixed', 'free', 'floating', 'planar'}
        The joint between the world and the base link, one of the kinds of
        `ModelBuilder.body`. 'free' is a floating base with a quaternion, 'floating' one
        with three angles, which may have motions; 'planar' moves in x and y and turns
        about z. Its coordinates are root_joint/x and so on, and come first; the base of
        the model is 'world'.
    supplement : path or dict, optional
        Data that URDF cannot express; see `kane_dynamics.urdf.supplement`.
    gravity : (3,) array
        m/s^2, world axes, which are those of the base link.
    strict : bool
        Whether an indefinite inertia is an error instead of a warning.
    floating : {'angles', 'quaternion'}
        Coordinates of floating joints: three angles, singular where the second is 90
        degrees, or after <joint>/x, /y, /z a quaternion <joint>/qx, /qy, /qz, /qw, whose
        speeds are the angular velocity <joint>/wx, /wy, /wz on the axes of the child
        link. As joints, these three move or are locked together. 'quaternion' without a
        floating joint in the URDF is an error: `root_joint` adds one.

    Warns
    -----
    ModelWarning
        One warning per kind of problem, which names all links or joints concerned. That
        of elements of actuators and simulators (transmissions), an UnusedWarning, is
        ignored unless a filter shows it.

    Raises
    ------
    UrdfError
        If the URDF or the supplement is malformed.
    ModelError
        If it is well-formed, but physically or topologically impossible.
    InputError
        If an argument names an unknown or unsuitable link or joint.

    """
    text = read_source(source)
    options: dict[str, Any] = {'base': base, 'tip': tip, 'joints': joints,
                               'locked': locked,
                               'drop': drop, 'gravity': gravity, 'strict': strict,
                               'floating': floating, 'root_joint': root_joint}
    name = model_cache.model_key(text, supplement, options)
    cached = None if name is None else model_cache.cached_model(name)
    if cached is not None:
        model, messages = cached
    else:
        with forks_wait():
            from kane_dynamics.urdf.model_reader import read_model  # slow imports
        model, messages = read_model(text, supplement, **options)
        # The supplement's file may have changed since its content was put into the key.
        if name is not None and name == model_cache.model_key(text, supplement, options):
            model_cache.store_model(name, model, messages)
    for message in messages:
        category = UnusedWarning if message.startswith(NOT_OURS) else ModelWarning
        warnings.warn(message, category, stacklevel=2)
    return model
