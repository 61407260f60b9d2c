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
    Plot the largest torque, and tracking error, of each trial over each value that varies.

    Trials that failed are marked on the axis of the value.

    Parameters
    ----------
    table : mapping of str to sequence
        Columns of the table, such as ``read_table(folder).to_pydict()``. Of more than six values
        that vary, the first six are drawn.
    path, title
        See `kane_dynamics.plot`.

    Raises
    ------
    InputError
        No value varies.

    """
    columns = list(table)
    inputs = columns[columns.index('seed') + 1:columns.index('ok')]
    values = {name: np.array(table[name], dtype=np.float64) for name in inputs
              if all(isinstance(value, int | float) for value in table[name])}
    varied = [name for name, column in values.items() if len(column) and np.ptp(column) > 0.0]
    if not varied:
        raise InputError('sweep: the same values in all trials; expected one that varies')
    ok = np.array(table['ok'], dtype=bool)
    results = {prefix: _largest(table, prefix) for prefix in RESULTS
               if any(name.startswith(prefix) for name in columns)}
    shown = varied[:MOST]
    with styled(1.0 + 3.2 * len(shown), 1.0 + 3.0 * len(results), title, path) as figure:
        panels = figure.subplots(len(results), len(shown), sharex='col', sharey='row',
                                 squeeze=False)
        for row, (prefix, result) in zip(panels, results.items(), strict=True):
            for axes, name in zip(row, shown, strict=True):
                axes.plot(values[name][ok], result[ok], '.', color=BLUE, markersize=4.0,
                          label='completed')
                if not ok.all():
                    axes.plot(values[name][~ok], np.zeros((~ok).sum()), 'x', color=RED,
                              label='failed', transform=axes.get_xaxis_transform())
            row[0].set_ylabel(RESULTS[prefix])
        for axes, name in zip(panels[-1], shown, strict=True):
            axes.set_xlabel(name)
            axes.margins(x=0.03)
    return figure


def _largest(table: Mapping[str, Sequence[Any]], prefix: str) -> Array:
    """Return the largest of the columns with a prefix in each row; NaN where a trial failed."""
    columns = [table[name] for name in table if name.startswith(prefix)]
    rows = np.array([[np.nan if value is None else value for value in column]
                     for column in columns], dtype=np.float64)
    return np.asarray(np.abs(rows).max(axis=0))
