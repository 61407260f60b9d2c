"""Arguments --plot and --plot-of."""

from argparse import ArgumentParser

KINDS = ('trajectory', 'torque-by-source', 'energy', 'reactions', 'phase')


def add_plot(parser: ArgumentParser, *kinds: str) -> None:
    """Add --plot, and --plot-of for several kinds, of which the first is the default."""
    words = f'picture of {kinds[0]}' if len(kinds) == 1 else 'picture'
    parser.add_argument('--plot', metavar='FILE', help=f'{words}, .png, .svg or .pdf')
    parser.set_defaults(plot_of=None, plot_default=kinds[0])
    if len(kinds) > 1:
        parser.add_argument('--plot-of', choices=kinds, metavar='WHAT',
                            help=f'{", ".join(kinds)}; default: {kinds[0]}')
