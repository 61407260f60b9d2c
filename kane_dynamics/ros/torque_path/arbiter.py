"""Which of two processes publishes on `commands`."""

from typing import Protocol


class Arbiter(Protocol):
    """Decides which of two processes publishes on `commands`; times are of `perf_counter`."""

    def start(self) -> None:
        """Start, with the torque path."""

    def may_command(self, now: float) -> bool:
        """Return whether this process may command; called once for each valid state."""

    def may_stop(self, now: float) -> bool:
        """Return whether this process may command zeros because states are stale."""

    def note_zeros(self) -> None:
        """Note that this process commanded zeros."""

    def confirm(self, now: float) -> bool:
        """Return whether this process may still command, immediately before it does."""
