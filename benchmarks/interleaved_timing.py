"""Timing on a noisy machine: contenders alternate; ratios are computed for each turn."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
import random
import time
from timeit import Timer

import numpy as np

TURNS = 125
TURN_SECONDS = 0.002  # short, so that others of the machine disturb few turns


@dataclass(frozen=True)
class Timing:
    """Seconds per call of each contender, one value per turn."""

    seconds: Mapping[str, np.ndarray]

    def undisturbed(self, name: str) -> float:
        """Return the 10th percentile of the time of a call, s: others only add to it."""
        return float(np.quantile(self.seconds[name], 0.1))

    def ratio(self, slow: str, fast: str) -> tuple[float, float, float]:
        """Return slow / fast of undisturbed turns, 10th and 90th percentile of all."""
        low, high = np.percentile(self.seconds[slow] / self.seconds[fast], [10, 90])
        return self.undisturbed(slow) / self.undisturbed(fast), float(low), float(high)


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
