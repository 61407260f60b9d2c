"""Operation counts and code sizes of the kernels of shipped robots match the records."""

from benchmarks import kernel_sizes
import pytest

RECORDED = kernel_sizes.recorded()
COMMAND = 'if that is meant, run `make kernel-sizes` and commit kernel_sizes.json'


def changes(recorded, measured, columns):
    """Return the differences as text; a smaller kernel must be recorded too."""
    differences = [f'{name}: only {where}'
                   for name in sorted(recorded.keys() ^ measured.keys())
                   for where in ['recorded' if name in recorded else 'measured']]
    for name in recorded.keys() & measured.keys():
        differences += [
            f'{name}: {column} {"grew" if new > old else "shrank"} from {old} to {new}'
            for column, old, new in zip(columns, recorded[name], measured[name])
            if new != old]
    return sorted(differences)


@pytest.mark.parametrize('robot', [
    pytest.param(name, marks=pytest.mark.slow) if name == 'human_hand' else name
    for name in kernel_sizes.robots()])
def test_no_kernel_grows(robot):
    columns = list(kernel_sizes.COLUMNS)
    if RECORDED['llvm'] != kernel_sizes.llvm_version():
        columns.remove('bytes')  # another LLVM makes other code of the same arithmetic
    differences = changes(RECORDED['sizes'].get(robot, {}),
                          kernel_sizes.measured(kernel_sizes.robots()[robot]), columns)
    assert not differences, f'{robot}: {"; ".join(differences)}; {COMMAND}'


def test_every_shipped_robot_is_recorded_and_no_other():
    assert RECORDED['sizes'].keys() == kernel_sizes.robots().keys(), COMMAND
    assert RECORDED['columns'] == list(kernel_sizes.COLUMNS)
    assert RECORDED['cpu'] == kernel_sizes.llvm.REFERENCE_CPU


def test_increase_by_one_operation_or_byte_is_detected():
    columns = kernel_sizes.COLUMNS
    recorded = {'mass_matrix': [10, 9, 0, 2, 400]}
    assert changes(recorded, recorded, columns) == []
    for k, column in enumerate(columns):
        measured = {
            'mass_matrix': [x + (i == k) for i, x in enumerate(recorded['mass_matrix'])]}
        assert len(changes(recorded, measured, columns)) == 1
        assert f'mass_matrix: {column} grew from' in changes(
            recorded, measured, columns)[0]
        assert f'{column} shrank' in changes(measured, recorded, columns)[0]
    assert changes(recorded, {}, columns) == ['mass_matrix: only recorded']
