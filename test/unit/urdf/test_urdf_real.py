"""Real URDFs of example-robot-data: each loads, or is rejected for a known fault."""

from importlib.metadata import files
import warnings

from kane_dynamics.errors import KaneError, ModelWarning, UnusedWarning
from kane_dynamics.urdf import load_urdf
from numpy.testing import assert_allclose
import pinocchio as pin
import pytest

URDFS = sorted((file.locate() for file in files('example-robot-data')
                if file.name.endswith('.urdf')), key=str)
# What is wrong with those that are refused, and whether strict=False is enough.
REFUSED = {
    'alex_psyonic_hands.urdf': ("joint 'Left_index_q2': <mimic> joint 'index_q1'",
                                False), 'ur3.urdf': ('name None', False),
    'romeo_laas_small.urdf': ("link 'body': <inertia>", True),
    'tiago.urdf': ("link 'base_antenna_left_link': <inertia>", True),
    'tiago_dual.urdf': ("link 'base_antenna_left_link': <inertia>", True),
    'tiago_no_hand.urdf': ("link 'base_antenna_left_link': <inertia>", True),
}
NAMES = [f'{path.parts[-3]}-{path.stem}' for path in URDFS]


@pytest.mark.parametrize('path', URDFS, ids=NAMES)
def test_real_urdf_loads_or_is_refused_for_its_fault(path):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter('always')
        if path.name in REFUSED:
            words, lenient = REFUSED[path.name]
            with pytest.raises(KaneError) as error:
                load_urdf(path)
            assert words in str(error.value)
            if not lenient:
                return
        model = load_urdf(path, strict=path.name not in REFUSED)
    assert {warning.category for warning in caught} <= {ModelWarning, UnusedWarning}
    assert len({str(warning.message)[:40] for warning in caught}) == len(caught) <= 5
    peer = pin.buildModelFromUrdf(str(path))
    assert peer.nv == len(model.bodies)
    mass = sum(body.inertial.mass for body in model.bodies) + model.base_inertial.mass
    # Pinocchio assigns the mass of the root link to the universe.
    assert_allclose(mass, sum(inertia.mass for inertia in peer.inertias), rtol=1e-12)
    assert {frame.name for frame in model.frames} == {
        frame.name for frame in peer.frames if frame.type == pin.BODY}


def test_enough_real_urdfs_are_tested():
    assert len(URDFS) >= 66
    assert sum(path.name not in REFUSED for path in URDFS) >= 60
