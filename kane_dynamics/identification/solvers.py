"""Libraries of the extra `identify`, imported at their first use."""

from collections.abc import Callable
from functools import partial, wraps
from typing import ParamSpec, TypeVar

from kane_dynamics._util.optional_imports import extra

P = ParamSpec('P')
R = TypeVar('R')
scientific = partial(extra, name='identify', what='identification')


def on_one_processor(function: Callable[P, R]) -> Callable[P, R]:
    """
    Return the function with BLAS limited to one thread.

    The matrices are small: threads of a BLAS would mostly wait for each other in busy
    loops.
    """
    @wraps(function)
    def limited(*args: P.args, **kwargs: P.kwargs) -> R:
        with scientific('threadpoolctl').threadpool_limits(1):
            return function(*args, **kwargs)
    return limited
