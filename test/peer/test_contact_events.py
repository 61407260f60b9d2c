"""An arm that lands on a table and wipes it, against an event-driven program."""

from kane_dynamics import (ConstraintError, Contact, ContactMode, ModelBuilder,
                           PlaneSurface, Robot, rod, simulate)
import numpy as np
import pytest

integrate = pytest.importorskip('scipy.integrate')

G, HEIGHT, DAMPING = 9.80665, -0.1, 0.1
M1, M2, L1, L2 = 2.0, 1.0, 0.5, 0.4


def terms(state):
    """Return M, the generalized forces, J and J' v of the tip (x, z), after Lagrange."""
    (a, b), (v, w) = state[:2], state[2:]
    c1, s1, c12, s12 = np.cos(a), np.sin(a), np.cos(a + b), np.sin(a + b)
    c2, s2 = np.cos(b), np.sin(b)
    m12 = M2 * (L2**2 / 3 + L1 * L2 * c2 / 2)
    M = np.array([[M1 * L1**2 / 3 + M2 * (L1**2 + L2**2 / 3 + L1 * L2 * c2), m12],
                  [m12, M2 * L2**2 / 3]])
    coupling = M2 * L1 * L2 * s2 / 2
    force = np.array([coupling * (2 * v * w + w * w)
                      + G * (M1 * L1 / 2 * c1 + M2 * (L1 * c1 + L2 / 2 * c12)),
                      -coupling * v * v + G * M2 * L2 / 2 * c12]) - DAMPING * state[2:]
    J = np.array([[-L1 * s1 - L2 * s12, -L2 * s12], [-L1 * c1 - L2 * c12, -L2 * c12]])
    drift = np.array([-L1 * c1 * v * v - L2 * c12 * (v + w)**2,
                      L1 * s1 * v * v + L2 * s12 * (v + w)**2])
    return M, force, J, drift


def contact_force(state, mode, mu):
    """Return the force on the tip, (2,), in 'flight', 'stick', or sliding, 1 or -1."""
    M, force, J, drift = terms(state)
    inverse = np.linalg.inv(M)
    free = J @ inverse @ force + drift
    A = J @ inverse @ J.T
    if mode == 'flight':
        return np.zeros(2)
    if mode == 'stick':
        return np.linalg.solve(A, -free)
    ratio = np.array([-mu * mode, 1.0])
    return ratio * (-free[1] / (A[1] @ ratio))


def landed(state, mu):
    """Return the state after the impact of the tip, and its mode."""
    M, _, J, _ = terms(state)
    A = J @ np.linalg.solve(M, J.T)
    velocity = J @ state[2:]
    impulse = np.linalg.solve(A, -velocity)
    mode = 'stick'
    if abs(impulse[0]) > mu * impulse[1]:
        mode = float(-np.sign(impulse[0]))
        ratio = np.array([-mu * mode, 1.0])
        impulse = ratio * (-velocity[1] / (A[1] @ ratio))
    after = state.copy()
    after[2:] += np.linalg.solve(M, J.T @ impulse)
    return after, mode


def reference(state, end, mu):
    """Return the states at steps of 0.01 s, and the changes of mode with their times."""
    t, mode, changes = 0.0, 'flight', []
    times, rows = np.arange(0.0, end + 1e-9, 0.01), [state]

    def rates(t, state):
        M, force, J, _ = terms(state)
        total = force + J.T @ contact_force(state, mode, mu)
        return np.concatenate([state[2:], np.linalg.solve(M, total)])

    def height(t, state):
        return -L1 * np.sin(state[0]) - L2 * np.sin(state[0] + state[1]) - HEIGHT

    def slip(t, state):
        return terms(state)[2][0] @ state[2:]

    def pressure(t, state):
        return contact_force(state, mode, mu)[1]

    def grip(t, state):
        tangent, normal = contact_force(state, mode, mu)
        return mu * normal - abs(tangent)
    while t < end - 1e-12:
        watched = {'flight': [height], 'stick': [grip, pressure]}.get(mode)
        watched = watched or [slip, pressure]
        for function in watched:
            function.terminal, function.direction = True, 0.0
        height.direction = grip.direction = pressure.direction = -1.0
        later = times[times > t + 1e-12]
        # A slip begins at zero, where it is no event.
        begin = 1e-9 if mode in (-1.0, 1.0) and abs(slip(t, state)) < 1e-9 else 0.0
        if begin:
            state = state + begin * rates(t, state)
        run = integrate.solve_ivp(rates, (t + begin, end), state, method='DOP853',
                                  t_eval=later, events=watched, rtol=1e-11, atol=1e-12)
        rows += list(run.y.T)
        if run.status == 0:
            break
        which = next(k for k, found in enumerate(run.t_events) if len(found))
        t, state = float(run.t_events[which][0]), run.y_events[which][0]
        if mode == 'flight':
            state, mode = landed(state, mu)
        elif watched[which] is pressure:
            mode = 'flight'
        elif mode == 'stick':
            mode = float(-np.sign(contact_force(state, mode, mu)[0]))
        else:
            tangent, normal = contact_force(state, 'stick', mu)
            mode = 'stick' if abs(tangent) <= mu * normal else -mode
        changes.append((t, mode))
    return np.array(rows), changes


def arm():
    """Return the arm of the equations above."""
    b = ModelBuilder('arm', gravity=(0, 0, -G))
    joint = {'axis': (0, 1, 0), 'damping': DAMPING}
    b.body('upper', inertial=rod(M1, (0, 0, 0), (L1, 0, 0)), **joint)
    b.body('fore', 'upper', at=(L1, 0, 0), inertial=rod(M2, (0, 0, 0), (L2, 0, 0)),
           **joint)
    b.frame('tip', 'fore', at=(L2, 0, 0))
    return Robot(b.model())


def table(mu):
    """Return the contact of the tip with the table."""
    return [Contact('tip', PlaneSurface((0, 0, HEIGHT)), friction=mu)]


@pytest.mark.parametrize(('mu', 'end'), [(0.0, 0.5), (0.1, 0.5), (0.4, 0.6), (0.6, 0.6)])
def test_an_arm_lands_and_wipes_as_in_an_event_driven_program(mu, end):
    run = simulate(arm(), [-0.5, 0.3], [0.0, 0.0], end, step=5e-4, sample=0.01,
                   contacts=table(mu))
    states, changes = reference(np.array([-0.5, 0.3, 0.0, 0.0]), end, mu)
    assert len(changes) == (2 if mu > 0.3 else 1) and not run.warnings
    assert run.contact_events[0].t == pytest.approx(changes[0][0], abs=1e-11)
    np.testing.assert_allclose(run.q, states[:, :2], atol=1e-9)
    np.testing.assert_allclose(run.u, states[:, 2:], atol=2e-7)
    # The same modes between the changes.
    begins = [t for t, _ in changes]
    for begin, after, (_, mode) in zip(begins, [*begins[1:], end], changes):
        inside = (run.t > begin + 1e-6) & (run.t < after - 1e-6)
        expected = ContactMode.STICKING if mode == 'stick' else ContactMode.SLIDING
        assert (run.contact_modes[inside, 0] == expected).all()


def test_an_arm_that_jams_while_it_slides_is_refused_with_its_reason():
    """The normal force grows without bound at 0.53 s (Painleve's paradox)."""
    with pytest.raises(ConstraintError, match=r"contact 'tip': .*Painleve's paradox"):
        simulate(arm(), [-0.5, 0.3], [0.0, 0.0], 0.6, contacts=table(0.1))
