"""
Crocoddyl's part of predictive_control.py, in an environment with its Pinocchio.

Reads the problem as a line of JSON, prints an iterate and the optimum as another, then,
for every line with a number, the processor time of an iteration, s, of so many.
"""

import json
import sys
import time

import crocoddyl
import numpy as np
import pinocchio

NEAR = 1.1  # cost of the iterate, relative to the least


def problem(given: dict) -> tuple[crocoddyl.ShootingProblem, list, list]:
    """Return the problem, and the states and torques at which to start."""
    model = pinocchio.buildModelFromUrdf(given['urdf'])
    model = pinocchio.buildReducedModel(
        model, [k for k, name in enumerate(model.names) if 'finger' in name],
        np.zeros(model.nq))
    state = crocoddyl.StateMultibody(model)
    actuation = crocoddyl.ActuationModelFull(state)
    n = model.nv
    target = np.array(given['target'] + [0.0] * n)
    held = np.array(given['torque'])

    def action(weights: list, step: float) -> crocoddyl.IntegratedActionModelEuler:
        costs = crocoddyl.CostModelSum(state)
        costs.addCost('state', crocoddyl.CostModelResidual(
            state, crocoddyl.ActivationModelWeightedQuad(np.repeat(weights, n)),
            crocoddyl.ResidualModelState(state, target)), 1.0)
        if step:
            costs.addCost('torque', crocoddyl.CostModelResidual(
                state, crocoddyl.ResidualModelControl(state, held)),
                          given['torque_weight'])
        return crocoddyl.IntegratedActionModelEuler(
            crocoddyl.DifferentialActionModelFreeFwdDynamics(state, actuation, costs),
            step)
    running = action(given['weights'], given['interval'])
    running.u_ub = np.array(given['limits'])
    running.u_lb = -running.u_ub
    x = np.array(given['start'] + [0.0] * n)
    shooting = crocoddyl.ShootingProblem(x, [running] * given['nodes'],
                                         action(given['end_weights'], 0.0))
    shooting.nthreads = 1
    torques = [np.array(given['hold'])] * given['nodes']
    return shooting, list(shooting.rollout(torques)), torques


def main() -> None:
    """Serve one parent process."""
    shooting, states, torques = problem(json.loads(sys.stdin.readline()))
    solver = crocoddyl.SolverBoxDDP(shooting)
    solver.th_stop = 1e-14
    solver.solve(states, torques, 200, True)
    best = solver.cost
    found = np.array(list(solver.us)).tolist()
    shooting.calc(states, torques)
    beginning = (shooting.runningDatas[0].differential.costs.costs['state'].cost
                 * shooting.runningModels[0].dt)
    cost = np.inf
    while cost > NEAR * best:  # as after the shift of a controller's last result
        solver.solve(states, torques, 1, True)
        states = list(solver.xs)
        torques = list(solver.us)
        cost = solver.cost
    print(
        json.dumps({'near': np.array(torques).tolist(), 'cost': best - beginning,
                    'torques': found, 'version': f'{crocoddyl.__version__} on Pinocchio '
                    f'{pinocchio.__version__}'}), flush=True)
    for line in sys.stdin:
        began = time.process_time()
        for _ in range(int(line)):
            solver.solve(states, torques, 1, True)
        print((time.process_time() - began) / int(line), flush=True)


if __name__ == '__main__':
    main()
