"""
Every public call with degenerate, extreme and invalid arguments, found by introspection.

Each of them gives numbers, or an error that says what is expected: nothing crashes,
waits or warns of NumPy. Equal numbers in other forms (lists, float64 scalars, arrays
that are read-only, in Fortran order or not contiguous) give the same result.
"""

from collections import Counter
import time

from degenerate_input import (attempted, differs, fault, other, same, SLOW, UNCHECKED,
                              valid_calls)
from kane_dynamics.errors import KaneError
import numpy as np
import pytest

# In the quick run: one of the extreme values for each argument, another one in each run.
STRIDE = 6


def quick_calls():
    """Return the valid calls that take no seconds."""
    return [call for call in valid_calls()[0] if call.name not in SLOW]


def cases(calls, chosen):
    """Yield calls with an argument's name, what replaces it, and the value."""
    number = 0
    for call in calls:
        for parameter in call.signature:
            if parameter.name not in call.arguments:
                continue
            for name, value in other(call.arguments[parameter.name]).items():
                if value is None and parameter.default is None:
                    continue
                number += 1
                if chosen(number):
                    yield call, parameter.name, name, value


def faults_of(calls, chosen, capsys):
    """Return what is wrong with calls, and print the number of cases and the time."""
    begin = time.process_time()
    count = Counter()
    faults = []
    for call, argument, name, value in cases(calls, chosen):
        count[call.name] += 1
        words = fault(call, **{argument: value})
        if words:
            faults.append(f'{call.name}, {argument}: {name}: {words}')
    with capsys.disabled():
        print(f'\ndegenerate input: {count.total()} cases of {len(count)} calls in '
              f'{time.process_time() - begin:.1f} s of processor time', flush=True)
    return faults


def test_there_are_valid_arguments_for_every_public_call():
    _, unknown = valid_calls()
    assert not unknown, 'give the helper degenerate_input valid values of these'
    refused = []
    for call in quick_calls():
        if isinstance(result := attempted(call), KaneError):
            refused.append(f'{call.name}: {result}')
    assert not refused


def test_one_in_six_degenerate_arguments_gives_numbers_or_is_refused_by_its_cause(
        capsys):
    offset = int(np.random.default_rng().integers(STRIDE))
    assert not faults_of(quick_calls(), lambda k: k % STRIDE == offset, capsys)


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_every_degenerate_argument_gives_numbers_or_is_refused_by_its_cause(capsys):
    assert not faults_of(valid_calls()[0], lambda k: True, capsys)


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_equal_numbers_in_other_forms_give_the_same_result():
    wrong = []
    for call in quick_calls():
        if call.name in UNCHECKED:  # as they are given
            continue
        expected = attempted(call)
        for argument, value in call.arguments.items():
            for form, changed in same(value).items():
                result = attempted(call, **{argument: changed})
                again = attempted(call)  # of a call that changes with every call
                if differs(result, expected) and not differs(again, expected):
                    wrong.append(f'{call.name}, {argument}: {form}')
    assert not wrong
