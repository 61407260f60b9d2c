"""Random trees with ball and free joints, and Pinocchio's models of them."""

from kane_dynamics import ModelBuilder
from mechanisms import random_inertial, random_rotation
import numpy as np
import pinocchio as pin

KINDS = ('free', 'ball', 'revolute', 'prismatic', 'ball', 'revolute')


def angles_of(R):
    """Return roll, pitch and yaw of a rotation."""
    return np.arctan2(R[2, 1],
                      R[2, 2]), np.arcsin(-R[2, 0]), np.arctan2(R[1, 0], R[0, 0])


def random_ball_tree(seed, kinds=KINDS, gravity=(0.3, -0.2, -9.81)):
    """Return a random tree whose bodies have joints of these kinds."""
    rng = np.random.default_rng(seed)
    b = ModelBuilder(f'tree{seed}', gravity=gravity)
    names = ['world']
    for k, kind in enumerate(kinds):
        on = names[-1] if rng.random() < 0.7 else names[rng.integers(len(names))]
        b.body(f'b{k}', on, kind, axis=rng.normal(size=3), at=rng.uniform(-0.5, 0.5, 3),
               rpy=angles_of(random_rotation(rng)), inertial=random_inertial(rng))
        names.append(f'b{k}')
    b.frame('tool', names[-1], at=(0.1, 0.2, -0.3), rpy=(0.4, -0.5, 0.6))
    return b.model()


def peer_of(model):
    """Return Pinocchio's model; a ball joint is JointModelSpherical, same q and u."""
    peer = pin.Model()
    places = {}
    peer.gravity.linear[:] = model.gravity
    k = 0
    while k < len(model.bodies):
        body = model.bodies[k]
        joint = model.bodies[k].joint
        kind = (pin.JointModelSpherical() if k in model.balls else
                pin.JointModelRevoluteUnaligned(joint.axis) if joint.kind == 'revolute'
                else pin.JointModelPrismaticUnaligned(joint.axis))
        last = k + 2 if k in model.balls else k
        carrier = model.bodies[last]
        place = peer.addJoint(places.get(body.parent, 0), kind,
                              pin.SE3(joint.rotation, joint.translation), carrier.name)
        inertial = carrier.inertial
        peer.appendBodyToJoint(
            place, pin.Inertia(inertial.mass, inertial.com, inertial.inertia),
            pin.SE3.Identity())
        places[last] = place
        k = last + 1
    for frame in model.frames:
        peer.addFrame(pin.Frame(f'frame:{frame.name}', places.get(frame.body, 0),
                                pin.SE3(frame.rotation, frame.translation),
                                pin.FrameType.OP_FRAME))
    return peer
