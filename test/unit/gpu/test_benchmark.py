"""The benchmark of GPUs measures nothing without one, and checks the results of one."""

from functools import partial

from benchmarks import gpu as benchmark
from framework_states import fr3
from host_gpu import host_gpu, on_gpu
from kane_dynamics import DeviceError, gpu
import numpy as np
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
        assert printed.startswith('20 states of the FR3 on Processor')
        assert '| 1.000 |' in printed
        monkeypatch.setattr(benchmark, 'GATE', 1e9)
        monkeypatch.setattr(benchmark, 'QUANTITIES', ('inverse_dynamics',))
        assert benchmark.main() == 1
        assert 'FAILED: inverse dynamics' in capsys.readouterr().out
        monkeypatch.setattr(benchmark, 'TOLERANCE', {'float64': -1.0})
        with pytest.raises(ValueError,
                           match=r'inverse_dynamics: error .* of the largest entry'):
            benchmark.main()
        monkeypatch.setattr(benchmark, 'QUANTITIES', ())
        with pytest.raises(ValueError, match=r'rollout: error .* of the largest entry'):
            benchmark.main()


def test_events_enclose_launches_alone(monkeypatch):
    """The work of Python in a call takes longer than a kernel."""
    with host_gpu() as device:
        done = []
        for name in ('call', 'launch', 'device_of'):
            def noted(name, made, *given):
                done.append(given[0] if name == 'call' else name)
                return made(*given)
            monkeypatch.setattr(device, name,
                                partial(noted, name, getattr(device, name)))
        function = gpu.function(fr3(), 'inverse_dynamics')
        *given, out = on_gpu(*np.zeros((4, 5, 7)))
        kernel, call = benchmark.device_times(
            device, lambda: function(*given, out=out, stream=0), 4)
    assert kernel == pytest.approx(1e-3 / 4) and call > 0.0
    begin = done.index('cuEventRecord')
    assert done[begin:begin + 6] == ['cuEventRecord', *['launch'] * 4, 'cuEventRecord']
