"""Run the command line as ``python -m kane_dynamics.cli``."""

import sys

from kane_dynamics.cli import main

sys.exit(main())
