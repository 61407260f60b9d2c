"""Progress bar: on terminals only, removed at the end, with and without rich."""

import io
import sys

from kane_dynamics._util import progress
import pytest


class Terminal(io.StringIO):
    """Stream that claims to be a terminal."""

    def isatty(self):
        """Return True."""
        return True


def put_terminal(monkeypatch, rich):
    """Replace stderr by a terminal, without delay of the bar; with rich or without."""
    stream = Terminal()
    monkeypatch.setattr(sys, 'stderr', stream)
    monkeypatch.setattr(progress, 'DELAY', -1.0)
    monkeypatch.setattr(progress, 'find_spec', lambda name: rich)
    return stream


def test_shows_nothing_where_there_is_no_terminal(capsys):
    with progress.progress_bar('working', 2.0) as report:
        assert report(1.0) is True
    assert capsys.readouterr().err == ''


def test_without_rich_a_plain_bar_tells_the_share_and_is_wiped_out(monkeypatch):
    terminal = put_terminal(monkeypatch, rich=False)
    monkeypatch.setattr(progress, '_PERIOD', 0.0)
    with progress.progress_bar('working', 2.0) as report:
        assert report(0.5) is True
        report(1.0)
    shown = terminal.getvalue()
    assert 'working [' in shown and ' 25%' in shown and ' 50%' in shown
    assert shown.endswith('\r') and not shown.split('\r')[-2].strip()


def test_with_rich_its_bar_is_used(monkeypatch):
    pytest.importorskip('rich')
    terminal = put_terminal(monkeypatch, rich=True)
    monkeypatch.setenv('TERM', 'xterm')
    with progress.progress_bar('working', 2.0) as report:
        assert report(1.0) is True
    assert 'working' in terminal.getvalue()


def test_a_failure_inside_passes_through(monkeypatch):
    put_terminal(monkeypatch, rich=False)
    with pytest.raises(ValueError,
                       match='inner'), progress.progress_bar('x', 1.0) as report:
        report(0.1)
        raise ValueError('inner')
