"""Every error and warning that this package raises on purpose."""


class KaneError(Exception):
    """
    Base of all errors of this package: catch this to catch them all.

    Attributes
    ----------
    faults : tuple of str
        The single faults, where one error states several (of a robot description).

    """

    faults: tuple[str, ...] = ()


class UrdfError(KaneError, ValueError):
    """The URDF text or its supplement is malformed; the message names the element."""


class ModelError(KaneError, ValueError):
    """A body, joint or frame is physically or topologically impossible."""


class ConstraintError(KaneError, ValueError):
    """Generalized speeds or constraints are singular, inconsistent or ill-formed."""


class InputError(KaneError, ValueError):
    """An argument of a call has the wrong shape, type, name or value."""


class CompileError(KaneError, RuntimeError):
    """A kernel could not be compiled, loaded or verified."""


class SweepError(KaneError, RuntimeError):
    """A sweep cannot continue: its workers died, or its folder belongs to another sweep."""


class ModelWarning(UserWarning):
    """Something in a model is legal but is probably not what its author meant."""


class UnusedWarning(ModelWarning):
    """A file contains data that this package does not use, such as transmissions."""
