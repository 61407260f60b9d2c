"""Every feature for every kind of mechanism and each pair, or a refusal in words."""

from feature_matrix import PAGE, page, ROOT, ROWS
from kane_dynamics.errors import KaneError
from kinds_of_mechanism import case, ELASTIC, KINDS, PAIRS
import pytest


# Compiling the pairs takes a minute.
@pytest.mark.parametrize('kinds', [*((kind,) for kind in KINDS),
                                   pytest.param((ELASTIC,), marks=pytest.mark.slow), *(
    pytest.param(pair, marks=pytest.mark.slow) for pair in PAIRS)], ids=' and '.join)
def test_every_feature_is_right_or_refused_for(kinds):
    wrong = []
    for row in ROWS:
        reason = row.reason(*kinds)
        allowed = reason is None
        if (allowed and kinds[0] in row.tests) or row.check is None or (
                len(kinds) > 1 and not row.pairs):
            continue
        try:
            row.check(case(*kinds))
        except Exception as error:
            if allowed or not isinstance(error, KaneError | TypeError):
                wrong.append(f'{row.name}: {type(error).__name__} {error}')
        else:
            if not allowed:
                wrong.append(
                    f'{row.name}: right; expected no reason in feature_matrix.py')
    assert not wrong, '\n'.join(wrong)


def test_the_page_on_limits_has_the_table():
    text = PAGE.read_text(encoding='utf-8')
    assert text == page(text), 'run python test/helpers/feature_matrix.py'


def test_tests_that_the_table_names_exist():
    for row in ROWS:
        for test in row.tests.values():
            file, _, name = test.partition('::')
            assert f'def {name}(' in (ROOT / file).read_text(encoding='utf-8'), test
