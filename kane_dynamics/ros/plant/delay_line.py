"""A line of communication that delays and loses what goes through it, as it is told to."""

from collections import deque
from collections.abc import Iterator
from typing import Generic, TypeVar

from kane_dynamics.ros.common.conversion import NANO
import numpy as np

T = TypeVar('T')
MOST = 100_000  # on their way at once, ten seconds at 10 kHz; while time stands, none arrives


class DelayLine(Generic[T]):
    """
    First in, first out, after a delay, unless lost; of too many the newest stay.

    Attributes
    ----------
    lost : int
        How many were lost.

    """

    def __init__(self) -> None:
        self.lost = 0
        self._delay = 0
        self._loss = 0.0
        self._waiting: deque[tuple[int, T]] = deque(maxlen=MOST)
        self._random = np.random.default_rng(0)

    def settle(self, delay: float, loss: float) -> None:
        """Delay by so many s, and lose with this probability, what is put in from now on."""
        self._delay, self._loss = round(delay * NANO), loss

    def draw_from(self, random: np.random.Generator) -> None:
        """Let chance be these random numbers from now on."""
        self._random = random

    def clear(self) -> None:
        """Forget what is on its way."""
        self._waiting.clear()

    def put(self, now: int, item: T) -> None:
        """Send at a time, ns."""
        if self._loss > 0.0 and self._random.random() < self._loss:
            self.lost += 1
        else:
            self._waiting.append((now + self._delay, item))

    def take(self, now: int) -> Iterator[T]:
        """Yield what has arrived by a time, ns; a shorter delay lets nothing overtake."""
        while self._waiting and self._waiting[0][0] <= now:
            yield self._waiting.popleft()[1]
