"""Plot of the results of a sweep over the values that vary."""

from collections.abc import Mapping, Sequence
from typing import Any

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.plot.style import BLUE, Path, RED, styled
from matplotlib.figure import Figure
import numpy as np

MOST = 6  # values that vary
RESULTS = {'peak_torque.': 'Largest torque\n[N m, N]',
           'rms_error.': 'Largest tracking error, RMS\n[rad, m]'}


def plot_sweep(table: Mapping[str, Sequence[Any]], path: Path | None = None, *,
               title: str = 'Sweep') -> Figure:
    """
    Plot the largest torque and tracking error of each trial over what varies.

    Trials that failed are marked on the axis of the value.

    Parameters
    ----------
    table : mapping of str to sequence
        Columns of the table, such as ``read_table(folder).to_pydict()``. Of more than
        six values that vary, the first six are drawn.
    path, title
        See `kane_dynamics.plot`.

    Raises
    ------
    InputError
        No value varies.

    """
    varied = _varied(table)
    if not varied:
        raise InputError('sweep: the same values in all trials; expected one that '
                         'varies')
    # Failed trials have no result: they are crosses at the lower edge.
    ok = np.array(table['ok'], dtype=bool)
    results = {}
    for prefix in RESULTS:
        if any(name.startswith(prefix) for name in table):
            results[prefix] = _largest(table, prefix)
    names = list(varied)[:MOST]
    with styled(1.0 + 3.2 * len(names), 1.0 + 3.0 * len(results), title, path) as figure:
        panels = figure.subplots(len(results), len(names), sharex='col', sharey='row',
                                 squeeze=False)
        # A panel for each result over each value that varies.
        for row, (prefix, result) in zip(panels, results.items(), strict=True):
            for axes, name in zip(row, names, strict=True):
                values = varied[name]
                axes.plot(values[ok], result[ok], '.', color=BLUE, markersize=4.0,
                          label='completed')
                if not ok.all():
                    axes.plot(values[~ok], np.zeros((~ok).sum()), 'x', color=RED,
                              label='failed', transform=axes.get_xaxis_transform())
            row[0].set_ylabel(RESULTS[prefix])
        for axes, name in zip(panels[-1], names, strict=True):
            axes.set_xlabel(name)
            axes.margins(x=0.03)
    return figure


def _varied(table: Mapping[str, Sequence[Any]]) -> dict[str, Array]:
    """Return the columns of inputs that vary, by name."""
    columns = list(table)
    varied = {}
    for name in columns[columns.index('seed') + 1:columns.index('ok')]:
        if all(isinstance(value, int | float) for value in table[name]):
            values = np.array(table[name], dtype=np.float64)
            if len(values) and np.ptp(values) > 0.0:
                varied[name] = values
    return varied


def _largest(table: Mapping[str, Sequence[Any]], prefix: str) -> Array:
    """Return the largest of the columns with a prefix in each row, or NaN."""
    # As floats, None is NaN.
    columns = [np.array(table[name], dtype=np.float64) for name in table
               if name.startswith(prefix)]
    return np.asarray(np.abs(columns).max(axis=0))
