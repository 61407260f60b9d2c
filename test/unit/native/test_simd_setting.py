"""`KANE_DYNAMICS_SIMD`: the widest SIMD extension of x86 that compiled code uses."""

import os
import re
import subprocess
import sys

from kane_dynamics import InputError
from kane_dynamics.native.machine_code import llvm
import numpy as np
import pytest

HOST = dict(llvm.llvm.get_host_cpu_features())
SETTINGS = [name for name, feature in llvm.SIMD.items() if HOST.get(feature)]
WIDTHS = {'avx512': 8, 'avx2': 4, 'sse2': 2}
# No instruction may use it.
REGISTERS = {'avx512': '', 'avx2': 'zmm', 'sse2': '[yz]mm'}
ROBOT = """
import numpy as np
from kane_dynamics import load_urdf, Robot
from kane_dynamics._util.resources import resource_path
from kane_dynamics.native.backends.llvm_simd import width
from kane_dynamics.native.machine_code import llvm
robot = Robot(load_urdf(resource_path('urdf', 'ur10e.urdf')))
states = np.random.default_rng(0).normal(size=(3, 19, robot.n))
print(width(), *robot.inverse_dynamics(*states).ravel().tolist())
print(llvm.fingerprint())
"""


def run_with(setting):
    """Return lanes, torques and the fingerprint of the code of a new process."""
    environment = {**os.environ, llvm.SIMD_VARIABLE: setting}
    command = [sys.executable, '-W', 'ignore', '-c', ROBOT]
    lines = subprocess.run(command, env=environment, text=True, check=True,
                           capture_output=True).stdout.splitlines()
    lanes, *torques = lines[0].split()
    return int(lanes), np.array(torques, dtype=float), lines[1]


@pytest.mark.parametrize('setting', SETTINGS)
def test_no_instruction_is_wider_than_the_setting(setting, monkeypatch):
    monkeypatch.setenv(llvm.SIMD_VARIABLE, setting)
    monkeypatch.setattr(llvm, 'features', llvm.features.__wrapped__)
    monkeypatch.setattr(llvm, '_processor', llvm._processor.__wrapped__)
    machine = llvm._target_machine(1)
    text = ('define void @add(ptr %p) {\n %x = load <8 x double>, ptr %p\n'
            ' %y = fadd <8 x double> %x, %x\n store <8 x double> %y, ptr %p\n ret '
            'void\n}\n')
    assembly = machine.emit_assembly(llvm._parsed(text, machine))
    assert 'add' in assembly
    wider = REGISTERS[setting]
    assert not (wider and re.search(f'%{wider}', assembly))


@pytest.mark.slow
def test_torques_agree_for_every_setting_and_code_is_not_shared():
    results = [run_with(setting) for setting in SETTINGS]
    for setting, (lanes, torques, _) in zip(SETTINGS, results):
        assert lanes == WIDTHS[setting]
        np.testing.assert_allclose(torques, results[0][1], rtol=1e-12, atol=1e-13)
    assert len({fingerprint for _, _, fingerprint in results}) == len(SETTINGS)


@pytest.mark.parametrize('setting', ['', 'avx', 'AVX2', 'avx512f'])
def test_an_unknown_extension_is_refused_with_those_of_this_processor(
        setting, monkeypatch):
    monkeypatch.setenv(llvm.SIMD_VARIABLE, setting)
    with pytest.raises(InputError, match=f'KANE_DYNAMICS_SIMD: {setting!r}; expected '):
        llvm.features.__wrapped__()
