"""Promises of the library's identification: warnings, one thread of a BLAS."""

from dataclasses import replace
from pathlib import Path

from kane_dynamics import load_urdf, ModelWarning
from kane_dynamics.identification import base_regressor, identify, identify_payload
from kane_dynamics.identification.payload import payload_fit
import numpy as np
import pytest
from recordings import simulated
from threadpoolctl import threadpool_info

URDF = Path(__file__).resolve().parents[3] / 'urdf' / 'two_link.urdf'


def test_recording_that_the_command_refuses_is_warned_of():
    model = load_urdf(URDF)
    good = simulated(model, 3, 0.01, duration=6.0)
    identify(model, good, friction_only=True)
    wrong = replace(good, tau=-good.tau)
    with pytest.warns(ModelWarning, match='opposite sign'):
        identify(model, wrong, friction_only=True)
    identify(model, wrong, friction_only=True, diagnosed=True)


def test_payloads_and_models_are_identified_on_one_thread(monkeypatch):
    model = load_urdf(URDF)
    threads = []

    def watched(module, name):
        function = getattr(module, name)

        def wrapped(*arguments, **options):
            threads.extend(pool['num_threads'] for pool in threadpool_info()
                           if pool['user_api'] == 'blas')
            return function(*arguments, **options)
        monkeypatch.setattr(module, name, wrapped)
    watched(payload_fit, 'physical')
    watched(base_regressor, 'full_regressor')
    recording = simulated(model, 3, 0.01, duration=6.0)
    identify_payload(model, recording, 'tip')
    identify(model, recording, friction='coulomb', weight=10.0, diagnosed=True)
    assert len(threads) >= 3 and np.max(threads) == 1
