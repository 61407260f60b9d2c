"""An absolute schedule of ticks, in which a late tick does not delay the next one."""

MAX_LAG = 100_000_000  # ns; a larger lag shifts the schedule


class TickSchedule:
    """
    A schedule of ticks on a monotonic clock.

    Parameters
    ----------
    period : float
        Time between two ticks, ns.

    Attributes
    ----------
    overruns : int
        Number of ticks that started after the next one was due.
    skipped : float
        Total shift of the schedule after large lags, s.
    worst : int
        Largest delay of a tick since the last reset of this attribute, ns.

    """

    def __init__(self, period: float) -> None:
        self.overruns = self.worst = 0
        self.skipped = 0.0
        self.period = period
        self._origin = self._ticks = 0

    def start(self, now: int, period: float | None = None) -> None:
        """Start the schedule now, ns, optionally with a new period."""
        self.period = self.period if period is None else period
        self._origin = now
        self._ticks = 0

    @property
    def due(self) -> int:
        """Return the time at which the next tick is due, ns."""
        return self._origin + round(self._ticks * self.period)

    def tick(self, now: int) -> None:
        """Record a tick that starts now, ns, and schedule the next one."""
        late = now - self.due
        self.worst = max(self.worst, late)
        if late > self.period:
            self.overruns += 1
        if late > max(MAX_LAG, 2.0 * self.period):
            self._origin += late
            self.skipped += late * 1e-9
        self._ticks += 1
