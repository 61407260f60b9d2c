"""Promises of the README have tests, and pages have the headings that people search."""

import re

from documents import PAGES, ROOT
import pytest

README = (ROOT / 'README.md').read_text(encoding='utf-8')
PROMISES = {
    'Arms with torque commands': [
        'e2e/test_node_torques', 'e2e/test_node_arm_compensates',
        'unit/analysis/test_known_arms'],
    'Arms with trajectories': ['e2e/test_node_feedforward',
                               'unit/demo/test_controller_loop'],
    'Arms with position servos or CAN motors': [
        'e2e/test_node_command_forms', 'e2e/test_node_calibrate',
        'unit/ros/test_ros_command_form'],
    'Feedforward': ['peer/test_pinocchio', 'unit/ros/test_ros_torque_path',
                    'unit/ros/test_ros_live_limits', 'unit/ros/test_ros_loads'],
    'Task space': ['unit/task_space/test_laws_in_mujoco', 'unit/control/test_contact',
                   'property/test_task_space_laws', 'e2e/test_node_singularities'],
    'Motions': ['unit/feasibility/test_time_optimal',
                'unit/feasibility/test_jerk_limited_timing',
                'unit/kinematics/test_cartesian_motion',
                'unit/optimal_control/test_predictive_controller',
                'e2e/test_node_predictive_control'],
    'Checks before motion': ['unit/analysis/test_examination',
                             'unit/ros/test_ros_doctor', 'e2e/test_node_doctor'],
    'Identification': ['unit/identification/test_identification',
                       'e2e/test_cli_identify'],
    'Mechanisms': ['property/test_feature_matrix', 'peer/test_sympy',
                   'peer/test_machines', 'property/test_flexible',
                   'peer/test_elastic_pinocchio'],
    'Simulation': ['unit/simulation/test_energy_balance',
                   'unit/simulation/test_sticking', 'peer/test_mujoco_sticking',
                   'peer/test_contact_events', 'unit/ros/test_ros_plant',
                   'unit/sweep/test_sweep'],
    'Learning and optimization': ['peer/test_casadi', 'peer/test_jax',
                                  'peer/test_torch'],
    'On paper': ['peer/test_derivations', 'e2e/test_cli_equations'],
}
SEARCHED = ['impedance', 'gravity compensation', 'payload', 'MIT mode', 'contact',
            'jerk', 'URDF 1.2']


def test_each_promise_of_the_readme_has_tests():
    _, _, promises = README.partition('## Which arms')
    promises, _, _ = promises.partition('## The library')
    assert re.findall(r'^- \*\*(.*?)\*\*', promises, re.MULTILINE) == list(PROMISES)
    for tests in PROMISES.values():
        for name in tests:
            text = (ROOT / 'test' / f'{name}.py').read_text(encoding='utf-8')
            assert 'def test_' in text, name


@pytest.mark.parametrize('words', SEARCHED)
def test_a_heading_has_the_words_that_people_search(words):
    headings = []
    for page in PAGES:
        headings += re.findall(r'^#+ .*', page.read_text(encoding='utf-8'), re.MULTILINE)
    assert [heading for heading in headings if words.lower() in heading.lower()]
