"""Feasibility of motions: torques, largest speed and payload, time-optimal timing."""

from kane_dynamics.feasibility.payload_bound import largest_payload, PayloadBound
from kane_dynamics.feasibility.time_optimal import time_optimal
from kane_dynamics.feasibility.time_scale import fastest, TimeScale
from kane_dynamics.feasibility.timing_result import ActiveLimit, TimeOptimal
from kane_dynamics.feasibility.torque_demand import Demand, demand, Excess

__all__ = ['ActiveLimit', 'Demand', 'Excess', 'PayloadBound', 'TimeOptimal', 'TimeScale',
           'demand', 'fastest', 'largest_payload', 'time_optimal']
