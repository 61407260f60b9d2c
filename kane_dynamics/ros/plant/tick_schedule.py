"""Ticks by an absolute schedule: one that comes late does not make the next one late."""

MOST_LAG = 100_000_000  # ns behind the schedule from which on it is moved instead of caught up on


class TickSchedule:
    """
    The schedule of ticks on a clock that only goes forward.

    Parameters
    ----------
    period : float
        Between two ticks, ns.

    Attributes
    ----------
    overruns : int
        Ticks that came later than the next one was due.
    skipped : float
        s by which the schedule was moved, because it was too far behind to be caught up on.
    worst : int
        Largest delay of a tick since this was set to zero, ns.

    """

    def __init__(self, period: float) -> None:
        self.overruns = self.worst = 0
        self.skipped = 0.0
        self.period = period
        self._origin = self._ticks = 0

    def start(self, now: int, period: float | None = None) -> None:
        """Let the next tick be due now, ns, and the others follow with this period."""
        self.period = self.period if period is None else period
        self._origin, self._ticks = now, 0

    @property
    def due(self) -> int:
        """When the next tick is due, ns."""
        return self._origin + round(self._ticks * self.period)

    def tick(self, now: int) -> None:
        """Count one tick that begins now, ns; the schedule then says when the next is due."""
        late = now - self.due
        self.worst = max(self.worst, late)
        if late > self.period:
            self.overruns += 1
        if late > max(MOST_LAG, 2.0 * self.period):
            self._origin += late
            self.skipped += late * 1e-9
        self._ticks += 1
