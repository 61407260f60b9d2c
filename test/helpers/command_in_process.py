"""Commands run in the tests' own process; what a process adds is tested apart."""

from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from subprocess import CompletedProcess

from kane_dynamics.cli import main


def command(*arguments):
    """Run kane-dynamics with these arguments; return what a process would have left."""
    out = StringIO()
    err = StringIO()
    with redirect_stdout(out), redirect_stderr(err):
        try:
            code = main(arguments)
        except SystemExit as end:  # argparse
            code = end.code
    return CompletedProcess(arguments, code, out.getvalue(), err.getvalue())
