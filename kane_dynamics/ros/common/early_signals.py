"""
Signals while a node's modules are imported; imports nothing long itself.

A KeyboardInterrupt would be lost in code that ignores exceptions, such as the callbacks
of the import system, and the node would run on.
"""

import os
import signal

SIGNALS = (signal.SIGINT, signal.SIGTERM)


def exit_on_signal() -> None:
    """End with exit code 0 on SIGINT or SIGTERM, until the node handles them."""
    for number in SIGNALS:
        signal.signal(number, lambda number, frame: os._exit(0))
