"""Identification of inertial parameters and friction from recordings: extra `identify`."""

from kane_dynamics.identification.base_regressor import (base_parameters, BaseFit,
                                                         BaseParameters)
from kane_dynamics.identification.collision_calibration import (calibrate_collision,
                                                                CollisionCalibration)
from kane_dynamics.identification.drives.drive_recording import (DriveRecording,
                                                                 read_drive_recording)
from kane_dynamics.identification.drives.identify_drives import (DriveIdentification,
                                                                 identify_drives)
from kane_dynamics.identification.efforts import Efforts
from kane_dynamics.identification.excitation.friction_motion import friction_motion
from kane_dynamics.identification.excitation.optimal_excitation import Excitation, excite
from kane_dynamics.identification.fit import Identification, identify
from kane_dynamics.identification.friction_laws import CandidateErrors
from kane_dynamics.identification.model_watch import ModelChange, ModelWatch, WatchReport
from kane_dynamics.identification.payload.payload_estimator import PayloadEstimator
from kane_dynamics.identification.payload.payload_fit import identify_payload, Payload
from kane_dynamics.identification.poses.calibrate_poses import (calibrate_poses,
                                                                PoseCalibration)
from kane_dynamics.identification.poses.held_poses import (held_poses, HeldPoses,
                                                           read_poses)
from kane_dynamics.identification.recordings.diagnosis import diagnose, RecordingFault
from kane_dynamics.identification.recordings.reader import read_recording
from kane_dynamics.identification.recordings.recording import Recording
from kane_dynamics.identification.recordings.torque_delay import torque_delays, TorqueDelays
from kane_dynamics.identification.regression import rows

__all__ = ['BaseFit', 'BaseParameters', 'CandidateErrors', 'CollisionCalibration',
           'DriveIdentification', 'DriveRecording', 'Efforts', 'Excitation',
           'HeldPoses', 'Identification', 'ModelChange', 'ModelWatch', 'Payload',
           'PayloadEstimator', 'PoseCalibration', 'Recording', 'RecordingFault',
           'TorqueDelays', 'WatchReport', 'base_parameters', 'calibrate_collision',
           'calibrate_poses', 'diagnose', 'excite', 'friction_motion', 'held_poses',
           'identify', 'identify_drives', 'identify_payload', 'read_drive_recording',
           'read_poses', 'read_recording', 'rows', 'torque_delays']
