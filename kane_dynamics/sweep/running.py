"""Run a sweep: compute and write the chunks that are not in its table yet."""

from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass
import os
import warnings

from kane_dynamics._util.checks import integer
from kane_dynamics._util.progress import progress_bar
from kane_dynamics.errors import ModelWarning
from kane_dynamics.native.runtime.threads import MAX_THREADS, thread_count
from kane_dynamics.sweep.description import Sweep
from kane_dynamics.sweep.simulator import Simulator, task
from kane_dynamics.sweep.table import SweepTable
from kane_dynamics.sweep.workers import Done, here, processes


@dataclass(frozen=True)
class Summary:
    """Numbers of trials of a run: found in the table, computed, failed among the computed."""

    found: int
    made: int
    failed: int
    digest: str


def run_sweep(sweep: Sweep, folder: str | os.PathLike[str], *,
              workers: int | None = None) -> Summary:
    """
    Complete the table of a sweep in a folder.

    Rows are written as chunks finish. Running the same sweep with the same folder
    continues an interrupted run; chunks that were not finished are computed again. A run
    that ends before its first chunks, as in the seconds in which kernels compile, has
    written nothing: a smaller `Sweep.chunk` loses less. On processors of one kind, the
    rows are equal bit for bit for any number and kind of workers.

    Parameters
    ----------
    sweep : Sweep
        The sweep.
    folder : path
        New, empty, or the folder of this sweep.
    workers : int, optional
        Number of processes. Default: ``KANE_DYNAMICS_THREADS``, else one per processor.
        1 runs in this process. More than 1 requires ``if __name__ == '__main__':`` in
        the calling script.

    Returns
    -------
    Summary

    Raises
    ------
    InputError
        If the folder has other content, or a package is missing.
    ConstraintError
        If a function of time jumps, as in `simulate`.
    SweepError
        If workers die, or another process writes to the folder.

    Warns
    -----
    ModelWarning
        If the step is too large for the model, or the integrator 'implicit' is chosen
        for it, as in `simulate`.

    """
    if workers is not None:
        workers = integer(workers, 'workers', 1, MAX_THREADS)
    table, work = SweepTable(sweep, folder), task(sweep)
    computed = failed = 0
    with table.opened() as finished:
        # Chunks of an earlier run are there already; their trials are the same.
        chunks = [chunk for chunk in range(sweep.chunks) if chunk not in finished]
        present = sum(len(sweep.rows(chunk)) for chunk in finished)
        if chunks:
            simulator = Simulator(sweep)
            simulator.compile()  # raises errors early; workers load from the cache
            simulator.check_functions()
            if simulator.step_text is not None:
                warnings.warn(simulator.step_text, ModelWarning, stacklevel=2)
        with (progress_bar('simulating', sweep.samples) as progress,
              closing(_computed(sweep, work, chunks, workers or thread_count()))
              as results):
            # Each chunk is written when it is complete, so that an interrupted sweep
            # goes on from there.
            for chunk, columns in results:
                table.write(chunk, columns)
                computed += len(columns['ok'])
                failed += int((~columns['ok']).sum())
                progress(present + computed)
    return Summary(present, computed, failed, table.digest)


def _computed(sweep: Sweep, work: bytes, chunks: Sequence[int], workers: int) -> Done:
    """Compute chunks; yield them as they finish."""
    if chunks[:1] == [0] and len(sweep.rows(0)) < sweep.chunk:
        # A short first chunk comes before workers start, so that its rows are seen
        # early.
        yield from here(work, [0])
        chunks = chunks[1:]
    if min(workers, len(chunks)) < 2:
        yield from here(work, chunks)
    else:
        yield from processes(work, chunks, workers)
