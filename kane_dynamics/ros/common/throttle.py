"""Warnings that do not flood the log."""

import time
from typing import Any

PERIOD = 1.0  # s between two warnings of one kind


class ThrottledWarning:
    """
    Warns of messages that were dropped, at most once a second for each reason.

    Parameters
    ----------
    log : rclpy logger

    """

    def __init__(self, log: Any) -> None:
        self._log = log
        self._last: dict[str, float] = {}

    def __call__(self, reason: str, detail: str) -> None:
        """Warn, unless that was done a moment ago."""
        now = time.monotonic()
        if now - self._last.get(reason, -PERIOD) >= PERIOD:
            self._last[reason] = now
            self._log.warning(f'{reason}: {detail}')
