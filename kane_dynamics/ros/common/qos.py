"""The QoS profiles of the nodes."""

from collections.abc import Collection, Mapping
from copy import copy
from typing import Any, NamedTuple

from kane_dynamics.errors import InputError
from rclpy.duration import Duration
from rclpy.qos import (DurabilityPolicy, HistoryPolicy, LivelinessPolicy, QoSProfile,
                       ReliabilityPolicy)
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
# States that arrive while a report of the monitor is made: two seconds at 1 kHz.
RECORDED_STATES = QoSProfile(depth=2000, reliability=ReliabilityPolicy.BEST_EFFORT)
# Late subscribers receive the latest message.
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
# As tf2 subscribes to /tf and /tf_static: many nodes publish there.
TRANSFORMS = QoSProfile(depth=100)
STATIC_TRANSFORMS = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
# As MoveIt publishes its scene: each message may be a difference to the last.
SCENES = QoSProfile(depth=100)
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
PREFIX = 'qos_overrides.'
POLICIES = {'reliability': ReliabilityPolicy, 'history': HistoryPolicy, 'depth': None}


class Overrides(NamedTuple):
    """Names of parameters qos_overrides: those that change a topic, and the others."""

    used: list[str]
    unused: list[str]


def overridable(profile: QoSProfile) -> QoSProfile:
    """Return a copy of a profile, which rclpy changes in place as qos_overrides ask."""
    return copy(profile)


def overrides_of(parameters: Mapping[str, Any], topics: Collection[str]) -> Overrides:
    """
    Return which of the parameters are qos_overrides, and whether they change a topic.

    Parameters
    ----------
    parameters : mapping
        Values by name.
    topics : collection of str
        As in the names of the parameters: '/joint_states.subscription'.

    Raises
    ------
    InputError
        A value is not one of its policy.

    """
    overrides = Overrides([], [])
    # Other parameters may be there, as ROS has some of its own.
    for name, value in parameters.items():
        if not name.startswith(PREFIX):
            continue
        topic, _, policy = name.removeprefix(PREFIX).rpartition('.')
        if topic in topics and policy in POLICIES:
            _check_policy(name, policy, value)
            overrides.used.append(name)
        else:
            overrides.unused.append(name)
    return overrides


def _check_policy(name: str, policy: str, value: Any) -> None:
    """Raise InputError unless a value is one of a policy."""
    # Depths are numbers, all other policies words.
    kind = POLICIES[policy]
    if kind is None:
        valid = type(value) is int and value > 0
        expected = 'an integer, at least 1'
    else:
        keys = [key for key in kind.short_keys() if key != 'unknown']
        valid = isinstance(value, str) and value.lower() in keys
        expected = 'one of ' + ', '.join(keys)
    if not valid:
        raise InputError(f"parameter '{name}': {value!r}; expected {expected}")


def watched(lease: float, *, watching: bool = False) -> QoSProfile:
    """
    Return the profile of a topic whose publisher is watched.

    It is that of the publisher, or of the subscription that watches it.

    The subscription is best effort, so that the publisher handles no acknowledgements.

    Liveliness is asserted by each message, so that a process that hangs loses it too.

    Parameters
    ----------
    lease : float
        Offered or requested lease of liveliness, s.
    watching : bool
        Whether the profile is that of the subscription.

    """
    return QoSProfile(depth=BEST_EFFORT.depth if watching else 1,
                      reliability=(ReliabilityPolicy.BEST_EFFORT if watching
                                   else ReliabilityPolicy.RELIABLE),
                      liveliness=LivelinessPolicy.MANUAL_BY_TOPIC,
                      liveliness_lease_duration=Duration(seconds=lease))
