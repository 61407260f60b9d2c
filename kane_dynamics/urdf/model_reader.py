"""Read a URDF with yourdfpy, with additional checks."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
import io
from typing import Any

from kane_dynamics._util.deferred_import import import_deferring
from kane_dynamics._util.orientation import stated_rotation
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError, KaneError, ModelError, UrdfError
from kane_dynamics.model.elastic_model import with_drives
from kane_dynamics.model.flexible_model import with_beam
from kane_dynamics.model.joint_expansion import Mimic, StatedJoint, StatedLimits
from kane_dynamics.model.model import Inertial, Model
from kane_dynamics.model.placement import snapped
from kane_dynamics.urdf.assembly import assemble_model
from kane_dynamics.urdf.document import Element, parse, rebuilt
from kane_dynamics.urdf.notices import Notices
from kane_dynamics.urdf.schema import check_schema, CHILDREN
from kane_dynamics.urdf.selection import select_joints, Selection
from kane_dynamics.urdf.supplement import check_names, read_supplement, Supplement
from kane_dynamics.urdf.tree import build_tree, ROOT_PARENT, UrdfTree, with_root_joint
import numpy as np
from numpy.typing import ArrayLike


def read_model(text: str, supplement: Any, *, base: str | None, tip: str | None,
               joints: Sequence[str] | None, locked: Mapping[str, float] | None,
               drop: Sequence[str], gravity: ArrayLike, strict: bool,
               floating: str = 'angles',
               root_joint: str = 'fixed') -> tuple[Model, list[str]]:
    """Return the model of a URDF text and the warnings; arguments as in `load_urdf`."""
    if floating not in ('angles', 'quaternion'):
        raise InputError(f"floating: {floating!r}; expected 'angles' or 'quaternion'")
    notices = Notices(strict)
    try:
        model = _model(parse(text), supplement, notices, base=base, tip=tip,
                       joints=joints, locked=locked, drop=drop, gravity=gravity,
                       floating=floating, root_joint=root_joint)
    except KaneError as error:
        # It may be a consequence of the faults before it, which are stated first.
        if not notices.faults or error in notices.faults or error.faults:
            raise
        notices.fault(error)
    notices.refuse_faults()
    return model, notices.messages()


def _model(root: Element, supplement: Any, notices: Notices, *, base: str | None,
           tip: str | None, joints: Sequence[str] | None,
           locked: Mapping[str, float] | None, drop: Sequence[str], gravity: ArrayLike,
           floating: str, root_joint: str) -> Model:
    """Return the model of an XML tree; faults are collected in the notices."""
    # The file: elements, checked, as a tree of links and joints.
    check_schema(root, notices)
    tree = _tree(root, notices)
    if floating == 'quaternion':
        if not any(joint.kind == 'floating' for joint in tree.joints):
            raise InputError("floating: 'quaternion', and the URDF has no floating "
                             "joint; expected root_joint='free' for a base that moves "
                             'freely')
        tree = _with_quaternions(tree)
    if root_joint != 'fixed':
        tree = with_root_joint(tree, root_joint, base, joints)
        base = ROOT_PARENT
    # The choice of what moves, and the data that URDF cannot express.
    selection = select_joints(tree, base=base, tip=tip, joints=joints, locked=locked,
                              drop=drop)
    extra = read_supplement(supplement)
    singles = selection.singles.values()
    check_names(extra, [single.name for single in singles if single.kind != 'fixed'],
                tree.links)
    tree = replace(tree, links={**tree.links, **extra.links})
    model = assemble_model(tree, selection, extra, gravity, notices)
    if notices.faults:
        return model
    # Beams and drives come last: they change bodies that exist, and add coordinates
    # behind all.
    for link, beam in extra.beams.items():
        model = with_beam(model, link, beam,
                          _riders(model, link, tree, selection, extra))
    moving = {name: drive for name, drive in extra.drives.items()
              if name in selection.free or name in selection.followers}
    return with_drives(model, moving)


def _with_quaternions(tree: UrdfTree) -> UrdfTree:
    """Return the tree with a quaternion for the three angles of each floating joint."""
    joints = []
    for joint in tree.joints:
        if joint.kind == 'floating':
            joint = replace(joint, kind='free')
        joints.append(joint)
    return replace(tree, joints=tuple(joints))


def _riders(model: Model, link: str, tree: UrdfTree, selection: Selection,
            extra: Supplement) -> list[tuple[str, Inertial]]:
    """Return the inertials attached to a link: locked links, and the payload."""
    names = [body.name for body in model.bodies]
    riders: list[tuple[str, Inertial]] = []
    if link not in names:
        return riders  # `with_beam` refuses it
    # The links that were merged into this one are frames of its body.
    for frame in model.frames:
        if frame.body != names.index(link) or frame.name not in tree.links:
            continue
        inertial = tree.links[frame.name]
        if frame.name not in (link, *selection.drop) and inertial is not None:
            riders.append((frame.name, inertial))
        if extra.payload is not None and extra.payload[0] == frame.name:
            riders.append(extra.payload)
    return riders


def _tree(root: Element, notices: Notices) -> UrdfTree:
    """Convert checked XML to a tree of records."""
    robot = read_robot(root, CHILDREN)
    stated = {joint.attributes['name']: joint for joint in root.find_all('joint')}
    links = []
    for link, element in zip(robot.links, root.find_all('link'), strict=True):
        links.append((link.name, _inertial(link, element, notices)))
    joints = []
    for joint in robot.joints:
        joints.append(_joint(joint, stated[joint.name], notices))
    return build_tree(robot.name, links, joints)


def read_robot(root: Element, children: dict[str, tuple[str, ...]]) -> Any:
    """Parse XML with yourdfpy, reduced to the elements that `children` lists."""
    # Only scenes need trimesh, which imports scipy and networkx: a second of processor
    # time.
    yourdfpy = import_deferring('yourdfpy.urdf', 'trimesh')
    clean = rebuilt(root, children)
    try:
        return yourdfpy.URDF.load(io.BytesIO(clean), load_meshes=False,
                                  build_scene_graph=False).robot
    except Exception as error:  # yourdfpy raises many types
        raise UrdfError(f'yourdfpy: {error}; expected a URDF that it can '
                        'read') from error


def origin_pose(origin: Any, owner: Element | None) -> tuple[Array, Array]:
    """
    Return the rotation, (3, 3), and translation, (3,) m, of an <origin>.

    Parameters
    ----------
    origin : (4, 4) array or None
        As yourdfpy reads it, which does not know `quat_xyzw`.
    owner : Element or None
        The element that has the <origin>.

    """
    if origin is None:
        return np.eye(3), np.zeros(3)
    R = origin[:3, :3]
    stated = None if owner is None else owner.first('origin')
    if stated is not None and 'quat_xyzw' in stated.attributes:
        text = stated.attributes['quat_xyzw']
        try:
            parts = np.array(text.split(), dtype=np.float64).reshape(4)
        except ValueError:
            raise UrdfError(f"<origin> quat_xyzw: '{text}' (line {stated.line}); "
                            'expected 4 finite numbers') from None
        R = stated_rotation(None, parts, '', UrdfError, stacklevel=1)
    return snapped(R), origin[:3, 3] + 0.0


def _inertial(link: Any, stated: Element, notices: Notices) -> Inertial | None:
    """Convert the inertial of a link to link axes."""
    if link.inertial is None:
        return None
    R, com = origin_pose(link.inertial.origin, stated.first('inertial'))
    what = f"link '{link.name}'"
    if link.inertial.mass < 0.0:
        notices.fault(ModelError(f'{what}: <mass> value {link.inertial.mass} kg; '
                                 'expected a nonnegative number'))
        return None
    inertia = R @ link.inertial.inertia @ R.T
    return Inertial(link.inertial.mass, com, inertia)


def _joint(joint: Any, stated: Element, notices: Notices) -> StatedJoint:
    """Convert a joint; note a questionable axis and unused elements."""
    what = f"joint '{joint.name}'"
    # The axis of a joint that moves; a planar one has its normal.
    moves = joint.type in ('revolute', 'continuous', 'prismatic', 'planar')
    single = moves and joint.type != 'planar'
    axis = np.array([1.0, 0.0, 0.0])
    if moves:
        axis = snapped(joint.axis)
        length = float(np.sqrt(axis @ axis))
        if length < 1e-12:
            notices.fault(ModelError(f'{what}: <axis> xyz {axis.tolist()}; expected a '
                                     'nonzero vector'))
            axis = np.array([1.0, 0.0, 0.0])
        elif stated.first('axis') is None:
            notices.no_axis.append(joint.name)
        elif abs(length - 1.0) > 1e-4:
            notices.long_axis.append(f'{joint.name} ({length:g})')
    R, p = origin_pose(joint.origin, stated)
    # What the joint's type makes no use of is reported.
    if not single:
        unused_tags = ('mimic',) if joint.type == 'fixed' else ('limit', 'dynamics')
        for tag in unused_tags:
            if stated.first(tag) is not None:
                notices.not_used(f'<{tag}> of a {joint.type} joint', joint.name)
        return StatedJoint(joint.name, joint.type, joint.parent, joint.child, R, p, axis)
    # Limits, losses and mimic of a joint with one degree of freedom.
    losses = f'{what}: <dynamics>'
    damping = _nonnegative(joint.dynamics, 'damping', losses, notices) or 0.0
    friction = _nonnegative(joint.dynamics, 'friction', losses, notices) or 0.0
    limits = _limits(joint, what, notices)
    mimic = joint.mimic
    if mimic is not None:
        mimic = Mimic(mimic.joint, mimic.multiplier, mimic.offset)
    return StatedJoint(joint.name, joint.type, joint.parent, joint.child, R, p, axis,
                       limits, damping, friction, mimic)


def _limits(joint: Any, what: str, notices: Notices) -> StatedLimits | None:
    """Return the stated limits of a joint, or None without <limit>."""
    limit = joint.limit
    if limit is None:
        return None
    velocity = _nonnegative(limit, 'velocity', f'{what}: <limit>', notices)
    effort = _nonnegative(limit, 'effort', f'{what}: <limit>', notices)
    return StatedLimits(limit.lower, limit.upper, velocity, effort)


def _nonnegative(record: Any, name: str, what: str, notices: Notices) -> float | None:
    """Return a number of yourdfpy's record, or None; a negative one is a fault."""
    stated = getattr(record, name, None)
    if stated is None:
        return None
    value = float(stated)
    if value < 0.0:
        notices.fault(ModelError(f'{what} {name} {value}; expected a nonnegative '
                                 'number'))
        return None
    return value
