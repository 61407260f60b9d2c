"""Random mechanisms with loops, couplings and wheels, closed where it is known."""

from dataclasses import dataclass, replace

from kane_dynamics import (box, Closure, Coupling, disc, knife_edge, Model, ModelBuilder,
                           rod, Rolling)
from kane_dynamics.mechanics.definition import kinematics
from kane_dynamics.model.model import Frame, WORLD
from mechanisms import random_model
import numpy as np

FAMILIES = ('planar', 'parallelogram', 'spatial', 'spatial welds', 'mimics', 'couplings',
            'wheels', 'floating')


@dataclass(frozen=True)
class Loops:
    """
    A mechanism.

    Attributes
    ----------
    name : str
    model : Model
    constraints : tuple
    q0 : (n_q,) array
        Closed; rad or m.

    """

    name: str
    model: Model
    constraints: tuple
    q0: np.ndarray


def random_loops(seed):
    """Return the mechanism of a seed; families take turns."""
    family = FAMILIES[seed % len(FAMILIES)]
    rng = np.random.default_rng(seed)
    make = {'planar': planar, 'parallelogram': parallelogram, 'wheels': wheels,
            'spatial': spatial, 'spatial welds': spatial, 'mimics': spatial,
            'couplings': spatial, 'floating': planar}[family]
    return make(f'{family} {seed}', rng, family)


def turned(loops, heading):
    """Return the same mechanism on a base that is turned about the vertical, rad."""
    c = np.cos(heading)
    s = np.sin(heading)
    R = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    rows = []
    for body in loops.model.bodies:
        rows.append(body if body.parent != WORLD else replace(
            body, joint=replace(body.joint, rotation=R @ body.joint.rotation,
                                translation=R @ body.joint.translation)))
    bodies = tuple(rows)
    frames = tuple(frame if frame.body != WORLD else replace(
        frame, rotation=R @ frame.rotation, translation=R @ frame.translation)
        for frame in loops.model.frames)
    model = replace(loops.model, bodies=bodies, frames=frames)
    return replace(loops, model=replace(model, gravity=R @ loops.model.gravity))


def base_of(b, rng, family):
    """Add what carries a mechanism: nothing, a turntable, or a free body."""
    kind = 'floating' if family == 'floating' else rng.choice(
        ['world', 'turntable', 'tilted'])
    if kind == 'world':
        return 'world', []
    if kind == 'floating':
        b.body('hull', kind='floating', inertial=box(8.0, (0.6, 0.5, 0.4)))
        return 'hull', list(rng.uniform(-0.4, 0.4, 6))
    axis = (0, 0, 1) if kind == 'turntable' else rng.normal(size=3)
    b.body('table', axis=axis, inertial=disc(rng.uniform(5.0, 20.0), 0.5))
    return 'table', [rng.uniform(-3.0, 3.0)]


def planar(name, rng, family):
    """Return one to three planar loops on one base, each of four or five bars."""
    b = ModelBuilder(name)
    base, q0 = base_of(b, rng, family)
    ends = []
    for loop in range(rng.integers(1, 3 if family == 'floating' else 4)):
        lengths = rng.uniform(0.25, 0.6, rng.integers(3, 5))
        angles = rng.uniform(-1.2, 1.2, len(lengths)) + np.array([1.2, *[-0.9] * (
            len(lengths) - 1)])
        on = base
        at = rng.uniform(-0.3, 0.3, 3)
        b.frame(f'foot{loop}', base, at=at, rpy=(0.0, 0.0, rng.uniform(-3.0, 3.0)))
        on = f'foot{loop}'
        at = (0, 0, 0)
        for k, length in enumerate(lengths):
            bar = f'bar{loop}_{k}'
            b.body(bar, on, axis=(0, -1, 0), at=at,
                   inertial=rod(2.0 * length, (0, 0, 0), (length, 0, 0)))
            on = bar
            at = (length, 0, 0)
        b.frame(f'end{loop}', on, at=at)
        q0 += list(angles)
        kind = rng.choice(['revolute', 'spherical'])
        ends.append((f'end{loop}', f'foot{loop}', kind, (0, 1, 0)))
    return closed(name, b.model(), np.array(q0), ends, [])


def parallelogram(name, rng, family):
    """Return parallelograms on a base, all of whose out-of-plane rows are redundant."""
    b = ModelBuilder(name)
    base, q0 = base_of(b, rng, family)
    ends = []
    for loop in range(rng.integers(1, 3)):
        a, c = rng.uniform(0.3, 0.7, 2)
        b.frame(f'foot{loop}', base, at=rng.uniform(-0.3, 0.3, 3),
                rpy=(0.0, 0.0, rng.uniform(-3.0, 3.0)))
        b.body(f'left{loop}', f'foot{loop}', axis=(0, -1, 0),
               inertial=rod(1.0, (0, 0, 0), (a, 0, 0)))
        b.body(f'right{loop}', f'foot{loop}', axis=(0, -1, 0), at=(c, 0, 0),
               inertial=rod(1.5, (0, 0, 0), (a, 0, 0)))
        b.body(f'top{loop}', f'left{loop}', axis=(0, -1, 0), at=(a, 0, 0),
               inertial=rod(0.8, (0, 0, 0), (c, 0, 0)))
        b.frame(f'end{loop}', f'top{loop}', at=(c, 0, 0))
        b.frame(f'pin{loop}', f'right{loop}', at=(a, 0, 0))
        angle = rng.uniform(-2.2, -0.9)  # hanging: flat, it would branch
        q0 += [angle, angle, -angle]
        ends.append((f'end{loop}', f'pin{loop}', 'revolute', (0, 1, 0)))
    return closed(name, b.model(), np.array(q0), ends, [], meet=False)


def spatial(name, rng, family):
    """Return a random tree whose frames are joined where they are at a random q."""
    n = int(rng.integers(6, 9))
    loops = int(rng.integers(1, 3))
    model = random_model(int(rng.integers(1 << 30)), n, prismatic=0.2, branching=0.35,
                         mimics=1 if family == 'mimics' else 0, passive=False)
    q0 = rng.uniform(-1.0, 1.0, n)
    room = n
    ends = []
    for _ in range(loops):
        kind = 'weld' if family == 'spatial welds' else rng.choice(
            ['spherical', 'revolute'])
        rows = {'spherical': 3, 'revolute': 5, 'weld': 6}[kind]
        if rows >= room:
            kind = 'spherical'
            rows = 3
        if rows >= room:
            break
        tip, root = (int(k) for k in rng.choice(len(model.bodies), 2, replace=False))
        first = f'frame{max(tip, root)}'
        second = rng.choice(['base', f'frame{min(tip, root)}'])
        ends.append((first, second, kind, rng.normal(size=3)))
        room -= rows
    names = model.coordinate_names
    others = []
    if family == 'couplings':
        ratio = rng.uniform(0.5, 2.0) * rng.choice([-1, 1])
        others = [Coupling(names[-1], {names[0]: ratio}, q0[-1] - ratio * q0[0])]
    return closed(name, model, q0, ends, others)


def wheels(name, rng, family):
    """Return a cart on wheels or runners, with a planar loop on it or none."""
    b = ModelBuilder(name)
    kind = rng.choice(['runner', 'two wheels', 'disc'])
    if kind == 'disc':
        radius = rng.uniform(0.2, 0.4)
        b.body('disc', kind='floating', turns='zxy',
               inertial=disc(1.0, radius, axis=(0, 1, 0)))
        model = b.model()
        lean = rng.uniform(-0.25, 0.25)
        q0 = np.array([0.1, -0.2, radius * np.cos(lean), rng.uniform(-3, 3), lean, 0.3])
        return Loops(name, model, (Rolling('disc', radius, axis=(0, 1, 0)),), q0)
    b.body('cart', kind='planar', inertial=box(5.0, (0.6, 0.4, 0.2), at=(0.1, 0, 0.2)))
    q0 = [0.2, -0.1, rng.uniform(-3.0, 3.0)]
    constraints = []
    if kind == 'runner':
        constraints.append(knife_edge('cart', (0, 1, 0)))
    else:
        for side, y in (('left', 0.25), ('right', -0.25)):
            b.body(side, 'cart', axis=(0, 1, 0), at=(0, y, 0.1),
                   inertial=disc(0.5, 0.1, axis=(0, 1, 0)))
            q0.append(0.0)
            constraints.append(Rolling(side, 0.1, axis=(0, 1, 0)))
    ends = []
    if rng.random() < 0.6:
        on = 'cart'
        at = (0.2, 0, 0.3)
        for k, (length, angle) in enumerate(zip((0.2, 0.4, 0.35), (1.0, -0.9, -1.4))):
            b.body(f'bar{k}', on, axis=(0, -1, 0), at=at,
                   inertial=rod(length, (0, 0, 0), (length, 0, 0)))
            on = f'bar{k}'
            at = (length, 0, 0)
            q0.append(angle)
        b.frame('end0', on, at=at)
        ends.append(('end0', 'cart', 'revolute', (0, 1, 0)))
    return closed(name, b.model(), np.array(q0), ends, constraints)


def closed(name, model, q0, ends, others, meet=True):
    """
    Return the mechanism with its loops.

    With `meet`, the second frame of each loop is put where the first is at q0, on the
    same body.
    """
    frames = list(model.frames)
    constraints = list(others)
    for k, (first, second, kind, axis) in enumerate(ends):
        if meet:
            R, p = kinematics.frame_pose(model, model.frame(first), q0)
            carrier = model.frame(second)
            R0, p0 = kinematics.frame_pose(model, carrier, q0)
            placement = (carrier.rotation @ R0.T @ R,
                         carrier.translation + carrier.rotation @ R0.T @ (p - p0))
            second = f'socket{k}'
            frames.append(Frame(second, carrier.body, *placement))
        constraints.append(Closure(first, second, kind, axis=axis, name=f'loop{k}'))
    return Loops(name, replace(model, frames=tuple(frames)), tuple(constraints), q0)
