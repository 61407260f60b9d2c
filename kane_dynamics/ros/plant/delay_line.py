"""A communication line with delay and dropouts."""

from collections import deque
from collections.abc import Iterator
from typing import Generic, TypeVar

from kane_dynamics.ros.common.conversion import NANO
import numpy as np

T = TypeVar('T')
MAX_ITEMS = 100_000  # in transit: ten seconds at 10 kHz; none arrives while time is paused


class DelayLine(Generic[T]):
    """
    A queue whose items arrive in order after a delay, or are dropped at random.

    When the queue is full, the oldest item is dropped.

    Attributes
    ----------
    dropped : int
        Number of items dropped at random.

    """

    def __init__(self) -> None:
        self.dropped = 0
        self._delay = 0
        self._dropout = 0.0
        self._waiting: deque[tuple[int, T]] = deque(maxlen=MAX_ITEMS)
        self._random = np.random.default_rng(0)

    def configure(self, delay: float, dropout: float) -> None:
        """Set the delay, s, and the probability of dropouts for further items."""
        self._delay, self._dropout = round(delay * NANO), dropout

    def set_generator(self, random: np.random.Generator) -> None:
        """Draw dropouts from this generator."""
        self._random = random

    def clear(self) -> None:
        """Remove all items in transit."""
        self._waiting.clear()

    def send(self, now: int, item: T) -> None:
        """Send an item at a time, ns."""
        if self._dropout > 0.0 and self._random.random() < self._dropout:
            self.dropped += 1
        else:
            self._waiting.append((now + self._delay, item))

    def receive(self, now: int) -> Iterator[T]:
        """Yield the items that have arrived at a time, ns, in the order of `send`."""
        while self._waiting and self._waiting[0][0] <= now:
            yield self._waiting.popleft()[1]
