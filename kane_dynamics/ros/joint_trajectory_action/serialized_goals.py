"""
Receive the goals of an action as bytes.

rclpy converts a goal without releasing the interpreter, about 7 us for each point, which
delays the torque path. The classes here stand for the types of the action where rclpy
takes a goal: they convert it to bytes, which are read point by point.
"""

from collections.abc import Callable
import ctypes
from dataclasses import dataclass
from typing import Any

from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.type_support import check_for_type_support

UUID_AT, UUID_SIZE = 4, 16  # bytes: the goal's identifier follows the encapsulation

# Functions of a message type, as rclpy calls them: with the interpreter's lock.
_CREATE = ctypes.PYFUNCTYPE(ctypes.c_void_p)
_DESTROY = ctypes.PYFUNCTYPE(None, ctypes.c_void_p)
_FROM_PYTHON = ctypes.PYFUNCTYPE(ctypes.c_bool, ctypes.c_void_p, ctypes.c_void_p)
_TO_PYTHON = ctypes.PYFUNCTYPE(ctypes.py_object, ctypes.c_void_p)
_new_capsule = ctypes.pythonapi.PyCapsule_New
_new_capsule.restype = ctypes.py_object
_new_capsule.argtypes = (ctypes.c_void_p, ctypes.c_char_p, ctypes.c_void_p)


@dataclass(frozen=True, eq=False)
class SerializedGoal:
    """A request to send a goal: its identifier, and the whole request as bytes."""

    goal_id: Any
    goal: bytes


def with_serialized_goals(action_type: Any) -> Any:
    """
    Return an action type whose goals are taken as bytes.

    Its server passes the serialized request, with the identifier of the goal before the
    goal, wherever rclpy passes a goal.
    """
    check_for_type_support(action_type)
    request_type = action_type.Impl.SendGoalService.Request
    request_class = _class_of_bytes(request_type)

    class SendGoalService(action_type.Impl.SendGoalService):
        Request = request_class

    class Impl(action_type.Impl):
        pass

    class Action(action_type):
        pass

    Impl.SendGoalService = SendGoalService
    Action.Impl = Impl
    return Action


def _class_of_bytes(request_type: Any) -> Any:
    """Return a class that rclpy takes for a message type, and converts to bytes."""
    support = type(request_type)  # the metaclass of a message has its functions
    uuid_type = type(request_type().goal_id)
    taken: list[int] = []  # address of the message that is converted

    def to_bytes(address: int) -> SerializedGoal:
        taken.append(address)
        try:
            data = rclpy_implementation.rclpy_serialize(message_itself, request_type)
        finally:
            taken.pop()
        identifier = data[UUID_AT:UUID_AT + UUID_SIZE]
        return SerializedGoal(uuid_type(uuid=list(identifier)), data)

    # rclpy serializes a Python object after it has created a message and filled it in.
    # The "created" message is the taken one, which is full and which rclpy destroys.
    class MessageItself:
        _CREATE_ROS_MESSAGE, _create = _capsule(_CREATE, lambda: taken[-1])
        _CONVERT_FROM_PY, _fill = _capsule(_FROM_PYTHON, lambda source, message: True)
        _DESTROY_ROS_MESSAGE, _destroy = _capsule(_DESTROY, lambda message: None)

    message_itself = MessageItself()
    to_python, kept = _capsule(_TO_PYTHON, to_bytes)
    functions = {'_CREATE_ROS_MESSAGE': support._CREATE_ROS_MESSAGE,
                 '_DESTROY_ROS_MESSAGE': support._DESTROY_ROS_MESSAGE,
                 '_CONVERT_TO_PY': to_python, '_kept': kept}
    metaclass = type('SerializedRequestType', (type,), functions)
    return metaclass('SerializedRequest', (), {})


def _capsule(kind: Any, function: Callable[..., Any]) -> tuple[Any, Any]:
    """Return the capsule of a function, and what must live as long as the capsule."""
    entry = kind(function)
    return _new_capsule(ctypes.cast(entry, ctypes.c_void_p), None, None), entry
