"""Rewrite inertials and friction of a URDF; keep everything else unchanged."""

from collections.abc import Collection, Iterable, Mapping
import os
from typing import Any
from xml.etree import ElementTree

from kane_dynamics._util.text import listing
from kane_dynamics.errors import UrdfError
from kane_dynamics.model.inertial import Inertial
from kane_dynamics.urdf.document import parse, read_source
from kane_dynamics.urdf.supplement import INERTIA_KEYS


def rewritten(source: str | bytes | os.PathLike[str], inertials: Mapping[str, Inertial],
              emptied: Collection[str],
              friction: Mapping[str, tuple[float, float]]) -> str:
    """
    Return the text of a URDF with replaced inertials and friction; comments are kept.

    Parameters
    ----------
    source : path, or str or bytes of XML
        The URDF.
    inertials : mapping of link to Inertial
        New inertials.
    emptied : collection of str
        Links whose inertial is removed.
    friction : mapping of joint to (damping, friction)
        N m s/rad and N m, or N s/m and N.

    Raises
    ------
    UrdfError
        If the XML cannot be read, or a link or joint is missing.

    """
    text = read_source(source)
    parse(text)  # rejects unsafe XML
    builder = ElementTree.TreeBuilder(insert_comments=True)
    try:
        root = ElementTree.fromstring(text, ElementTree.XMLParser(target=builder))
    except ElementTree.ParseError as error:
        raise UrdfError(f'URDF: {error}; expected well-formed XML') from None
    links = {link.get('name'): link for link in root.findall('link')}
    joints = {joint.get('name'): joint for joint in root.findall('joint')}
    _check_existence('link', [*inertials, *emptied], links)
    _check_existence('joint', friction, joints)
    # The stated inertials replace all others; emptied links keep none.
    for name in [*inertials, *emptied]:
        for element in links[name].findall('inertial'):
            links[name].remove(element)
    for name, inertial in inertials.items():
        links[name].insert(0, _inertial(inertial))
    for name, (damping, coulomb) in friction.items():
        dynamics = joints[name].find('dynamics')
        if dynamics is None:
            dynamics = ElementTree.SubElement(joints[name], 'dynamics')
        dynamics.attrib.update(damping=repr(damping), friction=repr(coulomb))
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding='unicode') + '\n'


def _check_existence(kind: str, names: Iterable[str],
                     elements: Mapping[Any, Any]) -> None:
    """Raise UrdfError for names of links or joints that are not in the URDF."""
    lacking = [name for name in names if name not in elements]
    if lacking:
        raise UrdfError(f'URDF: no {kind} {listing(lacking)}; expected those of the '
                        'model')


def _inertial(inertial: Inertial) -> ElementTree.Element:
    """Return an <inertial> element in the link's axes, with all digits."""
    element = ElementTree.Element('inertial')
    center = ' '.join(repr(number) for number in inertial.com.tolist())
    ElementTree.SubElement(element, 'origin', xyz=center, rpy='0 0 0')
    ElementTree.SubElement(element, 'mass', value=repr(inertial.mass))
    moments = {}
    for key in INERTIA_KEYS:  # ixx, ixy and so on
        row = 'xyz'.index(key[1])
        column = 'xyz'.index(key[2])
        moments[key] = repr(float(inertial.inertia[row, column]))
    ElementTree.SubElement(element, 'inertia', moments)
    return element
