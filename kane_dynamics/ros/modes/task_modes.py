"""The laws of the modes of impedance, hand guiding and elastic joints."""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from kane_dynamics.control.controller import Controller, OWN_MODES
from kane_dynamics.control.terms import Mode
from kane_dynamics.errors import InputError, KaneError
from kane_dynamics.model.model import Model
from kane_dynamics.native.runtime.threads import run_concurrently
from kane_dynamics.robot.robot import Robot
from kane_dynamics.ros.modes.cartesian_mode import CartesianMode
from kane_dynamics.ros.modes.hand_guiding_mode import HandGuidingMode
from kane_dynamics.ros.modes.joint_impedance_mode import JointImpedanceMode
from kane_dynamics.ros.modes.live_law import LiveLaw, NativeLaw
from kane_dynamics.ros.modes.motor_side_mode import MotorSideMode

LAWS: dict[Mode, Callable[[Robot, Mapping[str, Any]], LiveLaw]] = {
    Mode.JOINT_IMPEDANCE: JointImpedanceMode,
    Mode.CARTESIAN_IMPEDANCE: CartesianMode,
    Mode.HAND_GUIDING: HandGuidingMode}
# The groups of live parameters that each law reads
GROUPS = {Mode.JOINT_IMPEDANCE: {'joint_impedance'},
          Mode.CARTESIAN_IMPEDANCE: {'cartesian', 'walls', 'target', 'limits'},
          Mode.HAND_GUIDING: {'hand_guiding', 'walls', 'observer', 'limits'},
          Mode.MOTOR_SIDE: {'drives'}}
# Modes whose law also runs on the native torque path.
NATIVE_MODES = (Mode.JOINT_IMPEDANCE, Mode.CARTESIAN_IMPEDANCE, Mode.HAND_GUIDING)


def native_laws(controller: Controller) -> dict[Mode, NativeLaw]:
    """Return the laws of a controller that also run on the native torque path."""
    laws = controller.laws.items()
    return {mode: law for mode, law in laws if isinstance(law, NativeLaw)}


class TaskModes:
    """
    The laws of the modes that an arm is configured for.

    They are those of parameters `mode` and `modes`.

    Parameters
    ----------
    robot : Robot
        The robot of the torque path.
    values : mapping
        The node's parameters.
    model : Model, optional
        The arm with its drives, for mode motor_side.

    Attributes
    ----------
    laws : dict of Mode to LiveLaw

    Raises
    ------
    KaneError
        A mode does not fit the arm, or a parameter does not.

    """

    def __init__(self, robot: Robot, values: Mapping[str, Any],
                 model: Model | None = None) -> None:
        self.laws: dict[Mode, LiveLaw] = {}
        laws = LAWS | {Mode.MOTOR_SIDE: partial(MotorSideMode, model=model)}
        for mode, law in laws.items():
            # Only the mode in use and those that may be used later are compiled.
            if mode in (values['mode'], *values['modes']):
                try:
                    self.laws[mode] = law(robot, values)
                except KaneError as error:
                    raise type(error)(f'mode {mode}: {error}') from None

    def check_mode(self, values: Mapping[str, Any]) -> None:
        """Raise InputError unless the law of the mode is compiled."""
        mode = values['mode']
        if mode not in OWN_MODES and mode not in self.laws:
            available = ', '.join((*OWN_MODES, *self.laws))
            raise InputError(f"parameter 'mode': '{mode}'; expected one of {available}, "
                             "or to configure the node with it in parameter 'modes', "
                             'which compiles its law')

    def compile(self) -> None:  # noqa: A003
        """Compile the torques of all laws."""
        run_concurrently([law.compile for law in self.laws.values()])

    def compile_descriptions(self) -> None:
        """Compile what describes the states of all laws."""
        run_concurrently([law.compile_description for law in self.laws.values()])
