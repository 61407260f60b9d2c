"""Small URDFs for tests, written piece by piece."""

import warnings

from kane_dynamics.errors import ModelWarning
from kane_dynamics.urdf import load_urdf

LIMIT = '<limit lower="-1" upper="1" velocity="2" effort="3"/>'


def link(name, mass=1.0, moments=(0.1, 0.1, 0.1), xyz='0 0 0', rpy='0 0 0',
         products=(0, 0, 0)):
    """Return a <link>; without <inertial> where the mass is None."""
    if mass is None:
        return f'<link name="{name}"/>'
    xx, yy, zz = moments
    xy, xz, yz = products
    return (f'<link name="{name}"><inertial><origin xyz="{xyz}" rpy="{rpy}"/>'
            f'<mass value="{mass}"/><inertia ixx="{xx}" iyy="{yy}" izz="{zz}" '
            f'ixy="{xy}" ixz="{xz}" iyz="{yz}"/></inertial></link>')


def joint(name, parent, child, kind='revolute', *, axis='0 0 1', xyz='0 0 0',
          rpy='0 0 0', limit=LIMIT, more=''):
    """Return a <joint>; without <axis> where that is None."""
    axis = '' if axis is None else f'<axis xyz="{axis}"/>'
    return (f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child '
            f'link="{child}"/><origin xyz="{xyz}" '
            f'rpy="{rpy}"/>{axis}{limit}{more}</joint>')


def robot(*parts, name='r'):
    """Return a <robot> of the parts."""
    return f'<robot name="{name}">{"".join(parts)}</robot>'


def chain(n, kind='revolute', **more):
    """Return a robot of links l0 to ln and joints j1 to jn between them."""
    return robot(
        *(link(f'l{i}') for i in range(n + 1)),
        *(joint(f'j{i}', f'l{i - 1}', f'l{i}', kind, **more) for i in range(1, n + 1)))


def load(source, **options):
    """Return the model of a URDF that must give no warning."""
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        return load_urdf(source, **options)


def load_with_warnings(source, **options):
    """Return the model of a URDF, and the texts of the ModelWarnings that it gave."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter('always')
        model = load_urdf(source, **options)
    assert all(issubclass(warning.category, ModelWarning) for warning in caught)
    return model, [str(warning.message) for warning in caught]
