"""Report of the benchmarks: no gate passes unmeasured, and every figure is printed."""

import json
import math

from benchmarks import report
import pytest

MACHINE = {'processor': 'Some CPU', 'cores': 2}


def race(gate, robot, ratio):
    """Return a race for a gate."""
    return {'robot': robot, 'axes': 6, 'what': gate.what, 'peer': gate.peer,
            'ours': 1e-7,
            'theirs': ratio * 1e-7, 'ratio': [ratio, 0.9 * ratio, 1.1 * ratio]}


def all_races(factor):
    """Return races for every gate on every robot, at `factor` times its limit."""
    return [race(gate, robot, factor * gate.least)
            for gate in report.gates() for robot in gate.robots]


def start(factor):
    """Return start times, `factor` times faster than their limits."""
    return {what: [limit / factor for limit, _ in limits]
            for what, limits in report.START_GATES.items()}


def test_gates_are_met_at_their_figure_and_missed_below_it():
    assert all(row['met'] for row in report.judged(all_races(1.0), start(1.0)))
    assert not any(row['met'] for row in report.judged(all_races(0.99), start(0.99)))


def test_each_robot_has_to_meet_the_gate_itself():
    gate = report.gates()[0]
    slow = [race(gate, gate.robots[0], 0.5 * gate.least)]
    others = []
    for r in all_races(2.0):
        if (r['what'], r['peer'], r['robot']) != (gate.what, gate.peer, gate.robots[0]):
            others.append(r)
    rows = report.judged(others + slow, start(2.0))
    assert [row['gate'] for row in rows if not row['met']] == [
        f'{gate.robots[0]}: {gate.what} / {gate.peer}']


def test_gates_without_a_measurement_are_not_met():
    rows = report.judged([], {})
    assert len(rows) == (sum(len(gate.robots) for gate in report.gates())
                         + 2 * len(report.START_GATES))
    assert not any(row['met'] for row in rows)
    assert all(math.isnan(row['measured'][0]) for row in rows)


@pytest.mark.parametrize('factor, word', [(2.0, 'met'), (0.5, 'MISSED')])
def test_the_report_tells_every_figure_machine_and_omission(factor, word):
    races = all_races(factor)
    whole = {'date': '2026-01-01', 'machine': MACHINE, 'races': races,
             'gates': report.judged(races, start(factor)), 'start': start(factor),
             'left_out': ['native_loop: there is no g++']}
    text = report.markdown(whole)
    assert 'processor Some CPU, cores 2' in text
    assert 'Left out: native_loop: there is no' in text
    assert text.count(f'| {word} |') == len(whole['gates'])
    for r in races:
        # Near 1, the gates differ in hundredths.
        digits = 1 if r['ratio'][0] >= 1.5 else 2
        middle, low, high = (f'{x:.{digits}f}' for x in r['ratio'])
        ratio = f'{middle} ({low} to {high})'
        assert any(r['what'] in line and ratio in line for line in text.splitlines())
    assert json.loads(json.dumps(report.finite(whole), allow_nan=False))


def test_json_has_null_for_what_was_not_measured():
    rows = report.finite(report.judged([], {}))
    assert json.loads(json.dumps(rows, allow_nan=False))[0]['measured'][0] is None
