"""Where the files are that parameters name."""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory, PackageNotFoundError
from kane_dynamics.errors import InputError
from kane_dynamics.resources import resource_path

OURS = 'kane_dynamics'


def located(parameter: str, name: str) -> Path:
    """
    Return the path that a parameter gives, plain or as package://<package>/<path>.

    Raises
    ------
    InputError
        The package is not installed, or there is no such file.

    """
    if name.startswith('package://'):
        package, _, rest = name.removeprefix('package://').partition('/')
        folder, _, file = rest.partition('/')
        if package == OURS:  # found in a checkout too
            return resource_path(folder, file)
        try:
            path = Path(get_package_share_directory(package)) / rest
        except (PackageNotFoundError, ValueError):
            raise InputError(f"parameter '{parameter}' is '{name}': package '{package}' is not "
                             'installed') from None
    else:
        path = Path(name).expanduser()
    if not path.is_file():
        raise InputError(f"parameter '{parameter}' is '{name}': no file '{path}'")
    return path
