"""Doubts about a model, gathered while it is loaded, one warning a kind."""

from dataclasses import dataclass, field, fields

Names = list[str]
NOT_USED = 'the URDF states these, but they are not used'
NOT_OURS = 'the URDF states these for actuators and simulators; they are not used'
NO_INERTIAL = 'moving links without <inertial>, taken as without mass'
# Of actuators, simulators and drivers: no part of the mechanism.
OTHERS = ('<transmission>', '<gazebo>', '<safety_controller>', '<calibration>')


def _kind(text: str) -> Names:
    """Declare a kind of doubt with the sentence that introduces its names."""
    names: Names = field(default_factory=list, metadata={'text': text})
    return names


@dataclass
class Notices:
    """Lists of what each doubt concerns; `issue` turns each that is not empty into a warning."""

    unused: dict[str, Names] = field(default_factory=dict)
    no_axis: Names = _kind('joints without <axis>, taken as "1 0 0" as URDF says')
    long_axis: Names = _kind('joints whose <axis> is not a unit vector (its length); normalised')
    no_limit: Names = _kind('joints whose <limit> lacks something, taken as unlimited there')
    bad_limit: Names = _kind('joints whose <limit> lower is not below upper, taken as unlimited')
    zero_limit: Names = _kind('joints whose <limit> has 0 for effort or velocity, taken as not '
                              'stated: unlimited')
    no_room: Names = _kind('mimic joints whose <limit> leaves their master no room, taken as '
                           'unlimited in position')
    degrees: Names = _kind('revolute joints whose <limit> spans many turns (URDF states rad): '
                           'degrees?')
    indefinite: Names = _kind('links whose inertia has a negative principal moment, used as it '
                              'stands because strict=False')
    triangle: Names = _kind('links whose inertia is physically impossible: a principal moment '
                            'exceeds the sum of the other two (triangle inequality)')
    singular: Names = _kind('links that have mass, but a principal moment of inertia of zero')
    no_inertial: Names = _kind(NO_INERTIAL)
    massless: Names = _kind('moving bodies without mass; forward dynamics fails if their joints '
                            'move nothing else')

    def not_used(self, what: str, name: str) -> None:
        """Note that `what` is stated of the link or joint `name`, but not used."""
        self.unused.setdefault(what, []).append(name)

    def messages(self) -> list[str]:
        """Return one warning for each kind of doubt."""
        found = []
        for text, others in ((NOT_USED, False), (NOT_OURS, True)):
            listed = '; '.join(f'{what}: {", ".join(dict.fromkeys(names))}'
                               for what, names in self.unused.items()
                               if what.startswith(OTHERS) == others)
            if listed:
                found.append(f'{text}: {listed}')
        for kind in fields(self)[1:]:
            names = getattr(self, kind.name)
            if names:
                found.append(f'{kind.metadata["text"]}: {", ".join(names)}')
        return found
