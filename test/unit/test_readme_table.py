"""The table of speeds in the README is that of recorded figures."""

from pathlib import Path

from benchmarks import readme_table, report

ROOT = Path(__file__).resolve().parents[2]


def test_the_readme_shows_the_recorded_figures():
    figures = readme_table.json.loads(readme_table.RECORDED.read_text(encoding='utf-8'))
    assert list(figures['rows']) == list(readme_table.ROWS)
    text = (ROOT / 'README.md').read_text(encoding='utf-8')
    assert readme_table.table(figures) in text


def test_the_recorded_figures_meet_the_gates_of_the_benchmarks():
    figures = readme_table.json.loads(readme_table.RECORDED.read_text(encoding='utf-8'))
    least = {(gate.what, gate.peer): gate.least for gate in report.gates()
             if readme_table.ROBOT in gate.robots}
    for name, place in readme_table.ROWS.items():
        ours, theirs = figures['rows'][name]
        assert theirs / ours >= least.get(place, 1.0), name
