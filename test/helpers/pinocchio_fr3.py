"""The arm FR3 in Pinocchio."""

from functools import cache

import numpy as np
import pytest


@cache
def pinocchio_fr3(payload=0.0):
    """
    Return Pinocchio, its model of the arm without moving fingers, and the model's data.

    The model has no friction. The payload is a point mass, kg, at the last link.
    """
    pinocchio = pytest.importorskip('pinocchio')
    model = pinocchio.buildModelFromUrdf('urdf/fr3.urdf')
    fingers = [k for k, name in enumerate(model.names) if 'finger' in name]
    model = pinocchio.buildReducedModel(model, fingers, np.zeros(model.nq))
    if payload:
        inertia = pinocchio.Inertia(payload, np.zeros(3), np.zeros((3, 3)))
        placement = model.frames[model.getFrameId('fr3_link7')].placement
        model.appendBodyToJoint(7, inertia, placement)
    return pinocchio, model, model.createData()
