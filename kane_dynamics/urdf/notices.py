"""Faults of a description and warnings about it, collected while it is loaded."""

from dataclasses import dataclass, field, fields

from kane_dynamics.errors import KaneError, UrdfError

Names = list[str]
NOT_USED = 'the URDF states these, but they are not used'
NOT_OURS = 'the URDF states these for actuators and simulators; they are not used'
NO_INERTIAL = 'moving links without <inertial>; treated as massless'
DEGREE_LIMITS = ('revolute joints whose <limit> spans many turns (URDF states rad): '
                 'degrees?')
DEGREES = 'origins whose rpy exceeds a full turn (URDF states rad): degrees?'
# Of actuators, simulators and drivers: no part of the mechanism.
OTHERS = ('<transmission>', '<gazebo>', '<safety_controller>', '<calibration>')


def _kind(text: str) -> Names:
    """Declare a kind of warning with the text that precedes its names."""
    names: Names = field(default_factory=list, metadata={'text': text})
    return names


@dataclass
class Notices:
    """
    Names of links and joints by kind of warning, and faults.

    `messages` returns the texts of the warnings, `refuse_faults` raises the faults. With
    `strict` false, what is not understood is a warning.
    """

    strict: bool = True
    faults: list[KaneError] = field(default_factory=list)
    unused: dict[str, Names] = field(default_factory=dict)
    no_axis: Names = _kind('joints without <axis>; using the default "1 0 0"')
    long_axis: Names = _kind('joints whose <axis> is not a unit vector (its length); '
                             'normalized')
    no_limit: Names = _kind('joints without a complete <limit>; unlimited where missing')
    bad_limit: Names = _kind('joints whose <limit> lower is not below upper; unlimited')
    zero_limit: Names = _kind('joints whose <limit> has 0 for effort or velocity; '
                              'unlimited there')
    no_room: Names = _kind('mimic joints whose <limit> excludes all positions of their '
                           'master; unlimited in position')
    degrees: Names = _kind(DEGREE_LIMITS)
    degree_rpy: Names = _kind(DEGREES)
    locked_outside: Names = _kind('locked positions outside the limits; expected rad or '
                                  'm: degrees?')
    degree_rest: Names = _kind('rest of springs beyond two turns; expected rad: degrees?')
    far_payload: Names = _kind('payload of the supplement whose center of mass is '
                               'farther from its frame than all links reach in one '
                               'line; expected m')
    indefinite: Names = _kind('links whose inertia has a negative principal moment; '
                              'used unchanged because of strict=False (--no-strict)')
    triangle: Names = _kind('links whose inertia is impossible: a principal moment '
                            'exceeds the sum of the other two')
    singular: Names = _kind('links with mass and a principal moment of inertia of zero')
    no_inertial: Names = _kind(NO_INERTIAL)
    massless: Names = _kind('moving bodies without mass; forward dynamics fails if '
                            'their joints move nothing else')

    def not_used(self, what: str, name: str) -> None:
        """Note that `what` of the link or joint `name` is not used."""
        self.unused.setdefault(what, []).append(name)

    def not_understood(self, given: str, what: str, line: int, expected: str) -> None:
        """Refuse what may change a number; with `strict` false note that it is not used."""
        if self.strict:
            self.fault(UrdfError(f'{what}: {given} (line {line}); expected {expected}'))
        else:
            self.not_used(given, what)

    def fault(self, error: KaneError) -> None:
        """Keep an error, so that all faults of a file are found in one run."""
        self.faults.append(error)

    def refuse_faults(self) -> None:
        """Raise the only fault, or one error that lists all."""
        if not self.faults:
            return
        first = self.faults[0]
        if len(self.faults) == 1:
            raise first
        texts = tuple(str(fault) for fault in self.faults)
        error = type(first)('\n- '.join([f'{len(texts)} faults:', *texts]))
        error.faults = texts
        raise error

    def messages(self) -> list[str]:
        """Return a warning text for each kind of notice that names something."""
        of_mechanism = []
        of_actuators = []
        # Entries that describe the mechanism, and entries that other programs use.
        for what, names in self.unused.items():
            text = f'{what}: {", ".join(dict.fromkeys(names))}'
            if what.startswith(OTHERS):
                of_actuators.append(text)
            else:
                of_mechanism.append(text)
        messages = []
        if of_mechanism:
            messages.append(f'{NOT_USED}: {"; ".join(of_mechanism)}')
        if of_actuators:
            messages.append(f'{NOT_OURS}: {"; ".join(of_actuators)}')
        # The further kinds have names alone, and their text in the field.
        for kind in fields(self)[3:]:
            names = getattr(self, kind.name)
            if names:
                messages.append(f'{kind.metadata["text"]}: {", ".join(names)}')
        return messages
