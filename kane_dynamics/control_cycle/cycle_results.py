"""The results of a control cycle, and its times: nanoseconds since the start of the path."""

NANO = 1e9  # ns in a second
NEVER = -2.0**62  # ns: before every stamp
# From NOT_FINITE on, the arm is heard, and the state is refused; up to OFF_BRANCH the state
# is false, from NO_TORQUE on the arm or the motion is the reason. Of several faults of a
# state the first one counts.
(ACCEPTED, FIRST, WAITING, NO_CLOCK, STALE, FUTURE, OUT_OF_ORDER, UNEXPLAINED, NOT_FINITE,
 OUTSIDE, TOO_FAST, JUMP, CONTRADICTORY, OFF_BRANCH, NO_TORQUE, NEAR_SINGULAR, NO_MODE,
 REFUSED) = range(18)
