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
BLUE, ORANGE, GREEN, RED = '#0072B2', '#E69F00', '#009E73', '#D55E00'
PINK, SKY, GREY, INK = '#CC79A7', '#56B4E9', '#8A8F98', '#22262B'
LINES = (BLUE, ORANGE, GREEN, RED, PINK, SKY, GREY)
NEAR = 2.0  # limits within this multiple of the values are drawn
MARGIN = 0.06  # of a panel's height, beyond a limit
NOISE = 1e-9  # of the largest torque, or rad, m, rad/s, m/s: below is rounding error
THIN = 0.8  # line width of background and of measured values
_STYLE: Any = {
    'font.family': 'sans-serif', 'font.size': 10.0, 'text.color': INK, 'figure.dpi': 100.0,
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
    suffix = os.path.splitext(path)[1]
    valid = [f'.{name}' for name in sorted(FigureCanvasBase.filetypes)]
    if suffix.lower() not in valid:
        raise InputError(f"picture: '{os.fspath(path)}'; expected a suffix of "
                         f'{", ".join(valid)}')


@contextmanager
def styled(width: float, height: float, title: str, path: Path | None) -> Iterator[Figure]:
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
    panels = figure.subplots(-(-count // columns), columns, sharex=share_x, squeeze=False)
    for axes in panels.flat[count:]:
        axes.remove()
    left: list[Axes] = list(panels.flat[:count])
    for axes in left[-columns:]:
        axes.tick_params(labelbottom=True)
    return left


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


def draw(axes: Axes, t: Array, lines: Mapping[str, tuple[Array, str, Any]]) -> None:
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
    """Plot -bound and bound if values come near them; else write the bound above the corner."""
    if not np.isfinite(bound):
        return
    low, high = axes.get_ylim()
    near = [sign for sign in (-1.0, 1.0) if bound < NEAR * float((sign * values).max(initial=0.0))]
    for sign in near:
        axes.axhline(sign * bound, color=RED, linestyle='--', linewidth=1.0, label='limit')
    reach = [sign * (1.0 + MARGIN) * bound for sign in near]
    axes.set_ylim(min([low, *reach]), max([high, *reach]))
    if not near:
        axes.set_title(f'limit ±{bound:g}', loc='right', fontsize=8.0, fontweight='normal',
                       color=RED)  # above the panel, where no curve is


def hide_rounding(axes: Axes, noise: float, span: float) -> None:
    """Extend the height of a panel with only rounding errors until they are a line."""
    low, high = axes.get_ylim()
    lines = [np.asarray(line.get_ydata(), dtype=np.float64) for line in axes.lines]
    if max((float(np.ptp(values)) for values in lines if len(values)), default=0.0) > noise:
        return
    middle = float(np.mean([np.mean(values) for values in lines])) if lines else 0.0
    middle = 0.0 if abs(middle) <= noise else middle
    axes.set_ylim(min(low, middle - span), max(high, middle + span))


def titled(given: str | None, what: str, name: str) -> str:
    """Return the given title, else one with the name of the robot."""
    return f'{name}: {what}' if given is None else given


def above(axes: Axes, columns: int) -> None:
    """Place the legend of a panel above its upper right corner."""
    axes.legend(loc='lower right', bbox_to_anchor=(1.0, 1.0), borderaxespad=0.0, ncols=columns)


def beside(axes: Axes, *words: tuple[str, str]) -> None:
    """Write (text, color) pairs beside a panel, top down, all but the first in bold."""
    for k, (text, color) in enumerate(words):
        axes.text(1.02, 0.98 - 0.18 * k, text, transform=axes.transAxes, va='top', fontsize=9.0,
                  color=color, fontweight='bold' if k else 'normal')


def legend_below(figure: Figure, panels: Any, last: Sequence[str] = ()) -> None:
    """Place one legend of all panels below them; labels in `last` come last, in this order."""
    shown: dict[str, Any] = {}
    for axes in panels:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            shown.setdefault(label, handle)
    order = sorted(shown, key=lambda label: last.index(label) if label in last else -1)
    figure.legend([shown[label] for label in order], order, loc='outside lower center',
                  ncols=min(len(order), 5 if figure.get_figwidth() < 12.0 else 9),
                  columnspacing=1.6)


def unit(what: str, names: Sequence[str], prismatic: Collection[str]) -> str:
    """Return the unit of a panel, or both units if it shows both kinds of joints."""
    turning, sliding = _UNITS[what]
    slides = [name in prismatic for name in names]
    return sliding if all(slides) else f'{turning}, {sliding}' if any(slides) else turning


def rms(values: Array) -> float:
    """Return the root mean square."""
    return float(np.sqrt(np.mean(values * values)))
