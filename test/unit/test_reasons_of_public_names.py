"""Every public name is in one group of the tables of public names, with its reason."""

from collections import Counter
from pathlib import Path
import re

import kane_dynamics
from kane_dynamics import ModelBuilder, Robot, rod
from kane_dynamics.ros.parameters.parameter_table import SPECS

ROOT = Path(__file__).resolve().parents[2]
TEXT = (ROOT / 'docs/dev/development.md').read_text('utf-8')


def groups(title):
    """Return the names of each row of the table whose header begins with a title."""
    _, _, table = TEXT.partition(f'| {title} | why they stay |\n|---|---|\n')
    rows = []
    for line in table.splitlines():
        if not line.startswith('|'):
            break
        _, names, reason, _ = line.split('|')
        assert len(reason.split()) > 2, line
        rows.append(re.findall('`([^`]+)`', names))
    return rows


def assert_each_is_in_one_group(rows, names):
    counts = Counter(name for row in rows for name in row)
    assert not [name for name, count in counts.items() if count > 1]
    assert set(counts) == set(names)


def test_every_name_of_the_library_has_a_reason():
    assert_each_is_in_one_group(groups('names of `kane_dynamics`'),
                                kane_dynamics.__all__)


def test_every_attribute_of_a_robot_has_a_reason():
    b = ModelBuilder()
    b.body('link', 'world', joint='joint', axis=(0, 1, 0),
           inertial=rod(1, (0, 0, 0), (1, 0, 0)))
    attributes = [name for name in dir(Robot(b.model())) if not name.startswith('_')]
    assert_each_is_in_one_group(groups('attributes of `Robot`'), attributes)


def test_every_parameter_of_the_node_has_a_reason():
    # A group of parameters is named by its prefix: `guard.*`.
    names = {re.sub(r'\..*', '.*', spec.name) for spec in SPECS}
    assert_each_is_in_one_group(groups('parameters of `kane_dynamics`'), names)
