"""Read YAML files; duplicate keys are errors."""

from collections import Counter
from collections.abc import Mapping
import os
from pathlib import Path
import re
from typing import Any

from kane_dynamics._util.file_kinds import kind_of_content
from kane_dynamics._util.text import listing, SHORT
from kane_dynamics.errors import KaneError, UrdfError
import yaml


class Loader(yaml.SafeLoader):
    """YAML loader that refuses duplicate keys, and reads 1e2 as a number as ROS does."""

    def construct_mapping(self, node: Any, deep: bool = False) -> dict[Any, Any]:
        """Return a mapping after checking that its scalar keys differ."""
        keys = [key.value for key, _ in node.value if isinstance(key, yaml.ScalarNode)]
        twice = [key for key, count in Counter(keys).items() if count > 1]
        if twice:
            raise yaml.YAMLError(f'given more than once: {listing(twice)} '
                                 f'(line {node.start_mark.line + 1})')
        return super().construct_mapping(node, deep)


# YAML 1.1, which PyYAML reads, has no number without a point or a sign of the exponent.
Loader.add_implicit_resolver('tag:yaml.org,2002:float',
                             re.compile(r'[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+$'),
                             list('-+.0123456789'))


def read_yaml(source: Any, what: str, error: type[KaneError] = UrdfError) -> Any:
    """
    Return the content of a YAML file, without duplicate keys.

    Parameters
    ----------
    source : path
        The file.
    what : str
        Name of the file in messages.
    error : type
        Raised if the file cannot be read.

    """
    if not isinstance(source, (str, os.PathLike)):
        raise error(f'{what}: {SHORT.repr(source)}; expected the path of a YAML file, '
                    'or a dict')
    try:
        content = Path(source).read_bytes()
    except (OSError, ValueError) as fault:
        if isinstance(fault, FileNotFoundError):
            raise error(f'no such file: {os.fspath(source)!r}; expected the path of a '
                        f'YAML file ({what})') from None
        reason = fault.strerror if isinstance(fault, OSError) else fault
        raise error(f'{what} {os.fspath(source)!r}: {reason}; expected the path of a '
                    'YAML file') from None
    kind = kind_of_content(content)
    if kind not in ('a YAML file', 'text', 'an empty file', 'a binary file'):
        raise error(f"{what} '{source}': seems to be {kind}; expected a YAML mapping")
    # `ros2 topic echo` ends its output with ---, which starts an empty document: ignored.
    try:
        contents = yaml.load_all(content, Loader)
        documents = [document for document in contents if document is not None]
    except (yaml.YAMLError, RecursionError, ValueError) as fault:
        reason = ' '.join(str(fault).split()) or 'too deeply nested'
        raise error(f"{what} '{source}': not valid YAML: {reason}; expected a YAML "
                    'mapping') from None
    # A file that was cut to nothing must not mean that nothing is stated.
    if not documents:
        raise error(f"{what} '{source}': an empty file; expected a YAML mapping "
                    '({} states nothing)')
    if len(documents) > 1:
        raise error(f"{what} '{source}': {len(documents)} YAML documents; expected one")
    return documents[0]


def mapping(data: Any, what: str, valid: tuple[str, ...] | None = None,
            error: type[KaneError] = UrdfError) -> Mapping[str, Any]:
    """Return a mapping whose keys are texts in `valid`; else raise `error`."""
    expected = f'a mapping of {", ".join(valid)}' if valid else 'a mapping of names'
    if not isinstance(data, Mapping):
        raise error(f'{what}: {SHORT.repr(data)}; expected {expected}')
    for key in data:
        if not isinstance(key, str) or (valid and key not in valid):
            raise error(f'{what}: unknown key {SHORT.repr(key)}; expected one of '
                        f'{listing(valid or ["names"])}')
    return data
