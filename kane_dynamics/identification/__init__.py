"""What a robot is really made of, from recordings of its motion: extra `identify`."""

from kane_dynamics.identification.base import (base_parameters, base_speeds, BaseFit,
                                               BaseParameters, fit_base)
from kane_dynamics.identification.diagnosis import diagnose, Finding
from kane_dynamics.identification.equations import friction_speeds, rows
from kane_dynamics.identification.excitation import Excitation, excite
from kane_dynamics.identification.fit import Identification, identify
from kane_dynamics.identification.payload import identify_payload, Payload
from kane_dynamics.identification.payload_estimator import PayloadEstimator
from kane_dynamics.identification.reading import read_recording
from kane_dynamics.identification.recording import Recording

__all__ = ['BaseFit', 'BaseParameters', 'Excitation', 'Finding', 'Identification', 'Payload',
           'PayloadEstimator', 'Recording', 'base_parameters', 'base_speeds', 'diagnose',
           'excite', 'fit_base', 'friction_speeds', 'identify', 'identify_payload', 'read_recording',
           'rows']
