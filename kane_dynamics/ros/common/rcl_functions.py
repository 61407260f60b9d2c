"""
The functions and handles of rcl that the native torque path calls by their addresses.

rclpy has loaded the library and states the address of each of its objects. The size of a
structure of rcl cannot be asked for, so each is used once before it is relied on:
`RclLoop` raises `UnsupportedError` where a symbol is missing or a structure does not
look as expected.
"""

from collections.abc import Sequence
import ctypes
from pathlib import Path
from typing import Any

from kane_dynamics.errors import KaneError
import numpy as np
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy

CAPACITY = 2**16  # bytes reserved for a received message, so that none is allocated later
NAMES = ('rcl_wait_set_clear', 'rcl_wait_set_add_subscription',
         'rcl_wait_set_add_guard_condition', 'rcl_wait', 'rcl_take_serialized_message',
         'rcl_publish_serialized_message', 'rcl_trigger_guard_condition',
         'rcl_wait_set_init', 'rcl_wait_set_fini', 'rcl_clock_get_now')
UTILITIES = ('rcutils_get_default_allocator', 'rcutils_uint8_array_init',
             'rcutils_uint8_array_fini')
POINTER, SIZE = ctypes.c_void_p, ctypes.c_size_t


class UnsupportedError(KaneError):
    """The installation of ROS does not support the native torque path."""


class Allocator(ctypes.Structure):
    """The structure rcutils_allocator_t."""

    _fields_ = [(name, POINTER) for name in ('allocate', 'deallocate', 'reallocate',
                                             'zero_allocate', 'state')]


class SerializedMessage(ctypes.Structure):
    """The structure rcutils_uint8_array_t, of which serialized messages are."""

    _fields_ = [('buffer', POINTER), ('length', SIZE), ('capacity', SIZE),
                ('allocator', Allocator)]


class WaitSet(ctypes.Structure):
    """The structure rcl_wait_set_t, with room for more than its fields."""

    _fields_ = [('words', SIZE * 32)]  # more than it has


def _library(name: str) -> ctypes.CDLL:
    """Return a library that is loaded already; UnsupportedError if it is not."""
    for line in Path('/proc/self/maps').read_text().splitlines():
        path = line.split(maxsplit=5)[-1]
        if Path(path).name.startswith(f'{name}.so'):
            return ctypes.CDLL(path)
    raise UnsupportedError(f'{name}: not loaded; expected it with rclpy')


def _functions(library: ctypes.CDLL, names: tuple[str, ...]) -> dict[str, Any]:
    """Return functions by their names; UnsupportedError if one does not exist."""
    functions = {}
    for name in names:
        if not hasattr(library, name):
            raise UnsupportedError(f'{name}: no symbol of rcl; expected one')
        functions[name] = getattr(library, name)
    return functions


def handle_address(entity: Any) -> int:
    """Return the address of the rcl object of a publisher, subscription or context."""
    pointer = getattr(getattr(entity, 'handle', entity), 'pointer', None)
    if not pointer:
        raise UnsupportedError(f'{type(entity).__name__}: no handle with an address; '
                               'expected one of rclpy')
    return int(pointer)


def subscription_of_thread(node: Any, kind: Any, topic: str, qos: Any) -> Any:
    """
    Return a subscription that no executor reads; `destroy_subscription_of_thread` ends it.

    Its events, such as an incompatible profile, are reported as usual.
    """
    subscription = node.create_subscription(kind, topic, _no_callback, qos, raw=True)
    # The executor of the calling thread looks at the list when the callback returns.
    try:
        node._subscriptions.remove(subscription)
    except (AttributeError, ValueError):
        node.destroy_subscription(subscription)
        raise UnsupportedError('rclpy: no list of subscriptions of a node; expected '
                               'one') from None
    return subscription


def destroy_subscription_of_thread(node: Any, subscription: Any) -> None:
    """Destroy a subscription that no executor reads, and its events, which one reads."""
    node._subscriptions.append(subscription)
    node.destroy_subscription(subscription)


def guard_condition(context: Any) -> Any:
    """Return a guard condition that no executor waits for."""
    try:
        with context.handle:
            return _rclpy.GuardCondition(context.handle)
    except (AttributeError, TypeError) as error:
        raise UnsupportedError(f'rclpy: {error}; expected guard conditions') from None


def _no_callback(data: bytes) -> None:
    """Do nothing, for a subscription that a thread reads."""


def message_of(buffer: np.ndarray) -> SerializedMessage:
    """Return the structure of a message whose bytes are an array."""
    return SerializedMessage(buffer.ctypes.data, buffer.size, buffer.size)


class RclLoop:
    """
    A wait set of subscriptions and one guard condition, and the functions to use it.

    Parameters
    ----------
    context, clock : rclpy Context, Clock
    subscriptions : sequence of rclpy Subscription
    guard : rclpy GuardCondition

    Attributes
    ----------
    wait_set : WaitSet
    taken : list of SerializedMessage
        Receive the messages of each subscription.
    subscriptions : list of int
        Addresses.
    guard, clock : int
        Addresses.

    Raises
    ------
    UnsupportedError
        A symbol or a handle does not exist, or a structure is another one.

    """

    def __init__(self, context: Any, clock: Any, subscriptions: Sequence[Any],
                 guard: Any) -> None:
        self._functions = _functions(_library('librcl'), NAMES)
        utilities = _functions(_library('librcutils'), UTILITIES)
        self.subscriptions = [handle_address(each) for each in subscriptions]
        self.guard = handle_address(guard)
        self.clock = handle_address(clock)
        self._allocator = self._default_allocator(utilities)
        self.wait_set = self._new_wait_set(handle_address(context))
        self._finish_message = utilities['rcutils_uint8_array_fini']
        # One message for each subscription, whose memory grows once and stays.
        self.taken: list[SerializedMessage] = []
        for _ in subscriptions:
            self.taken.append(self._new_message(utilities['rcutils_uint8_array_init']))
        self._check_wait_set()

    def address(self, name: str) -> int:
        """Return the address of a function."""
        return int(ctypes.cast(self._functions[name], POINTER).value or 0)

    def wake(self) -> None:
        """Wake the thread, so that it looks at the block."""
        self._functions['rcl_trigger_guard_condition'](POINTER(self.guard))

    def close(self) -> None:
        """Free what rcl allocated; the thread must have ended."""
        self._functions['rcl_wait_set_fini'](ctypes.byref(self.wait_set))
        for message in self.taken:
            self._finish_message(ctypes.byref(message))

    def _new_message(self, initialize: Any) -> SerializedMessage:
        """Return a message with memory; the call shows whether the structure is known."""
        message = SerializedMessage()
        code = initialize(ctypes.byref(message), SIZE(CAPACITY),
                          ctypes.byref(self._allocator))
        if code or message.capacity != CAPACITY or not message.buffer:
            raise UnsupportedError('rcutils_uint8_array_t: another structure; expected '
                                   'buffer, length and capacity')
        return message

    @staticmethod
    def _default_allocator(utilities: dict[str, Any]) -> Allocator:
        function = utilities['rcutils_get_default_allocator']
        function.restype = Allocator
        allocator: Allocator = function()
        if not (allocator.allocate and allocator.deallocate and allocator.reallocate):
            raise UnsupportedError('rcutils_allocator_t: another structure; expected '
                                   'five pointers')
        return allocator

    def _new_wait_set(self, context: int) -> WaitSet:
        """Return a wait set; its first call shows whether the structure is known."""
        wait_set = WaitSet()
        initialize = self._functions['rcl_wait_set_init']
        initialize.argtypes = [POINTER, *[SIZE] * 6, POINTER, Allocator]
        count = len(self.subscriptions)
        code = initialize(ctypes.byref(wait_set), count, 1, 0, 0, 0, 0, context,
                          self._allocator)
        # Arrays of subscriptions, guard conditions, timers, clients, services and
        # events, each with its length; then the implementation.
        counts = list(wait_set.words[1:12:2])
        expected = [count, 1, 0, 0, 0, 0]
        if code or counts != expected or not wait_set.words[12] or any(
                wait_set.words[13:]):
            raise UnsupportedError(f'rcl_wait_set_t: code {code}, lengths {counts}; '
                                   f'expected {expected}')
        return wait_set

    def _check_wait_set(self) -> None:
        """Put all handles into the wait set and look for them there."""
        functions = self._functions
        wait_set = ctypes.byref(self.wait_set)
        functions['rcl_wait_set_clear'](wait_set)
        # The layout of rcl's structures is assumed; handles that are found where they
        # belong confirm it.
        code = 0
        for subscription in self.subscriptions:
            code |= functions['rcl_wait_set_add_subscription'](
                wait_set, POINTER(subscription), None)
        code |= functions['rcl_wait_set_add_guard_condition'](
            wait_set, POINTER(self.guard), None)
        subscriptions, _, guards = self.wait_set.words[:3]
        in_set = list((SIZE * len(self.subscriptions)).from_address(subscriptions))
        in_set.append(int(SIZE.from_address(guards).value))
        if code or in_set != [*self.subscriptions, self.guard]:
            raise UnsupportedError(f'rcl_wait_set_t: code {code}; expected a wait set '
                                   'with the handles of rclpy')
