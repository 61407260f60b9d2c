"""Limits of the coordinates of a URDF: of their joints and of the mimic joints."""

from collections.abc import Iterable
from dataclasses import replace
import math

from kane_dynamics.model.joint_expansion import Mimic, StatedJoint, StatedLimits
from kane_dynamics.model.model import Limits
from kane_dynamics.urdf.notices import Notices
from kane_dynamics.urdf.selection import Selection

UNLIMITED = Limits()
DEGREES = 12.6  # rad, two turns: a bound beyond it, up to 720, looks like degrees


def coordinate_limits(singles: Iterable[StatedJoint], selection: Selection,
                      notices: Notices) -> dict[str, Limits]:
    """
    Return the limits of the coordinates by name.

    A mimic joint is at ``multiplier * q + offset``, so its position and velocity limits bound q
    too. Its effort limit is not used: the master's limit bounds the torque of both.
    """
    limits, followers = {}, []
    for single in singles:
        mimic = selection.followers.get(single.name)
        if mimic is not None:
            followers.append((single, mimic))
        else:
            limits[single.name] = _limits(single, notices)
    for single, mimic in followers:
        limits[mimic.master] = _led(limits[mimic.master], single, mimic, notices)
    return limits


def _limits(single: StatedJoint, notices: Notices) -> Limits:
    """Return a joint's limits, infinite where missing or invalid, with notices."""
    name, stated = single.name, single.limits
    continuous = single.kind == 'continuous'
    if stated is None:
        if not continuous:
            notices.no_limit.append(name)
        return UNLIMITED
    missing = [key for key in ('velocity', 'effort') if getattr(stated, key) is None]
    if stated.lower is None and stated.upper is None and not continuous:
        missing = ['lower', 'upper', *missing]
    if missing:
        notices.no_limit.append(f'{name} ({", ".join(missing)})')
    return _sensible(single, stated, notices)


def _sensible(single: StatedJoint, stated: StatedLimits, notices: Notices) -> Limits:
    """Return the stated limits, infinite where invalid, with notices."""
    name, kind = single.name, single.kind
    continuous, turns = kind == 'continuous', kind == 'revolute'
    lower, upper = stated.lower, stated.upper
    zero = [key for key in ('velocity', 'effort') if getattr(stated, key) == 0.0]
    if zero:
        notices.zero_limit.append(f'{name} ({", ".join(zero)})')
    bounds = (-math.inf, math.inf)
    if continuous:
        if lower is not None or upper is not None:
            notices.not_used('<limit> lower and upper of a continuous joint', name)
    elif lower is not None or upper is not None:
        bounds = (lower or 0.0, upper or 0.0)  # URDF: default 0 if only the other is stated
        if bounds[0] >= bounds[1]:
            notices.bad_limit.append(f'{name} ({bounds[0]:g} to {bounds[1]:g})')
            bounds = (-math.inf, math.inf)
        if turns and DEGREES < max(abs(bound) for bound in (lower or 0.0, upper or 0.0)) <= 720.0:
            notices.degrees.append(f'{name} ({lower or 0.0:g} to {upper or 0.0:g})')
    return Limits(*bounds, stated.velocity or math.inf, stated.effort or math.inf)


def _led(master: Limits, single: StatedJoint, mimic: Mimic, notices: Notices) -> Limits:
    """Return the limits of a master combined with those of its mimic joint."""
    if single.limits is None:
        return master
    own = _sensible(single, single.limits, notices)
    if own.effort not in (math.inf, master.effort):
        notices.not_used("<limit> effort of a mimic joint, whose torque is its master's",
                         single.name)
    narrowed = master.with_follower(own, mimic.multiplier, mimic.offset)
    if narrowed is None:
        notices.no_room.append(f'{single.name} ({own.lower:g} to {own.upper:g})')
        speed_alone = replace(own, lower=-math.inf, upper=math.inf)
        narrowed = master.with_follower(speed_alone, mimic.multiplier, mimic.offset)
    return master if narrowed is None else narrowed
