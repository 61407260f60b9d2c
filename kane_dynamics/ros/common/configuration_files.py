"""Load the model and the constraints from the files that parameters name."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any
import warnings

from ament_index_python.packages import get_package_share_directory, PackageNotFoundError
from kane_dynamics._util.resources import resource_path
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.constraints.yaml_file import load_constraints
from kane_dynamics.model.model import Model
from kane_dynamics.simulation.contact import Contact, load_contacts
from kane_dynamics.urdf import load_urdf
import numpy as np

PACKAGE = 'kane_dynamics'
BEFORE_XML = '\ufeff \t\r\n'
NEAR = 0.1  # rad or m: no locked joint is farther from 0 by noise and offsets
LITTLE = 0.01
VERTICAL = 1e-3  # rad: an axis so near gravity turns no weight
MAX_URDF_BYTES = 10_000_000  # bytes; URDFs of real arms reach some hundred thousand


def resolve_path(parameter: str, name: str) -> Path:
    """
    Return the path that a parameter gives.

    It is plain, or package://<package>/<path>.

    Raise InputError if the package is not installed, or the file does not exist.
    """
    # Paths in packages work wherever these are installed.
    if name.startswith('package://'):
        package, _, inside = name.removeprefix('package://').partition('/')
        folder, _, file = inside.partition('/')
        if package == PACKAGE:  # also found in a checkout
            return resource_path(folder, file)
        try:
            path = Path(get_package_share_directory(package)) / inside
        except (PackageNotFoundError, ValueError, OSError):
            raise InputError(f"parameter '{parameter}': package '{package}' of '{name}' "
                             'is not installed; expected an installed package') from None
    else:
        path = Path(name).expanduser()
    if not path.is_file():
        raise InputError(f"parameter '{parameter}': no file '{path}'; expected an "
                         'existing file')
    return path


def load_model(source: str | Path, values: Mapping[str, Any],
               warn: Callable[[str], object]) -> Model:
    """
    Load the model that the parameters describe.

    Call `warn` with each warning about the URDF.

    Raises
    ------
    KaneError
        The URDF is too large or invalid, or a parameter does not fit it.

    """
    # A text is never a path: a topic could otherwise have any file of this machine read.
    if isinstance(source, str) and not source.lstrip(BEFORE_XML).startswith('<'):
        start = repr(source[:40])
        raise InputError(f'robot_description: {start}; expected the URDF as XML text; '
                         "parameter 'urdf' takes a path")
    # The size before anything is parsed.
    size = source.stat().st_size if isinstance(source, Path) else len(source.encode())
    if size > MAX_URDF_BYTES:
        raise InputError(f'URDF: {size} bytes; expected at most {MAX_URDF_BYTES}')
    supplement = None
    if values['supplement']:
        supplement = resolve_path('supplement', values['supplement'])
    joints = list(values['joints']) or None  # None: all
    # Warnings of the model go to the node's log.
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter('always')
        model = load_urdf(source, base=values['base'] or None, tip=values['tip'] or None,
                          root_joint=values['root_joint'], joints=joints,
                          gravity=values['gravity'], supplement=supplement)
    for warning in caught:
        warn(str(warning.message))
    if not model.n:
        raise InputError(f"robot '{model.name}': no joint that moves; expected at least one")
    return model.prefixed(values['prefix']) if values['prefix'] else model


def locked_joints(source: str | bytes | Path, prefix: str,
                  model: Model) -> dict[str, float]:
    """
    Return the joints of the URDF that the model has locked at 0, by their names.

    Each has the largest position, rad or m, at which it may be instead: the weight that
    it carries then changes the torques by at most `LITTLE` of the weakest motor. Joints that
    change no torque, as those of wheels, of another arm, of a lift below and of a base that
    turns about the vertical, are not named.
    """
    with warnings.catch_warnings():
        warnings.simplefilter('ignore')
        whole = load_urdf(source)
    lengths = np.array([np.linalg.norm(body.joint.translation)
                        + np.linalg.norm(body.inertial.com) for body in whole.bodies])
    weights = np.array([9.81 * body.inertial.mass for body in whole.bodies])
    efforts = [body.joint.limits.effort for body in model.bodies]
    weakest = min([*efforts, float(weights.sum() * lengths.sum())])
    allowed = {}
    names = [whole.coordinate_names[body.joint.coordinate] for body in whole.bodies]
    moving = [k for k, name in enumerate(names)
              if f'{prefix}{name}' in model.coordinate_names]
    for k, (body, name) in enumerate(zip(whole.bodies, names)):
        prefixed = f'{prefix}{name}'
        if k in moving or body.joint.name != name:
            continue
        # What moving joints carry changes their torques, and what turns the arm as a whole.
        is_carried = any(i in whole.path(k) for i in moving)
        turns_arm = (name not in whole.sliding and any(k in whole.path(i) for i in moving)
                     and not _is_vertical(whole, k, model.gravity))
        if not is_carried and not turns_arm:
            continue
        carried = [i for i in range(len(whole.bodies)) if k in whole.path(i)]
        # A slide moves what it carries, a rotation by the length of that.
        arm = 1.0 if name in whole.sliding else float(lengths[carried].sum())
        change = float(weights[carried].sum()) * arm
        allowed[prefixed] = max(NEAR, LITTLE * weakest / max(change, 1e-12))
    return allowed


def _is_vertical(model: Model, body: int, gravity: Array) -> bool:
    """Return whether a body's joint turns about gravity, with the joints below it at 0."""
    axis = model.bodies[body].joint.axis
    for k in model.path(body):
        axis = model.bodies[k].joint.rotation @ axis
    across = np.linalg.norm(np.cross(axis, gravity))
    return bool(across <= VERTICAL * np.linalg.norm(gravity))


def robot_options(values: Mapping[str, Any]) -> dict[str, Any]:
    """
    Return the options of Robot that the parameters give.

    Raise KaneError for invalid constraints.
    """
    options: dict[str, Any] = {'payload_frame': values['payload.frame'] or None,
                               'wrench_frames': values['wrench.frames']}
    if values['constraints']:
        options |= load_constraints(resolve_path('constraints', values['constraints']),
                                    prefix=values['prefix'])
    return options


def stated_contacts(parameter: str, values: Mapping[str, Any]) -> tuple[Contact, ...]:
    """
    Return the contacts of simulations in the file that a parameter names; none if it is empty.

    Raise InputError for an invalid file.
    """
    if not values[parameter]:
        return ()
    return load_contacts(resolve_path(parameter, values[parameter]), prefix=values['prefix'])
