"""Why joint states are dropped; the diagnostics count each reason."""

from kane_dynamics.control_cycle import cycle_results
from kane_dynamics.loop_tracking.loop_error import (BRANCH, CONTRADICTION, SINGULAR,
                                                    UNKNOWN)
from kane_dynamics.ros.common.stamped_numbers import FUTURE, NOT_FINITE, OUT_OF_ORDER

# For example of a gripper: not a fault, counted separately
FOREIGN = 'other joints only'
MISSING, TWICE, SHORT, NO_VELOCITY = (
    'joint missing', 'joint named twice', 'arrays of unequal length', 'no velocity')
ELSEWHERE = 'locked joint elsewhere'
STALE, NO_CLOCK = 'stale (older than state_timeout)', 'no message on /clock'
OUTSIDE, TOO_FAST, JUMP = (
    'position beyond its limits', 'velocity beyond its limit', 'position jumped')
NO_TORQUE, REFUSED = 'no finite torque', 'closed loop without a torque'
UNEXPLAINED = 'position unexplained after a pause'
LEARNED = 'layout learned after newer states'
# States with them are not dropped.
FALSE_SPEEDS = ('velocities contradict the positions; speeds from the positions are used; '
                'expected rad/s or m/s, of the sign of the positions')

REASONS = {
    cycle_results.NO_CLOCK: NO_CLOCK, cycle_results.STALE: STALE,
    cycle_results.FUTURE: FUTURE, cycle_results.OUT_OF_ORDER: OUT_OF_ORDER,
    cycle_results.UNEXPLAINED: UNEXPLAINED,
    cycle_results.NOT_FINITE: NOT_FINITE, cycle_results.OUTSIDE: OUTSIDE,
    cycle_results.TOO_FAST: TOO_FAST, cycle_results.JUMP: JUMP,
    cycle_results.CONTRADICTORY: CONTRADICTION, cycle_results.OFF_BRANCH: BRANCH,
    cycle_results.NO_TORQUE: NO_TORQUE, cycle_results.NEAR_SINGULAR: SINGULAR,
    cycle_results.NO_MODE: UNKNOWN, cycle_results.REFUSED: REFUSED}
