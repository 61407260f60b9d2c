"""Fields of frozen dataclasses."""

from typing import Any


def freeze(record: Any, name: str, value: Any) -> None:
    """Set a field of a frozen dataclass during its construction."""
    object.__setattr__(record, name, value)
