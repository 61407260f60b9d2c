"""Feasibility of motions: torque demand, largest speed and largest payload within limits."""

from kane_dynamics.feasibility.payload_bound import largest_payload, PayloadBound
from kane_dynamics.feasibility.time_scale import fastest, TimeScale
from kane_dynamics.feasibility.torque_demand import Demand, demand, Excess

__all__ = ['Demand', 'Excess', 'PayloadBound', 'TimeScale', 'demand', 'fastest',
           'largest_payload']
