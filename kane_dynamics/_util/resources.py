"""Files installed with the package: URDFs, configurations, launch files."""

import os
from pathlib import Path
import sys

from kane_dynamics.errors import InputError


def resource_path(folder: str, name: str) -> Path:
    """
    Return the path of a file of the package.

    Parameters
    ----------
    folder : 'config', 'launch' or 'urdf'
        Kind of the file.
    name : str
        Name of the file.

    Raises
    ------
    InputError
        If there is no such file; the message lists the existing ones.

    """
    checkout = Path(__file__).resolve().parents[2]
    ament_prefixes = os.environ.get('AMENT_PREFIX_PATH', '').split(':')
    # A checkout first, then what is installed.
    places = [checkout / folder] if (checkout / 'package.xml').exists() else []
    for prefix in (sys.prefix, *filter(None, ament_prefixes)):
        places.append(Path(prefix) / 'share' / 'kane_dynamics' / folder)
    known = set()
    for place in places:
        if (place / name).is_file():
            return place / name
        if place.is_dir():
            known |= {path.name for path in place.iterdir()}
    raise InputError(f"no file '{name}' in {folder}; expected one of "
                     f'{", ".join(sorted(known)) or "none"}')


def package_version() -> str:
    """Return the version of this package: of the checkout, else the installed one."""
    from importlib import metadata  # slow to import, and rarely needed
    from xml.etree import ElementTree
    described = Path(__file__).resolve().parents[2] / 'package.xml'
    if described.exists():
        return ElementTree.parse(described).findtext('version', '')
    return metadata.version('kane_dynamics')
