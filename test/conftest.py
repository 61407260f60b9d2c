"""Settings of all tests."""

import gc

from kane_dynamics.native.machine_code import compiling
import pytest


def pytest_collection_finish(session):
    """Keep the modules and the list of tests out of all garbage collections."""
    gc.collect()
    gc.freeze()


@pytest.fixture(autouse=True)
def no_lines_of_progress(monkeypatch):
    """Compile without lines of progress, which a busy machine could add."""
    monkeypatch.setattr(compiling, 'SLOW', 1e6)
