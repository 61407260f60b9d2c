"""ROS 2 parameter files: blocks of parameters, and the nodes that they are for."""

from collections.abc import Iterator, Mapping
from pathlib import Path
import re
from typing import Any

from kane_dynamics._util.yaml_io import Loader
from kane_dynamics.errors import InputError
import yaml

WILDCARD = '/**'  # parameters of all nodes


def parameter_blocks(path: Path) -> dict[str, dict[str, Any]]:
    """
    Return the parameters of a file, by dotted name, for each full name of a node.

    Raises
    ------
    InputError
        The file cannot be read, is not YAML, or has no parameters.

    """
    try:
        # A file that cannot be read, is no text, or is no YAML: each has its reason.
        data = yaml.load(path.read_text(encoding='utf-8'), Loader)
    except (OSError, UnicodeDecodeError) as error:
        reason = 'no UTF-8 text'
        if isinstance(error, OSError):
            reason = str(error.strerror).lower()
        raise InputError(f"parameter file '{path}': {reason}; expected a readable "
                         'file') from None
    except yaml.YAMLError as error:
        words = ' '.join(str(error).split())
        raise InputError(f"parameter file '{path}': {words}; expected YAML") from None
    blocks = dict(_nodes('', data))
    if not blocks:
        raise InputError(f"parameter file '{path}': no ros__parameters; expected them "
                         f'below the name of a node, or below {WILDCARD}')
    return blocks


def takes_effect(block: str, node: str) -> bool:
    """
    Return whether a block of parameters is of a node.

    Parameters
    ----------
    block : str
        Name of the block, such as /left/kane_dynamics; ``*`` is one part of the name,
        ``**`` any number of parts.
    node : str
        Full name of the node.

    """
    # The wildcards of ROS: one name, or any number of them.
    patterns = {'*': '/[^/]+', '**': '(/[^/]+)*'}
    expression = ''
    for part in block.split('/'):
        if part:
            expression += patterns.get(part, '/' + re.escape(part))
    return re.fullmatch(expression, node) is not None


def _nodes(node: str, data: Any) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield the full names of nodes and their parameters."""
    if not isinstance(data, Mapping):
        return
    for key, value in data.items():
        if key != 'ros__parameters':
            yield from _nodes(f"{node}/{str(key).strip('/')}", value)
        elif node and isinstance(value, Mapping):
            yield node, dict(_flat('', value))


def _flat(prefix: str, block: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """Yield the dotted names and the values of parameters."""
    for key, value in block.items():
        if isinstance(value, Mapping):
            yield from _flat(f'{prefix}{key}.', value)
        else:
            yield f'{prefix}{key}', value
