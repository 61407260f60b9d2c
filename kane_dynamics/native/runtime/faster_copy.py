"""
Choose the faster of two copies of long machine code.

Straight-line code that fills the caches of instructions runs longer in some memory than
elsewhere: on Zen 5 more than 1.2 times as long in one of ten to twenty allocations of 25
to 45 kB. It depends on the physical pages of the code alone (the same pages take the same
time at any virtual address, with any data, on any core; reading them as data takes no
longer), on which a program has no influence. Two copies, in different pages, are rarely
slow both.
"""

from collections.abc import Callable
import math
import time

from kane_dynamics.native.machine_code import llvm

Trial = Callable[[llvm.Address], object]  # calls the function at an address some times
LONG = 2**14  # bytes of object code from which two copies are compared; shorter is not slow
FASTER = 0.95  # share of the first copy's time below which the second one is taken
TURNS = 5


def faster_copy(objects: bytes, symbol: str, make_trial: Callable[[], Trial]) -> llvm.Code:
    """
    Return an object file in executable memory, if it is long the faster of two copies.

    Parameters
    ----------
    objects : bytes
        The object file.
    symbol : str
        Name of the function that is timed.
    make_trial : callable
        Returns the trial that is timed; called if the code is long.

    """
    first = llvm.Code(objects)
    if len(objects) < LONG:
        return first
    second = llvm.Code(objects)
    trial = make_trial()
    shortest = {first: math.inf, second: math.inf}
    # The least times: other processes only lengthen them. The copies alternate.
    for _ in range(TURNS):
        for code in shortest:
            address = code.address(symbol)
            start = time.perf_counter()
            trial(address)
            shortest[code] = min(shortest[code], time.perf_counter() - start)
    return second if shortest[second] < FASTER * shortest[first] else first
