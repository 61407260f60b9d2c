"""Settings of all tests."""

import gc


def pytest_collection_finish(session):
    """Keep the modules and the list of tests out of all garbage collections."""
    gc.collect()
    gc.freeze()
