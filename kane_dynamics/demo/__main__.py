"""Run the demo as ``python -m kane_dynamics.demo``."""

import sys

from kane_dynamics.demo import main

sys.exit(main(sys.argv[1:]))
