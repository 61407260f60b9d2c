"""Expand xacro files to URDF, with the package xacro."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
import os
from pathlib import Path
from threading import Lock
from typing import Any
from xml.etree import ElementTree
from xml.parsers.expat import ExpatError

from kane_dynamics._util.optional_imports import extra
from kane_dynamics.errors import InputError, UrdfError

SUFFIX = '.xacro'
_lock = Lock()  # xacro keeps what it processes in module variables


def expand_xacro(path: str | os.PathLike[str],
                 arguments: Mapping[str, Any] | None = None) -> str:
    """
    Return the URDF of a xacro file.

    ``load_urdf(expand_xacro('ur.urdf.xacro', {'ur_type': 'ur10e', 'name': 'ur'}))``.
    `load_urdf('arm.urdf.xacro')` does the same without arguments. Needs the extra
    `xacro`.

    xacro evaluates expressions of the file in Python, restricted but not isolated:
    expand only files that you trust.

    Parameters
    ----------
    path : path
        The file. `$(find package)` is the share folder of an installed ROS package, or
        else the folder of a `package.xml` with this name: one that contains the file, or
        one next to it. Without `package.xml`, it is a folder of this name: one that
        contains the file, or one in a folder of the variable ROS_PACKAGE_PATH.
    arguments : mapping of str to str, number or bool, optional
        Values of the file's `<xacro:arg>`.

    Raises
    ------
    InputError
        If xacro is not installed, or an argument has another type.
    UrdfError
        If the file cannot be read or expanded; the message has xacro's reason.

    """
    xacro = extra('xacro', 'xacro', 'xacro files')
    substitution = extra('xacro.substitution_args', 'xacro', 'xacro files')
    file = Path(path)
    if not file.is_file():
        raise UrdfError(f"no such file: '{file}'; expected the path of a xacro file")
    mappings = {}
    if arguments is not None:
        mappings = {name: argument_text(name, value)
                    for name, value in arguments.items()}
    # Xacro has state of its own: one expansion at a time.
    try:
        with _lock, _packages_found_beside(file, substitution):
            document = xacro.process_file(str(file), mappings=mappings)
    # The errors of xacro and of the Python expressions in the file.
    except (xacro.XacroException, substitution.SubstitutionException, ExpatError,
            OSError, ValueError, LookupError, TypeError, NameError) as error:
        raise UrdfError(f"'{file}': {_reason(error)}; expected a file that xacro "
                        'expands with these arguments') from None
    text: str = document.toxml()
    return text


def arguments_of(assignments: Sequence[str]) -> dict[str, str]:
    """Return the arguments that texts NAME:=VALUE state; InputError for other texts."""
    arguments = {}
    for assignment in assignments:
        name, sign, value = assignment.partition(':=')
        if not sign or not name:
            raise InputError(f'xacro argument: {assignment!r}; expected NAME:=VALUE')
        arguments[name] = value
    return arguments


def argument_text(name: str, value: Any) -> str:
    """Return the value of an argument as xacro wants it."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str | int | float):
        return str(value)
    raise InputError(f"xacro argument '{name}': {value!r}; expected a text, a number or "
                     'a bool')


def _reason(error: Exception) -> str:
    """Return the message of xacro for an error, in one line."""
    if type(error).__name__ == 'ArgException':
        return f"argument '{error}' is missing"
    return ' '.join(str(error).split()) or type(error).__name__


@contextmanager
def _packages_found_beside(file: Path, substitution: Any) -> Iterator[None]:
    """Let `$(find package)` also find source packages around a file, without ROS."""
    installed = substitution._eval_find

    def find(package: str) -> str:
        # Installed packages have precedence.
        try:
            share: str = installed(package)
        except (LookupError, ImportError, OSError):  # not installed, or no ROS at all
            folder = _package_folder(file, package)
            if folder is None:
                raise UrdfError(f"package '{package}': not installed, and no "
                                'package.xml or folder around the file has this name; '
                                'expected the folder that contains it in '
                                'ROS_PACKAGE_PATH') from None
            share = str(folder)
        return share

    substitution._eval_find = substitution._eval_dict['find'] = find
    try:
        yield
    finally:
        substitution._eval_find = substitution._eval_dict['find'] = installed


def _package_folder(file: Path, package: str) -> Path | None:
    """Return the folder of a source package: around a file, next to one, or named."""
    for folder in file.resolve().parents:
        if _package_name(folder) is None:
            continue
        if _package_name(folder) == package:
            return folder
        for neighbour in sorted(folder.parent.iterdir()):
            if neighbour.is_dir() and _package_name(neighbour) == package:
                return neighbour
    # Without package.xml the names of folders count.
    for folder in file.resolve().parents:
        if folder.name == package:
            return folder
    for root in os.environ.get('ROS_PACKAGE_PATH', '').split(os.pathsep):
        if root and (Path(root) / package).is_dir():
            return Path(root) / package
    return None


def _package_name(folder: Path) -> str | None:
    """Return the name in a folder's package.xml, or None without one."""
    try:
        return ElementTree.parse(folder / 'package.xml').getroot().findtext('name')
    except (OSError, ElementTree.ParseError):
        return None
