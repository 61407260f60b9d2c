"""Error messages of `Robot` for unknown attributes and for refused assignments."""

import difflib

# Names in Pinocchio, Drake, MuJoCo and RBDL, in lower case without underscores.
COUNTERPARTS = {
    'inverse_dynamics(q, u, udot)': 'rnea calcinversedynamics inversedynamics id mjinverse tau',
    'forward_dynamics(q, u, tau)': 'aba forwarddynamics fd calcforwarddynamics mjforward',
    'mass_matrix(q)': 'crba calcmassmatrix m inertiamatrix jointspaceinertia massmatrix h',
    'inverse_mass_matrix(q)': 'computeminverse minverse minv',
    'bias_force(q, u)': 'nle nonlineareffects calcbiasterm bias qfrcbias biasforces',
    'gravity_force(q)': 'computegeneralizedgravity calcgravitygeneralizedforces '
                        'gravitycompensation gravitytorque gravityvector g generalizedgravity',
    'coriolis_matrix(q, u)': 'computecoriolismatrix coriolis c',
    'jacobian(frame, q)': 'jac framejacobian computeframejacobian getframejacobian jacobians '
                          'computejointjacobians computejointjacobian mjjac j '
                          'calcjacobianspatialvelocity geometricjacobian calcbodyjacobian',
    'jacobian_rate(frame, q, u)': 'jacobiandot jdot jacobiantimederivative djacobian '
                                  'computejointjacobianstimevariation jacobianderivative',
    'forward_kinematics(frame, q)': 'fk framesforwardkinematics updateframeplacements pose omf '
                                    'framepose calcrelativetransform transform placement',
    'center_of_mass(q)': 'com centerofmass calccenterofmasspositioninworld subtreecom',
    'center_of_mass_jacobian(q)': 'jacobiancenterofmass comjacobian jcom '
                                  'calcjacobiancenterofmasstranslationalvelocity',
    'frame_velocity(frame, q, u)': 'getframevelocity velocity calcspatialvelocity twist',
    'frame_acceleration(frame, q, u, udot)': 'getframeacceleration '
                                             'getframeclassicalacceleration acceleration',
    'operational_space_inertia(frame, q)': 'lambda lambdamatrix taskspaceinertia '
                                           'operationalspaceinertiamatrix',
    'random_configuration()': 'randomconfiguration randomq',
    'neutral()': 'neutralconfiguration qzero q0',
    'regressor(q, u, udot)': 'computejointtorqueregressor',
    'inverse_dynamics_derivatives(q, u, udot)': 'computerneaderivatives rneaderivatives',
    'forward_dynamics_derivatives(q, u, tau)': 'computeabaderivatives abaderivatives',
    'kinetic_energy(q, u)': 'computekineticenergy calckineticenergy',
    'potential_energy(q)': 'computepotentialenergy calcpotentialenergy',
    'n': 'nv numvelocities dof dofs ndof numdofs degreesoffreedom',
    'n_q': 'nq numpositions',
    'joint_names': 'names joints jointnames',
    'frame_names': 'frames links linknames framenames bodies bodynames',
    'limits': 'jointlimits lowerpositionlimit upperpositionlimit velocitylimit effortlimit '
              'effortlimits torquelimits lowerlimits upperlimits positionlimits',
    'parameters.gravity': 'gravity setgravity gravityfield',
    'parameters.payload': 'payload setpayload tool load',
    'model.name': 'name',
}
_BY_NAME = {name: ours for ours, names in COUNTERPARTS.items() for name in names.split()}


def missing(owner: object, name: str) -> str:
    """Return the message for a missing attribute, with the closest existing one."""
    return f"'{type(owner).__name__}' object has no attribute '{name}'{_hint(owner, name)}"


def refused(owner: object, name: str, options: tuple[str, ...]) -> str:
    """Return the message for an attribute that must not be assigned."""
    if name in options:
        why = f'it is fixed at construction; expected {type(owner).__name__}(..., {name}=...)'
    elif hasattr(type(owner), name) or name in vars(owner):
        why = 'it is not to be replaced'
    else:
        why = f'no such attribute{_hint(owner, name)}'
    return f"'{type(owner).__name__}' attribute '{name}' cannot be assigned: {why}"


def _hint(owner: object, name: str) -> str:
    """Return a hint to the attribute that a name probably means, or an empty text."""
    ours = _BY_NAME.get(name.lower().replace('_', ''))
    if ours is None:
        near = difflib.get_close_matches(name, [x for x in dir(type(owner)) if x[0] != '_'], 1)
        ours = near[0] if near else None
    return '' if ours is None else f'; expected robot.{ours}'
