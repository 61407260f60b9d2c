"""The libraries of the extra `identify`, imported when they are first needed."""

from collections.abc import Callable
from functools import partial, wraps
from typing import ParamSpec, TypeVar

from kane_dynamics._util.optional_imports import extra

P = ParamSpec('P')
R = TypeVar('R')
scientific = partial(extra, name='identify', what='identification')


def on_one_processor(function: Callable[P, R]) -> Callable[P, R]:
    """
    Return the function with linear algebra on one thread.

    Its matrices are small: the threads of a BLAS wait for each other in busy loops, for several
    times the processor time of the work.
    """
    @wraps(function)
    def limited(*args: P.args, **kwargs: P.kwargs) -> R:
        with scientific('threadpoolctl').threadpool_limits(1):
            return function(*args, **kwargs)
    return limited
