"""
Cache of checked models on disk, as JSON: results of `load_urdf` by input.

JSON stores numbers exactly and executes no code when read. A record is an object with
one key, the name of its class; an array is stored with its shape and its numbers.
"""

from collections.abc import Callable, Mapping
from dataclasses import fields
from functools import cache
import hashlib
from importlib.util import find_spec
import json
import os
from pathlib import Path
from typing import Any

from kane_dynamics._util import disk_cache
from kane_dynamics.errors import ModelError
from kane_dynamics.model.beam import Beam, Deflection
from kane_dynamics.model.drive import Drive, StiffnessCurve
from kane_dynamics.model.model import Body, Frame, Inertial, Joint, Limits, Model
import numpy as np

RECORDS: dict[str, Callable[..., Any]] = {
    record.__name__: record
    for record in (Beam, Body, Deflection, Drive, Frame, Inertial, Joint, Limits, Model,
                   StiffnessCurve)}


def model_key(text: str, supplement: Any, options: Mapping[str, Any]) -> str | None:
    """
    Return the cache key of a model.

    Parameters
    ----------
    text : str
        Text of the URDF.
    supplement, options
        Further arguments of `load_urdf`.

    Returns
    -------
    str or None
        None if an argument is not plain data, or the supplement cannot be read.

    """
    try:
        if isinstance(supplement, str | os.PathLike):
            content = 'file ' + hashlib.sha256(Path(supplement).read_bytes()).hexdigest()
        else:
            content = repr(_comparable(supplement))
        arguments = repr(_comparable(options))
    except (OSError, TypeError, ValueError):
        return None
    return disk_cache.key('model', text, content, arguments, _reader_version())


@cache
def _reader_version() -> str:
    """Return the version of the installed yourdfpy without importing it."""
    spec = find_spec('yourdfpy')
    folders = (spec and spec.submodule_search_locations) or []
    return ' '.join(disk_cache.source_digest(folder) for folder in folders)


def _comparable(value: Any) -> Any:
    """Return plain data whose repr identifies values and types, or TypeError."""
    # Types are part of the key: 1, 1.0 and True describe different things.
    if isinstance(value, np.ndarray):
        if value.dtype.kind not in 'biufU':
            return _comparable(value.tolist())
        return 'array', value.dtype.str, value.tolist()
    if isinstance(value, np.generic):
        return value.dtype.str, value.item()
    if isinstance(value, Mapping):
        return 'mapping', [(_comparable(k), _comparable(v)) for k, v in value.items()]
    if isinstance(value, list | tuple):
        return [_comparable(item) for item in value]
    if value is None or type(value) in (str, int, float, bool):
        return value
    # Anything else (a function, an object) has no repr that identifies it.
    raise TypeError


def cached_model(name: str) -> tuple[Model, list[str]] | None:
    """Return a cached model and its warnings, or None if there is no entry."""
    content = disk_cache.load(name)
    if content is None:
        return None
    # An entry that cannot be read is as good as none: the file is read again.
    try:
        model, warnings = json.loads(content, object_hook=_record)
    except (ArithmeticError, LookupError, ModelError, RecursionError, TypeError,
            ValueError):
        return None
    if not isinstance(model, Model):
        return None
    return model, warnings


def store_model(name: str, model: Model, warnings: list[str]) -> None:
    """Store a model and its warnings, if reading them back gives the same model."""
    # A number that JSON changed, or a class that it does not know, would show here.
    content = json.dumps([model, warnings], default=_plain)
    model_read_back, _ = json.loads(content, object_hook=_record)
    if model_read_back.digest() == model.digest():
        disk_cache.store(name, content.encode())


def _plain(value: Any) -> dict[str, Any]:
    """Convert a record or an array to JSON data."""
    if isinstance(value, np.ndarray):
        return {'array': [value.shape, value.ravel().tolist()]}
    values = [getattr(value, field.name) for field in fields(value)]
    return {type(value).__name__: values}


def _record(data: dict[str, Any]) -> Any:
    """Convert JSON data from `_plain` back to a record, an array or a mapping."""
    name = next(iter(data), '')
    if name != 'array' and name not in RECORDS:
        return data  # the parameters of a friction law, by name
    content = data[name]
    if name == 'array':
        shape, numbers = content
        array = np.array(numbers, dtype=np.float64).reshape(shape)
        array.flags.writeable = False
        return array
    # JSON has lists only; the records have tuples.
    values = [tuple(value) if isinstance(value, list) else value for value in content]
    return RECORDS[name](*values)
