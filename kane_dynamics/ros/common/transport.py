"""
The transports of Fast DDS.

They are UDP alone where the death of a process must not block others.

A process that dies or stops while it holds the lock of a port in shared memory blocks
all that send to that port, for about 1 s or until it continues.
"""

import os

from kane_dynamics._util.resources import resource_path
import rclpy

TRANSPORTS = 'FASTDDS_BUILTIN_TRANSPORTS'
# Until 2.x, later
PROFILES = ('FASTRTPS_DEFAULT_PROFILES_FILE', 'FASTDDS_DEFAULT_PROFILES_FILE')
RANGE = 'ROS_AUTOMATIC_DISCOVERY_RANGE'
# What the profile for localhost does not know.
OTHERS = ('ROS_STATIC_PEERS', 'ROS_DISCOVERY_SERVER')


def without_shared_memory() -> dict[str, str]:
    """
    Return the environment of a process that uses UDP alone.

    It is empty if the user has set transports.

    With the discovery range LOCALHOST, rmw_fastrtps adds shared memory whatever the
    environment says; a profile of the same range replaces it.
    """
    if any(os.environ.get(name) for name in (TRANSPORTS, *PROFILES)) or (
            not rclpy.get_rmw_implementation_identifier().startswith('rmw_fastrtps')):
        return {}
    if os.environ.get('ROS_LOCALHOST_ONLY') == '1':  # deprecated; wins over the range
        return {}
    if os.environ.get(RANGE) != 'LOCALHOST':
        return {TRANSPORTS: 'UDPv4'}
    if any(os.environ.get(name) for name in OTHERS):
        return {}
    profile = str(resource_path('config', 'localhost_udp.xml'))
    return {RANGE: 'SYSTEM_DEFAULT'} | dict.fromkeys(PROFILES, profile)


def leave_shared_memory() -> None:
    """Restrict this process to UDP; call it before `rclpy.init`."""
    os.environ |= without_shared_memory()
