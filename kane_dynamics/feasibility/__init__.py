"""Whether a motion fits the motors: what it asks, how fast it may be, how much it may carry."""

from kane_dynamics.feasibility.payload_bound import largest_payload, PayloadBound
from kane_dynamics.feasibility.time_scale import fastest, TimeScale
from kane_dynamics.feasibility.torque_demand import demand, Demand, Excess

__all__ = ['Demand', 'Excess', 'PayloadBound', 'TimeScale', 'demand', 'fastest',
           'largest_payload']
