"""Timing on a noisy machine: contenders alternate; ratios are computed for each turn."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
import random
import time
from timeit import Timer

import numpy as np

TURNS = 25
TURN_SECONDS = 0.01


@dataclass(frozen=True)
class Timing:
    """Seconds per call of each contender, one value per turn."""

    seconds: Mapping[str, np.ndarray]

    def median(self, name: str) -> float:
        """Return the median time of a call, s."""
        return float(np.median(self.seconds[name]))

    def ratio(self, slow: str, fast: str) -> tuple[float, float, float]:
        """Return the ratio slow / fast: median, 10th and 90th percentile."""
        ratios = self.seconds[slow] / self.seconds[fast]
        low, middle, high = np.percentile(ratios, [10, 50, 90])
        return float(middle), float(low), float(high)


Contender = Callable[[], object] | Timer  # a Timer avoids the cost of a function call


def interleaved(contenders: Mapping[str, Contender], turns: int = TURNS) -> Timing:
    """Time contenders alternately in shuffled order, each for about `TURN_SECONDS` per turn."""
    counts = {name: _calls_a_turn(call) for name, call in contenders.items()}
    seconds: dict[str, list[float]] = {name: [] for name in contenders}
    order = list(contenders)
    shuffle = random.Random(0).shuffle
    for _ in range(turns):
        shuffle(order)
        for name in order:
            seconds[name].append(_time(contenders[name], counts[name]) / counts[name])
    return Timing({name: np.array(values) for name, values in seconds.items()})


def _time(call: Contender, count: int) -> float:
    if isinstance(call, Timer):
        return call.timeit(count)
    loop = range(count)
    start = time.perf_counter()
    for _ in loop:
        call()
    return time.perf_counter() - start


def _calls_a_turn(call: Contender) -> int:
    """Return the number of calls in a turn of about `TURN_SECONDS`."""
    _time(call, 1)  # the first call may compile
    count = 1
    while (took := _time(call, count)) < 0.2 * TURN_SECONDS:
        count *= 4
    return max(1, round(count * TURN_SECONDS / took))
