"""The libraries of the extra `identify`, imported when they are first needed."""

from functools import partial

from kane_dynamics._util.optional_imports import extra

scientific = partial(extra, name='identify', what='identification')
