"""Where the files are that parameters name, and the model that they describe."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any
import warnings

from ament_index_python.packages import get_package_share_directory, PackageNotFoundError
from kane_dynamics._util.resources import resource_path
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.constraints.yaml_file import load_constraints
from kane_dynamics.model.model import Model
from kane_dynamics.urdf import load_urdf

OURS = 'kane_dynamics'
MOST_URDF = 10_000_000  # bytes; the largest of real arms have some hundred thousand


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


def load(source: str | Path, values: Mapping[str, Any], warn: Callable[[str], object]) -> Model:
    """
    Load the URDF as the parameters say; `warn` takes each remark about it.

    Raises
    ------
    KaneError
        The URDF is too large or not valid, or a parameter does not fit it.

    """
    size = source.stat().st_size if isinstance(source, Path) else len(source.encode())
    if size > MOST_URDF:
        raise InputError(f'the URDF has {size} bytes; valid: at most {MOST_URDF}')
    supplement = values['supplement']
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter('always')
        model = load_urdf(source, base=values['base'] or None, tip=values['tip'] or None,
                          joints=list(values['joints']) or None, gravity=values['gravity'],
                          supplement=located('supplement', supplement) if supplement else None)
    for warning in found:
        warn(str(warning.message))
    return model.prefixed(values['prefix']) if values['prefix'] else model


def load_choices(values: Mapping[str, Any]) -> dict[str, Any]:
    """
    Return the arguments of Robot that the parameters give: frames and constraints.

    Raises
    ------
    KaneError
        There is no such file, or it is not valid.

    """
    choices: dict[str, Any] = {'payload_frame': values['payload.frame'] or None,
                               'wrench_frames': values['wrench.frames']}
    if values['constraints']:
        choices |= load_constraints(located('constraints', values['constraints']),
                                    prefix=values['prefix'])
    return choices
