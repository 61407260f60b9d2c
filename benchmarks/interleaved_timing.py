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
Clock = Callable[[], float]


def interleaved(contenders: Mapping[str, Contender], turns: int = TURNS,
                clock: Clock = time.perf_counter) -> Timing:
    """
    Time contenders alternately in shuffled order, each for about `TURN_SECONDS` a turn.

    `clock` returns s; `time.process_time` excludes other processes, for single-threaded
    contenders whose small difference matters.
    """
    counts = {name: _calls_a_turn(call, clock) for name, call in contenders.items()}
    seconds = {name: np.empty(turns) for name in contenders}
    order = list(contenders)
    shuffle = random.Random(0).shuffle
    # In each turn all contenders meet the same load of the machine, in any order.
    for turn in range(turns):
        shuffle(order)
        for name in order:
            count = counts[name]
            seconds[name][turn] = _time(contenders[name], count, clock) / count
    return Timing(seconds)


def _time(call: Contender, count: int, clock: Clock) -> float:
    if isinstance(call, Timer):
        return call.timeit(count)
    loop = range(count)
    start = clock()
    for _ in loop:
        call()
    return clock() - start


def _calls_a_turn(call: Contender, clock: Clock) -> int:
    """Return the number of calls in a turn of about `TURN_SECONDS`."""
    _time(call, 1, clock)  # the first call may compile
    count = 1
    while (took := _time(call, count, clock)) < 0.2 * TURN_SECONDS:
        count *= 4
    return max(1, round(count * TURN_SECONDS / took))
