"""Fields of frozen dataclasses."""

from dataclasses import fields
from typing import Any

import numpy as np


def freeze(record: Any, name: str, value: Any) -> None:
    """Set a field of a frozen dataclass during its construction."""
    object.__setattr__(record, name, value)


def plain_record(value: Any) -> Any:
    """Convert a record to nested tuples of strings and exactly printed numbers."""
    if isinstance(value, np.ndarray):
        return tuple(value.ravel().tolist())
    if isinstance(value, tuple):
        return tuple(plain_record(item) for item in value)
    if hasattr(value, '__dataclass_fields__'):
        values = [plain_record(getattr(value, field.name)) for field in fields(value)]
        return (type(value).__name__, *values)
    return value
