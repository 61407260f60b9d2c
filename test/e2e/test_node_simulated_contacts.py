"""The service ~/simulate of a node whose parameter states contacts."""

from kane_dynamics import load_contacts, Robot, simulate
from kane_dynamics_interfaces.srv import Simulate
from node_process import close, model, Process, URDF
import numpy as np

Q = [0.3, -0.4, 0.2]


def test_simulate_has_the_contacts_of_the_parameter(client, tmp_path):
    robot = Robot(model())
    q = np.array(Q)
    height = float(robot.frame_pose('c', q)[2, 3]) - 0.05
    file = tmp_path / 'table.yaml'
    file.write_text('contacts: {tool: {frame: c, friction: 0.5, '
                    f'plane: {{point: [0, 0, {height!r}]}}}}}}')
    expected = simulate(robot, q, np.zeros(3), 0.5, sample=0.01,
                        contacts=load_contacts(file))
    process = Process(robot_description=f"'{URDF}'", simulation__contacts=str(file))
    try:
        process.wait_for('active, mode')
        client.process = process
        answer = client.call(Simulate, 'simulate', position=Q, duration=0.5,
                             sample_period=0.01)
    finally:
        assert process.end()[0] == 0
    assert answer.success, answer.message
    positions = [point.positions for point in answer.trajectory.points]
    assert close(np.array(positions), expected.q)
    assert str(expected.contact_events[0]) in answer.message
