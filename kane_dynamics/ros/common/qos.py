"""The QoS profiles of the nodes."""

from rclpy.duration import Duration
from rclpy.qos import DurabilityPolicy, LivelinessPolicy, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions

RELIABLE = QoSProfile(depth=1)
# As in the sensor data profile: states that arrive during a stall of a few ms are still
# processed.
BEST_EFFORT = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)
# A thread answers each state in microseconds, so that a longer queue makes none late: 25
# ms of states at 4 kHz.
THREAD_STATES = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)
# As rclpy subscribes to /clock.
CLOCK = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
# Late subscribers receive the latest message.
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
# Wrenches at several frames may arrive at once.
WRENCHES = QoSProfile(depth=10)
# As both sides of a bond publish it; several nodes share the topic.
BOND = QoSProfile(depth=100)
# A burst of requests is queued, so that each is answered.
SERVICES = QoSProfile(depth=1000)
# Everything that arrives while the graph is examined.
EXAMINED_STATES = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)

# Parameters qos_overrides may change history, depth and reliability of a topic.
OVERRIDES = QoSOverridingOptions.with_default_policies()


def watched(lease: float, deadline: float, *, watching: bool = False) -> QoSProfile:
    """
    Return the profile of a topic whose publisher is watched.

    It is that of the publisher, or of the subscription that watches it.

    The subscription is best effort, so that the publisher handles no acknowledgements.

    Liveliness is asserted by each message, so that a process that hangs loses it too.

    Parameters
    ----------
    lease, deadline : float
        Offered or requested lease of liveliness and deadline of messages, s.
    watching : bool
        Whether the profile is that of the subscription.

    """
    return QoSProfile(depth=BEST_EFFORT.depth if watching else 1,
                      reliability=(ReliabilityPolicy.BEST_EFFORT if watching
                                   else ReliabilityPolicy.RELIABLE),
                      liveliness=LivelinessPolicy.MANUAL_BY_TOPIC,
                      liveliness_lease_duration=Duration(seconds=lease),
                      deadline=Duration(seconds=deadline))
