"""
A client without ROS: plain DDS by Cyclone, which shares no code with Fast DDS.

It prints one line of JSON: torques that it read for a state that it sent, and the answer
of a service. Only names and types follow ROS's conventions: topics `rt/...`, services
`rq/...Request` and `rr/...Reply`, types `package::msg::dds_::Name_`.
"""

from dataclasses import dataclass
import json
import sys
import time

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import float64, int32, sequence, uint32
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

RELIABLE = Qos(Policy.Reliability.Reliable(duration(seconds=1)),
               Policy.History.KeepLast(10))


@dataclass
class Time(IdlStruct, typename='builtin_interfaces::msg::dds_::Time_'):
    sec: int32
    nanosec: uint32


@dataclass
class Header(IdlStruct, typename='std_msgs::msg::dds_::Header_'):
    stamp: Time
    frame_id: str


@dataclass
class JointState(IdlStruct, typename='sensor_msgs::msg::dds_::JointState_'):
    header: Header
    name: sequence[str]
    position: sequence[float64]
    velocity: sequence[float64]
    effort: sequence[float64]


@dataclass
class Dimension(IdlStruct, typename='std_msgs::msg::dds_::MultiArrayDimension_'):
    label: str
    size: uint32
    stride: uint32


@dataclass
class Layout(IdlStruct, typename='std_msgs::msg::dds_::MultiArrayLayout_'):
    dim: sequence[Dimension]
    data_offset: uint32


@dataclass
class Numbers(IdlStruct, typename='std_msgs::msg::dds_::Float64MultiArray_'):
    layout: Layout
    data: sequence[float64]


@dataclass
class Vector3(IdlStruct, typename='geometry_msgs::msg::dds_::Vector3_'):
    x: float64
    y: float64
    z: float64


@dataclass
class Wrench(IdlStruct, typename='geometry_msgs::msg::dds_::Wrench_'):
    force: Vector3
    torque: Vector3


@dataclass
class Request(IdlStruct,
              typename='kane_dynamics_interfaces::srv::dds_::InverseDynamics_Request_'):
    joint_names: sequence[str]
    position: sequence[float64]
    velocity: sequence[float64]
    acceleration: sequence[float64]


@dataclass
class Response(
        IdlStruct,
        typename='kane_dynamics_interfaces::srv::dds_::InverseDynamics_Response_'):
    success: bool
    message: str
    joint_names: sequence[str]
    effort: sequence[float64]
    joint_reactions: sequence[Wrench]


def first(reader, wanted, act=lambda: None, timeout=20.0):
    """Return the first sample that is wanted; `act` is done before each look."""
    end = time.monotonic() + timeout
    while time.monotonic() < end:
        act()
        time.sleep(0.05)
        for sample in reader.take(50):
            if wanted(sample):
                return sample
    raise SystemExit('nothing came')


def torques(participant, joints, q):
    """Send a state until it is answered; return named torques and commands."""
    states = DataWriter(participant, Topic(participant, 'rt/joint_states', JointState))
    named = DataReader(participant, Topic(participant, 'rt/kane_dynamics/joint_torques',
                                          JointState), qos=RELIABLE)
    commands = DataReader(participant, Topic(participant, 'rt/commands', Numbers),
                          qos=RELIABLE)

    def send():
        stamp = Time(*divmod(time.time_ns(), 10**9))
        states.write(JointState(Header(stamp, ''), joints, q, [0.0] * len(q), []))
    sample = first(named, lambda sample: any(sample.effort), send)
    return {
        'name': list(sample.name), 'effort': list(sample.effort),
        'commands': list(first(commands, lambda sample: any(sample.data), send).data)}


def inverse_dynamics(participant, joints, q):
    """
    Call the service at rest; return its answer.

    A ROS client tells its requests apart by a sample identity in the in-line QoS, which
    Cyclone's Python API cannot write. The node then answers to the identity of the
    sample itself, which a client that is alone need not read.
    """
    name = 'kane_dynamics/inverse_dynamics'
    requests = DataWriter(participant, Topic(participant, f'rq/{name}Request', Request),
                          qos=RELIABLE)
    answers = DataReader(participant, Topic(participant, f'rr/{name}Reply', Response),
                         qos=RELIABLE)
    at_rest = [0.0] * len(q)

    def ask():
        requests.write(Request(joints, q, at_rest, at_rest))
    answer = first(answers, lambda answer: True, ask)
    return {'success': answer.success, 'name': list(answer.joint_names),
            'effort': list(answer.effort), 'message': answer.message}


def main(domain, joints, q):
    participant = DomainParticipant(int(domain))
    arguments = participant, joints.split(','), [float(x) for x in q.split(',')]
    print(json.dumps({'topic': torques(*arguments),
                      'service': inverse_dynamics(*arguments)}), flush=True)


if __name__ == '__main__':
    main(*sys.argv[1:])
