"""Counters and latencies of a node, for its diagnostics."""

from collections import Counter
from collections.abc import Mapping
import math

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
import numpy as np

WINDOW = 8192  # latencies kept between two reports: enough for 8 kHz at 1 report/s


class Statistics:
    """Counters since the node was configured, and since the last report."""

    def __init__(self) -> None:
        self.commands = 0
        self.clamped = 0
        self.timeouts = 0
        self.faults = 0  # times that states were refused for longer than the grace time
        self.foreign_states = 0  # joint states that contain other joints only
        self.unobserved = 0  # cycles of the native path that nothing could observe
        self.full_parses = 0  # states whose layout was not cached
        self.dropped: Counter[str] = Counter()
        self.rejected: Counter[str] = Counter()
        self.worst_age = 0.0
        self._latency = np.zeros(WINDOW)
        self._last_commands = 0
        self._last_dropped: Counter[str] = Counter()

    def command(self, latency: float, age: float, clamped: bool) -> None:
        """Count one command: duration of its callback, age of its state, s."""
        self._latency[self.commands % WINDOW] = latency
        self.commands += 1
        self.clamped += clamped
        if age > self.worst_age:
            self.worst_age = age

    def period(self, seconds: float) -> tuple[float, Counter[str], dict[str, str]]:
        """
        Close a reporting period of `seconds` and return its figures.

        Returns
        -------
        rate : float
            Commands per second.
        dropped : Counter
            Joint states dropped in this period, by reason.
        values : dict of str
            Printable figures: rate, latency percentiles, ages, counts.

        """
        new = self.commands - self._last_commands
        # Copies, because the torque path counts in another thread.
        all_dropped = Counter(dict(self.dropped))
        rejected = dict(self.rejected)
        dropped = all_dropped - self._last_dropped
        self._last_commands = self.commands
        self._last_dropped = all_dropped
        values = {'rate': f'{new / seconds:.1f} Hz', 'commands': str(self.commands)}
        if new:
            # Not np.percentile: its first call imports modules, for 0.1 s without a
            # command.
            latest = self.commands - 1 - np.arange(min(new, WINDOW))
            latencies = np.sort(self._latency[latest % WINDOW])
            for name, share in (('p50', 0.5), ('p99', 0.99), ('max', 1.0)):
                latency = latencies[math.ceil(share * len(latencies)) - 1]
                values[f'callback latency {name}'] = f'{1e6 * latency:.0f} us'
            values['largest age of state'] = f'{self.worst_age * 1e3:.2f} ms'
        self.worst_age = 0.0
        values['commands clamped'] = str(self.clamped)
        values['timeouts'] = str(self.timeouts)
        values['states with uncached layout'] = str(self.full_parses)
        if self.unobserved:
            values['cycles not observed'] = str(self.unobserved)
        values['states of other joints'] = str(self.foreign_states)
        values['states dropped'] = str(all_dropped.total())
        for what, counts in (('states dropped', all_dropped), ('rejected', rejected)):
            for reason, count in counts.items():
                values[f'{what}: {reason}'] = str(count)
        return new / seconds, dropped, values


def status(name: str, hardware: str, level: bytes, message: str,
           values: Mapping[str, str]) -> DiagnosticStatus:
    """Return one entry of a DiagnosticArray."""
    pairs = [KeyValue(key=key, value=value) for key, value in values.items()]
    return DiagnosticStatus(name=name, hardware_id=hardware, level=level,
                            message=message, values=pairs)
