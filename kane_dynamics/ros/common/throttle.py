"""Warnings with a limited rate."""

import time
from typing import Any

PERIOD = 1.0  # s between two warnings for one reason


class ThrottledWarning:
    """
    Logs warnings about dropped messages, at most one a second for each reason.

    Parameters
    ----------
    log : rclpy logger

    """

    def __init__(self, log: Any) -> None:
        self._log = log
        self._last: dict[str, float] = {}

    def __call__(self, reason: str, detail: str) -> None:
        """Log a warning, unless one for this reason was logged less than a period ago."""
        now = time.monotonic()
        if now - self._last.get(reason, -PERIOD) >= PERIOD:
            self._last[reason] = now
            self._log.warning(f'{reason}: {detail}')
