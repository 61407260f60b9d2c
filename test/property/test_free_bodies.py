"""Forward dynamics of bodies that move freely: computed along their own axes."""

from kane_dynamics import box, FlexibleLink, ModelBuilder, ModelError, Robot
from kane_dynamics.mechanics.ball_joints import free_bodies
from kane_dynamics.mechanics.definition import kane
import numpy as np
import pytest

BODY = box(9.0, (0.5, 0.4, 0.3), at=(0.1, -0.2, 0.3))
SLIDES = tuple(zip('xyz', np.eye(3)))


def arm(b, on, name='arm', joints=3):
    for k in range(joints):
        b.body(f'{name}{k}', on, axis=np.eye(3)[(k + 2) % 3], at=(0.3, 0.1, 0.05),
               rpy=(0.3, -0.2, 0.1),
               inertial=box(2.0, (0.4, 0.2, 0.1), at=(0.2, 0.05, 0.0)))
        on = f'{name}{k}'
    b.frame(f'{name}/tool', on, at=(0.1, 0.2, 0.3))


def flyer(**options):
    b = ModelBuilder('flyer', gravity=(0.5, -1.0, -9.0))
    b.body('base', kind='free', inertial=BODY, **options)
    arm(b, 'base')
    return b


def two_arms():
    b = flyer()
    arm(b, 'base', 'other', 2)
    return b


def two_flyers():
    b = flyer()
    b.body('stone', kind='free', at=(1.0, 2.0, 3.0), rpy=(0.1, 0.2, 0.3), inertial=BODY)
    arm(b, 'world', 'standing', 2)
    return b


def ball_in_the_arm():
    b = flyer()
    b.body('hand', 'arm2', 'ball', at=(0.1, 0.2, 0.0), rpy=(0.4, 0.1, 0.2),
           inertial=BODY)
    return b


def with_joint(**properties):
    b = flyer()
    b.joint('base/y', **properties)
    return b


def slides(rpy=(0.0, 0.0, 0.0), inertial=None, more=False):
    """Three slides and a ball joint, each stated by itself."""
    b = ModelBuilder('slides', gravity=(0.5, -1.0, -9.0))
    on = 'world'
    for name, axis in SLIDES:
        b.body(name, on, 'prismatic', axis=axis,
               rpy=rpy if name == 'y' else (0.0, 0.0, 0.0),
               **{} if inertial is None else {'inertial': inertial})
        on = name
    b.body('base', 'z', 'ball', inertial=BODY)
    if more:
        b.body('beside', 'y', axis=(0.0, 1.0, 0.0), at=(0.1, 0.0, 0.0), inertial=BODY)
    arm(b, 'base')
    return b


def mimicked():
    b = flyer()
    b.body('cart', 'world', 'prismatic', axis=(1.0, 0.0, 0.0), mimic='base/y',
           inertial=BODY)
    return b


def on_rails():
    b = ModelBuilder('on rails')
    b.body('rail', axis=(0.0, 0.0, 1.0), inertial=BODY)
    b.body('base', 'rail', 'free', at=(0.2, 0.0, 0.0), inertial=BODY)
    arm(b, 'base')
    return b


def with_a_beam():
    b = flyer()
    b.beam('rod', 'arm2', FlexibleLink(0.8, 1.5, 400.0, (1, 1)), axis=(0.0, -1.0, 0.0))
    return b


KINDS = {  # and the number of bodies that are free
    'arm': (flyer, 1),
    'turned frame': (lambda: flyer(rpy=(0.3, -0.8, 0.2), at=(1, 2, 3)), 1),
    'two arms': (two_arms, 1), 'two bodies': (two_flyers, 2),
    'ball': (ball_in_the_arm, 1),
    'friction': (lambda: with_joint(damping=3.0, friction=2.0), 1),
    'beam': (with_a_beam, 1),
    'slides': (slides, 1), 'rotor': (lambda: with_joint(armature=4.0), 0),
    'spring': (lambda: with_joint(stiffness=5.0, rest=0.2), 0),
    'heavy slides': (lambda: slides(inertial=BODY), 0),
    'oblique slides': (lambda: slides(rpy=(0.4, 0.0, 0.3)), 0),
    'mimicked slide': (mimicked, 0),
    'slide with another body': (lambda: slides(more=True), 0),
    'not from the world': (on_rails, 0)}


def random_state(robot, seed):
    rng = np.random.default_rng(seed)
    return robot.random_configuration(rng), *rng.uniform(-2.0, 2.0, (2, robot.n))


@pytest.mark.parametrize('kind', KINDS)
def test_forward_dynamics_of_free_bodies_are_those_of_the_definition(kind):
    make, expected = KINDS[kind]
    model = make().model()
    assert len(free_bodies(model)) == expected
    robot = Robot(model)
    for seed in range(5):
        q, u, tau = random_state(robot, seed)
        accelerations = robot.forward_dynamics(q, u, tau)
        defined = kane.forward_dynamics(model, q, u, tau)
        scale = np.abs(defined).max() * np.linalg.cond(robot.mass_matrix(q))
        np.testing.assert_allclose(accelerations, defined,
                                   rtol=0.0, atol=10.0 * 2.2e-16 * scale)


@pytest.mark.parametrize('payload', ['arm/tool', 'base', 'x', 'z', None])
@pytest.mark.parametrize('frame', ['arm/tool', 'base', 'x', 'y', 'z'])
def test_a_wrench_and_a_payload_act_on_a_free_body_wherever_they_are(frame, payload):
    robot = Robot(slides().model(), wrench_frames=(frame, 'arm1'), payload_frame=payload)
    if payload is not None:
        robot.parameters.payload = box(3.0, (0.1, 0.2, 0.3), at=(0.2, 0.1, -0.3))
    q, u, tau = random_state(robot, 1)
    wrench = np.random.default_rng(2).uniform(-5.0, 5.0, (2, 6))
    udot = robot.forward_dynamics(q, u, tau, wrench=wrench)
    again = robot.inverse_dynamics(q, u, udot, wrench=wrench)
    np.testing.assert_allclose(again, tau, rtol=0.0, atol=1e-11)


def test_a_free_body_of_no_mass_is_refused_by_the_name_of_a_joint():
    b = ModelBuilder('nothing')
    b.body('base', kind='free')
    b.body('link', 'base', axis=(0.0, 0.0, 1.0), armature=1.0)
    with pytest.raises(ModelError, match="'base/z' moves no mass"):
        Robot(b.model()).forward_dynamics([0.0] * 6 + [1.0, 0.0], [0.0] * 7, [0.0] * 7)


def test_the_position_of_a_free_body_does_not_matter():
    robot = Robot(flyer().model())
    q, u, tau = random_state(robot, 3)
    there = q + np.array([1e6, -2e7, 3e8] + [0.0] * (robot.n_q - 3))
    np.testing.assert_array_equal(robot.forward_dynamics(q, u, tau),
                                  robot.forward_dynamics(there, u, tau))
