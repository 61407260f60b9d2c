"""The table of arms: which torque terms they add themselves, and what efforts they report."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import cache
from pathlib import Path
import re
from typing import Any

from kane_dynamics._util.yaml_io import mapping, read_yaml
from kane_dynamics.control.terms import NO_TERM, stated_terms
from kane_dynamics.errors import InputError

TABLE = Path(__file__).with_name('arms.yaml')
UNCONFIRMED = 'unconfirmed'
NO_INTERFACE = 'no effort interface'
_KEYS = ('vendor', 'arm', 'name', 'joints', 'interface', 'versions', 'compensates',
         'note', 'efforts', 'sources')


class EffortKind(StrEnum):
    """Kinds of reported efforts; see `kane_dynamics.identification.Efforts`."""

    MOTOR_CURRENT = 'motor_current'
    MOTOR_TORQUE = 'motor_torque'
    JOINT_TORQUE = 'joint_torque'
    EXTERNAL_TORQUE = 'external_torque'


@dataclass(frozen=True)
class ReportedEffort:
    """
    The efforts in the joint states of one version of a driver.

    Attributes
    ----------
    kind : str
        One of `EffortKind`, or `UNCONFIRMED`.
    gravity : bool
        Whether the weight of the arm is part of it.
    versions : str

    """

    kind: str
    gravity: bool = True
    versions: str = ''

    def __str__(self) -> str:
        """Return kind and gravity in words."""
        preposition = 'with' if self.gravity else 'without'
        return f'{self.kind} {preposition} gravity'


@dataclass(frozen=True)
class KnownArm:
    """
    One row of the table of arms.

    Attributes
    ----------
    vendor, arm, interface, versions, note : str
    name, joints : str
        Regular expressions for the name of the robot and for all its joints; either
        identifies it.
    compensates : tuple of str or None
        The torque terms that the arm adds to commanded efforts; None if no source says
        it, or if efforts cannot be commanded.
    commandable : bool
        Whether efforts can be commanded.
    efforts : tuple of ReportedEffort
    sources : tuple of str

    """

    vendor: str
    arm: str
    interface: str
    versions: str
    note: str
    name: str
    joints: str
    compensates: tuple[str, ...] | None
    commandable: bool
    efforts: tuple[ReportedEffort, ...]
    sources: tuple[str, ...]

    def is_this(self, name: str, joint_names: Collection[str]) -> bool:
        """Return whether a robot of this name, with these joints, is this arm."""
        if re.fullmatch(self.name, name, re.IGNORECASE):
            return True
        if not (self.joints and joint_names):
            return False
        return all(re.fullmatch(self.joints, joint,
                                re.IGNORECASE) for joint in joint_names)

    def __str__(self) -> str:
        """Return arm and interface in one line."""
        return f'{self.vendor} {self.arm} ({self.interface}; {self.versions})'


@cache
def known_arms() -> tuple[KnownArm, ...]:
    """Return the rows of the table of arms; raise InputError if a row is invalid."""
    rows = read_yaml(TABLE, 'table of arms', InputError)
    return tuple(_row(row, number) for number, row in enumerate(rows, start=1))


def arms_named(name: str, joint_names: Collection[str] = ()) -> tuple[KnownArm, ...]:
    """
    Return the rows of an arm, which differ in interface or version; empty if it is unknown.

    Parameters
    ----------
    name : str
        Name of the robot in its URDF.
    joint_names : collection of str
        Names of its joints, without a prefix of the node.

    """
    return tuple(row for row in known_arms() if row.is_this(name, joint_names))


def contradiction(rows: Sequence[KnownArm], compensates: Collection[str]) -> str:
    """
    Return how a statement of what the arm compensates contradicts the table; empty if not.

    Parameters
    ----------
    rows : sequence of KnownArm
        The rows of the arm, from `arms_named`.
    compensates : collection of str
        Torque terms, or 'none'.

    """
    stated = frozenset(compensates)
    listed = {row: frozenset(row.compensates) for row in rows if row.compensates is not None}
    if not listed or stated in listed.values():
        return ''
    # No row of the table has these terms: what do the rows have?
    expected = '; or '.join(f'{", ".join(row.compensates or ())} for {row}' for row in listed)
    # Gravity is what throws or drops an arm.
    by_arm = ['gravity' in terms for terms in listed.values()]
    consequence = ''
    if 'gravity' not in stated and all(by_arm):
        consequence = ', where gravity would count twice'
    if 'gravity' in stated and not any(by_arm):
        consequence = ', where nothing would hold the weight of the arm'
    return (f'arm_compensates: {", ".join(compensates)}{consequence}; expected '
            f'{expected} (a simulated arm: what its simulator adds)')


def effort_contradiction(rows: Sequence[KnownArm], kind: str, gravity: bool) -> str:
    """
    Return how the stated meaning of efforts contradicts the table; empty if it does not.

    Parameters
    ----------
    rows : sequence of KnownArm
        The rows of the arm, from `arms_named`.
    kind : str
        One of `EffortKind`.
    gravity : bool
        Whether the weight of the arm is part of the efforts.

    """
    listed: list[ReportedEffort] = []
    for row in rows:
        listed += [effort for effort in row.efforts if effort.kind != UNCONFIRMED]
    if kind == EffortKind.EXTERNAL_TORQUE:
        return ''  # it is of another topic than the joint states
    meanings = {(effort.kind, effort.gravity) for effort in listed}
    if not listed or (kind, gravity) in meanings:
        return ''
    expected = '; or '.join(f'{effort} ({effort.versions})' for effort in listed)
    stated = ReportedEffort(kind, gravity)
    return f'efforts: {stated}; expected {expected} for {rows[0].vendor} {rows[0].arm}'


def _row(data: Any, number: int) -> KnownArm:
    """Return one checked row."""
    what = f'table of arms, row {number}'
    row = mapping(data, what, _KEYS, InputError)
    missing = sorted(set(_KEYS) - {'joints', 'note'} - set(row))
    if missing:
        raise InputError(f'{what}: no {", ".join(missing)}; expected all of '
                         f'{", ".join(_KEYS)}')
    if not row['sources']:
        raise InputError(f'{what}: no sources; expected the documents that state it')
    # The columns of names are patterns that are compared with names of models and
    # joints.
    for key in ('name', 'joints'):
        try:
            re.compile(row.get(key, ''))
        except re.error as error:
            raise InputError(f'{what}, {key}: {row[key]!r}, {error}; expected a regular '
                             'expression') from None
    compensates = None
    if row['compensates'] not in (UNCONFIRMED, NO_INTERFACE):
        compensates = stated_terms(row['compensates'], f'{what}, compensates')
    return KnownArm(
        vendor=row['vendor'], arm=row['arm'], interface=row['interface'],
        versions=str(row['versions']), note=row.get('note', ''), name=row['name'],
        joints=row.get('joints', ''), compensates=compensates,
        commandable=row['compensates'] != NO_INTERFACE,
        efforts=tuple(_effort(entry, what) for entry in row['efforts']),
        sources=tuple(row['sources']))


def _effort(data: Any, what: str) -> ReportedEffort:
    """Return one checked entry of the reported efforts."""
    entry = mapping(data, f'{what}, efforts', ('kind', 'gravity', 'versions'),
                    InputError)
    kind = str(entry.get('kind'))
    if kind not in (*EffortKind, UNCONFIRMED):
        raise InputError(f'{what}, efforts: kind {kind!r}; expected one of '
                         f'{", ".join((*EffortKind, UNCONFIRMED))}')
    gravity = entry.get('gravity', True)
    if not isinstance(gravity, bool):
        raise InputError(f'{what}, efforts: gravity {gravity!r}; expected true or false')
    return ReportedEffort(kind, gravity, str(entry.get('versions', '')))


def words(compensates: Collection[str]) -> str:
    """Return the torques that the arm itself adds to a command, in words."""
    terms = [name for name in compensates if name != NO_TERM]
    if not terms:
        return 'nothing'
    *first, last = terms
    return f'{", ".join(first)} and {last}' if first else last
