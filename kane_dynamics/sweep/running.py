"""Run a sweep: what is not in its table yet is computed and written, chunk by chunk."""

from contextlib import closing
from dataclasses import dataclass
import os
import warnings

from kane_dynamics._util.progress import progress_bar
from kane_dynamics.errors import InputError, ModelWarning
from kane_dynamics.native.runtime.threads import MOST_THREADS, thread_count
from kane_dynamics.sweep.description import Sweep
from kane_dynamics.sweep.simulator import Simulator, task
from kane_dynamics.sweep.table import SweepTable
from kane_dynamics.sweep.workers import cluster, here, processes


@dataclass(frozen=True)
class Summary:
    """What a run did: trials found in the table, made, and failed among those made."""

    found: int
    made: int
    failed: int
    digest: str


def run_sweep(sweep: Sweep, folder: str | os.PathLike[str], *, workers: int | None = None,
              dask: str | None = None) -> Summary:
    """
    Complete the table of a sweep in a folder.

    Rows are written as chunks finish. A run that was ended in any way is carried on by the next
    with the same sweep and folder. The rows do not depend on who computed them, bit for bit on
    processors of one kind.

    Parameters
    ----------
    sweep : Sweep
        What to simulate.
    folder : path
        New, empty, or of this sweep.
    workers : int, optional
        Processes. Default: one a processor, or as many as ``KANE_DYNAMICS_THREADS`` says. With 1
        this process computes itself; with more, a script that calls this needs the usual
        ``if __name__ == '__main__':``.
    dask : str, optional
        Address of a Dask scheduler, as ``tcp://host:8786``, whose workers compute instead. They
        need this version of this package.

    Returns
    -------
    Summary

    Raises
    ------
    InputError
        The folder holds something else, there is no cluster, or something is not installed.
    SweepError
        Workers die, or another process is writing the folder.

    Warns
    -----
    ModelWarning
        The step is too long for the model, as in `simulate`.

    """
    if workers is not None and (not isinstance(workers, int) or isinstance(workers, bool)
                                or not 1 <= workers <= MOST_THREADS):
        raise InputError(f'workers is {workers!r}; expected a whole number from 1 to '
                         f'{MOST_THREADS}')
    table, work = SweepTable(sweep, folder), task(sweep)
    count, made, failed = workers or thread_count(), 0, 0
    with table.opened() as finished:
        chunks = [chunk for chunk in range(sweep.chunks) if chunk not in finished]
        found = sum(len(sweep.rows(chunk)) for chunk in finished)
        if chunks:
            simulator = Simulator(sweep)
            simulator.compile()  # tells what is wrong; workers find it in the cache
            doubt = simulator.doubt()
            if doubt is not None:
                warnings.warn(doubt, ModelWarning, stacklevel=2)
        with progress_bar('simulating', sweep.samples) as progress, closing(
                cluster(work, chunks, dask) if dask is not None else
                here(work, chunks) if min(count, len(chunks)) < 2 else
                processes(work, chunks, count)) as done:
            for chunk, columns in done:
                table.write(chunk, columns)
                made += len(columns['ok'])
                failed += int((~columns['ok']).sum())
                progress(found + made)
    return Summary(found, made, failed, table.digest)
