"""The notebook runs from top to bottom and prints what it shows."""

from copy import deepcopy
from pathlib import Path

from documents import ROOT
import nbformat
import pytest

nbclient = pytest.importorskip('nbclient')
pytest.importorskip('ipykernel')
NOTEBOOK = ROOT / 'examples' / 'first_hour.ipynb'


def results(notebook):
    """Return the printed text, and the kinds of further output, of each cell."""
    cells = [cell for cell in notebook.cells if cell.cell_type == 'code']
    printed = []
    for cell in cells:
        printed.append(''.join(output.text for output in cell.outputs
                               if output.output_type == 'stream'))
    kinds = [{kind for output in cell.outputs for kind in output.get('data', ())}
             for cell in cells]
    return printed, kinds


@pytest.mark.timeout(300)
def test_the_notebook_prints_what_it_shows(monkeypatch):
    monkeypatch.setenv('PYTHONPATH', str(ROOT))
    shown = nbformat.read(NOTEBOOK, as_version=4)
    executed = deepcopy(shown)
    folder = str(Path(NOTEBOOK).parent)
    client = nbclient.NotebookClient(executed, resources={'metadata': {'path': folder}},
                                     timeout=240)
    client.execute()
    assert results(executed) == results(shown)
