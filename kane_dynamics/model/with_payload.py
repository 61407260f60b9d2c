"""Add a payload to a model: an inertial attached to the body of a frame."""

from dataclasses import replace

from kane_dynamics.model.model import Inertial, Model, WORLD


def with_payload(model: Model, frame: str, payload: Inertial) -> Model:
    """
    Return the model with a payload attached.

    Parameters
    ----------
    model : Model
        The mechanism.
    frame : str
        Name of the frame in whose axes and from whose origin the payload is given.
    payload : Inertial
        Inertial properties of the payload.

    Raises
    ------
    InputError
        If the frame does not exist; the message lists the valid ones.

    """
    at = model.frame(frame)
    moved = payload.moved(at.rotation, at.translation)
    if at.body == WORLD:
        return replace(model, base_inertial=model.base_inertial + moved)
    bodies = list(model.bodies)
    carrier = bodies[at.body]
    bodies[at.body] = replace(carrier, inertial=carrier.inertial + moved)
    return replace(model, bodies=tuple(bodies))
