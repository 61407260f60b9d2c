"""Warnings and errors with a limited rate."""

import time
from typing import Any

PERIOD = 1.0  # s between two warnings for one reason


class ThrottledWarning:
    """
    Logs warnings of dropped messages and errors, one a second for each reason.

    Parameters
    ----------
    log : rclpy logger

    """

    def __init__(self, log: Any) -> None:
        self._log = log
        self._last: dict[str, float] = {}

    def __call__(self, reason: str, detail: str) -> None:
        """Log a warning, unless a line for this reason was logged just before."""
        if self._is_due(reason):
            self._log.warning(f'{reason}: {detail}')

    def error(self, reason: str, detail: str) -> None:
        """Log an error, unless a line for this reason was logged just before."""
        if self._is_due(reason):
            self._log.error(f'{reason}: {detail}')

    def _is_due(self, reason: str) -> bool:
        """Return whether a line for this reason may be logged, and note that it is."""
        now = time.monotonic()
        due = now - self._last.get(reason, -PERIOD) >= PERIOD
        if due:
            self._last[reason] = now
        return due
