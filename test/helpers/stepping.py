"""One step of Runge-Kutta 4 with a law of control evaluated at every stage."""


def stepped(robot, torque, q, u, h):
    """Return q and u after a step h, s, under torques of the joints `torque(q, u)`."""
    def rates(q, u):
        tau = robot.generalized_force(torque(q, u), q)
        return robot.joint_rates(q, u), robot.forward_dynamics(q, u, tau)
    a = rates(q, u)
    b = rates(q + h / 2 * a[0], u + h / 2 * a[1])
    c = rates(q + h / 2 * b[0], u + h / 2 * b[1])
    d = rates(q + h * c[0], u + h * c[1])
    return (q + h / 6 * (a[0] + 2 * b[0] + 2 * c[0] + d[0]),
            u + h / 6 * (a[1] + 2 * b[1] + 2 * c[1] + d[1]))
