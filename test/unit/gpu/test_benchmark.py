"""The benchmark of GPUs measures nothing without one, and checks the results of one."""

from benchmarks import gpu as benchmark
from host_gpu import host_gpu
from kane_dynamics import DeviceError
import pytest


@pytest.fixture(name='small', autouse=True)
def _small(monkeypatch):
    for name, value in (('STATES', 20), ('HORIZON', 3), ('LAUNCHES', 1), ('ROUNDS', 1)):
        monkeypatch.setattr(benchmark, name, value)
    monkeypatch.setattr('sys.argv', ['gpu.py'])


def test_without_a_device_it_says_that_it_was_not_run(monkeypatch, capsys):
    def none():
        raise DeviceError('driver: none; expected one')
    monkeypatch.setattr(benchmark, 'driver', none)
    assert benchmark.main() == 0
    assert capsys.readouterr().out == 'NOT RUN: driver: none; expected one\n'


def test_it_compares_before_it_measures_and_names_the_device(monkeypatch, capsys):
    monkeypatch.setattr(benchmark, 'GATE', 0.0)
    with host_gpu() as device:
        monkeypatch.setattr(benchmark, 'driver', lambda: device)
        assert benchmark.main() == 0
        printed = capsys.readouterr().out
        assert printed.startswith('20 states of the FR3 on Processor') and '| 1.000 |' in printed
        monkeypatch.setattr(benchmark, 'GATE', 1e9)
        monkeypatch.setattr(benchmark, 'QUANTITIES', ('inverse_dynamics',))
        assert benchmark.main() == 1
        assert 'FAILED: inverse dynamics' in capsys.readouterr().out
        monkeypatch.setattr(benchmark, 'TOLERANCE', {'float64': -1.0})
        with pytest.raises(ValueError, match=r'inverse_dynamics: error .* of the largest entry'):
            benchmark.main()
