"""Common style of the plots: colors, fonts, units, panels, legend and file."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
import os
from typing import Any

from kane_dynamics._util.typing import Array
from kane_dynamics._util.whole_files import whole_file
from kane_dynamics.errors import InputError
import matplotlib
from matplotlib.axes import Axes
from matplotlib.backend_bases import FigureCanvasBase
from matplotlib.figure import Figure
import numpy as np

Path = str | os.PathLike[str]

# Palette of Okabe & Ito, which is safe for color blindness, without its pale yellow.
BLUE = '#0072B2'
ORANGE = '#E69F00'
GREEN = '#009E73'
RED = '#D55E00'
PINK = '#CC79A7'
SKY = '#56B4E9'
GREY = '#8A8F98'
INK = '#22262B'
LINES = (BLUE, ORANGE, GREEN, RED, PINK, SKY, GREY)
NEAR = 2.0  # limits within this multiple of the values are drawn
MARGIN = 0.06  # of a panel's height, beyond a limit
NOISE = 1e-9  # of the largest torque, or rad, m, rad/s, m/s: below is rounding error
THIN = 0.8  # line width of background and of measured values
_STYLE: Any = {
    'font.family': 'sans-serif', 'font.size': 10.0, 'text.color': INK,
    'figure.dpi': 100.0,
    'figure.facecolor': 'white', 'savefig.dpi': 150.0, 'axes.edgecolor': '#C4C8CE',
    'axes.labelcolor': INK, 'axes.labelsize': 10.0, 'axes.titlesize': 11.0,
    'axes.titleweight': 'bold', 'axes.titlelocation': 'left', 'axes.titlecolor': INK,
    'axes.spines.top': False, 'axes.spines.right': False, 'axes.grid': True,
    'axes.axisbelow': True, 'axes.formatter.limits': (-3, 4), 'axes.xmargin': 0.0,
    'grid.color': '#E6E8EB', 'grid.linewidth': 0.8, 'xtick.color': '#5A6068',
    'ytick.color': '#5A6068', 'xtick.labelsize': 9.0, 'ytick.labelsize': 9.0,
    'lines.linewidth': 1.6, 'lines.solid_capstyle': 'round', 'legend.frameon': False,
    'legend.fontsize': 10.0, 'legend.handlelength': 1.6, 'path.simplify': True,
    'svg.hashsalt': 'kane_dynamics',  # reproducible files
}
_UNITS = {'Position': ('rad', 'm'), 'Speed': ('rad/s', 'm/s'), 'Torque': ('N m', 'N'),
          'Power': ('W', 'W')}


def check_path(path: Path) -> None:
    """Raise InputError if the suffix of a picture's path is no supported format."""
    if not isinstance(path, (str, os.PathLike)):
        raise InputError(f'picture: a {type(path).__name__}; expected the path of a file')
    suffix = os.path.splitext(path)[1]
    valid = [f'.{name}' for name in sorted(FigureCanvasBase.filetypes)]
    if suffix.lower() not in valid:
        raise InputError(f"picture: '{os.fspath(path)}'; expected a suffix of "
                         f'{", ".join(valid)}')


@contextmanager
def styled(width: float, height: float, title: str,
           path: Path | None) -> Iterator[Figure]:
    """Yield a figure of a size in inches; add the title and save it at the end."""
    if path is not None:
        check_path(path)
    with matplotlib.rc_context(_STYLE):
        figure = Figure(figsize=(width, height), layout='constrained')
        yield figure
        figure.suptitle(title, x=0.01, ha='left', fontsize=14.0, fontweight='bold')
        figure.align_ylabels()
        if path is not None:
            suffix = os.path.splitext(path)[1]
            with whole_file(path, binary=True) as file:
                figure.savefig(file, format=suffix[1:].lower())


def grid(figure: Figure, count: int, columns: int, *, share_x: bool) -> list[Axes]:
    """Return `count` panels in rows of as many columns."""
    rows = -(-count // columns)
    panels = figure.subplots(rows, columns, sharex=share_x, squeeze=False)
    for axes in panels.flat[count:]:
        axes.remove()
    used: list[Axes] = list(panels.flat[:count])
    for axes in used[-columns:]:  # below some of them there was a panel
        axes.tick_params(labelbottom=True)
    return used


def lowest(panels: Sequence[Axes]) -> list[Axes]:
    """Return the last panel of every column."""
    below: dict[int, Axes] = {}
    for axes in panels:
        spec = axes.get_subplotspec()
        assert spec is not None
        below[spec.colspan.start] = axes
    return list(below.values())


def time_axis(panels: Any) -> None:
    """Label the time below every column of panels."""
    for axes in lowest(list(np.asarray(panels).flat)):
        axes.set_xlabel('Time [s]')


def plot_lines(axes: Axes, t: Array,
               lines: Mapping[str, tuple[Array, str, Any]]) -> None:
    """Plot lines by label: values, color, dash."""
    for label, (values, color, dash) in lines.items():
        axes.plot(t, values, color=color, linestyle=dash, label=label)


def zero_line(axes: Axes) -> None:
    """Plot a zero line behind all other lines."""
    axes.axhline(0.0, color=GREY, linewidth=THIN, zorder=0.5)


def show_at_least(axes: Axes, least: float) -> None:
    """Extend a panel to at least +-size, so that rounding errors do not fill it."""
    low, high = axes.get_ylim()
    axes.set_ylim(min(low, -least), max(high, least))


def limit_lines(axes: Axes, values: Array, bound: float) -> None:
    """Plot -bound and bound if values come near them; else write the bound above."""
    if not np.isfinite(bound):
        return
    # Distant limits would flatten the curves: they are written, not drawn.
    low, high = axes.get_ylim()
    is_near = False
    for sign in (-1.0, 1.0):
        if bound < NEAR * float((sign * values).max(initial=0.0)):
            axes.axhline(sign * bound, color=RED, linestyle='--', linewidth=1.0,
                         label='limit')
            reach = sign * (1.0 + MARGIN) * bound
            low = min(low, reach)
            high = max(high, reach)
            is_near = True
    axes.set_ylim(low, high)
    if not is_near:  # the text is above the panel, where no curve is
        axes.set_title('limit '
                       f'±{bound:g}', loc='right', fontsize=8.0, fontweight='normal',
                       color=RED)


def hide_rounding(axes: Axes, noise: float, span: float) -> None:
    """Extend the height of a panel with only rounding errors until they are a line."""
    # A panel whose lines all vary by less than the noise gets a fixed height.
    low, high = axes.get_ylim()
    lines = [np.asarray(line.get_ydata(), dtype=np.float64) for line in axes.lines]
    ranges = [float(np.ptp(values)) for values in lines if len(values)]
    if max(ranges, default=0.0) > noise:
        return
    middle = 0.0
    if lines:
        middle = float(np.mean(list(map(np.mean, lines))))
    if abs(middle) <= noise:
        middle = 0.0
    axes.set_ylim(min(low, middle - span), max(high, middle + span))


def titled(title: str | None, what: str, name: str) -> str:
    """Return the title, if there is one, else one with the name of the robot."""
    return f'{name}: {what}' if title is None else title


def above(axes: Axes, columns: int) -> None:
    """Place the legend of a panel above its upper right corner."""
    axes.legend(loc='lower right', bbox_to_anchor=(1.0, 1.0), borderaxespad=0.0,
                ncols=columns)


def beside(axes: Axes, *words: tuple[str, str]) -> None:
    """Write (text, color) pairs beside a panel, top down, all but the first in bold."""
    weight = 'normal'
    for k, (text, color) in enumerate(words):
        axes.text(1.02, 0.98 - 0.18 * k, text, transform=axes.transAxes, va='top',
                  fontsize=9.0, color=color, fontweight=weight)
        weight = 'bold'


def legend_below(figure: Figure, panels: Any, last: Sequence[str] = ()) -> None:
    """Place one legend of all panels below them; labels in `last` come last."""
    # The first handle of each label, in order of appearance; then those in `last`.
    handles: dict[str, Any] = {}
    for axes in panels:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            handles.setdefault(label, handle)
    for label in last:
        if label in handles:
            handles[label] = handles.pop(label)
    room = 5 if figure.get_figwidth() < 12.0 else 9
    figure.legend(list(handles.values()), list(handles), loc='outside lower center',
                  ncols=min(len(handles), room), columnspacing=1.6)


def panel_unit(what: str, names: Sequence[str], prismatic: Collection[str]) -> str:
    """Return the unit of a panel, or both units if it shows both kinds of joints."""
    turning, sliding = _UNITS[what]
    slides = [name in prismatic for name in names]
    if all(slides):
        return sliding
    return f'{turning}, {sliding}' if any(slides) else turning


def rms(values: Array) -> float:
    """Return the root mean square."""
    return float(np.sqrt(np.mean(values * values)))
