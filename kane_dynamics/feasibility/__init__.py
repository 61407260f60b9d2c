"""Whether a motion fits the motors: what it asks, how fast it may be, how much it may carry."""

from kane_dynamics.feasibility.demand import Demand, demand, Excess
from kane_dynamics.feasibility.payload import largest_payload, PayloadBound
from kane_dynamics.feasibility.time_scale import fastest, TimeScale

__all__ = ['Demand', 'Excess', 'PayloadBound', 'TimeScale', 'demand', 'fastest',
           'largest_payload']
