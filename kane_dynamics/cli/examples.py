"""Epilogs of the help texts: examples and file formats of each command."""

EXAMPLES = {
    'torque': """
examples:
  kane-dynamics torque arm.urdf --q 0.1 -0.5 1.2 --u 0 0.3 0 --udot 1 0 0
  kane-dynamics torque arm.urdf --motion motion.csv --out torques.csv
  kane-dynamics torque arm.urdf --motion motion.csv --plot sources.png
  kane-dynamics torque press.urdf --constraints press.yaml --q 0.3 --udot 1
  xacro arm.urdf.xacro | kane-dynamics torque - --gravity 0 0 -1.62 --json

A motion is a CSV file with the columns t, q.<joint>, u.<joint>, udot.<joint>, or a
YAML file like a trajectory_msgs/JointTrajectory. Missing speeds and accelerations
are those of the smooth curve through its points. The points of a YAML file are
sampled every 0.01 s; the rows of a CSV file are used as they are; --step samples
both.""",
    'simulate': """
examples:
  kane-dynamics simulate arm.urdf --q0 0.5 0 0 --duration 5 --plot fall.png
  kane-dynamics simulate arm.urdf --q0 0.5 0 0 --plot energy.png --plot-of energy
  kane-dynamics simulate arm.urdf --duration 2 --torque 3.0 0 0 --out constant.csv
  kane-dynamics simulate arm.urdf --motion motion.yaml --kp 400 --kd 40 --out track.npz

Without --motion and --torque no torque acts. A torque file is a CSV file with the
columns tau.<joint>. With a column t each row holds until the time of the next row,
else for one step.""",
    'sweep': """
examples:
  kane-dynamics sweep payloads.yaml --out payloads
  kane-dynamics sweep payloads.yaml --out payloads --workers 4 --json
  kane-dynamics sweep payloads.yaml --out payloads --plot payloads.png

payloads.yaml, for example:
  urdf: arm.urdf
  tip: tool0
  samples: 10000
  seed: 1
  duration: 1.0
  step: 0.001
  q0: {shoulder: {uniform: [-1, 1]}, elbow: {normal: [0.5, 0.1]}}
  payload: {frame: tool0, mass: {uniform: [0, 5]}, com: [0, 0, {uniform: [0, 0.1]}]}
  friction: {uniform: [0.5, 2]}
  controller: {kind: computed_torque, kp: {loguniform: [50, 500]}, kd: 20, known_payload: 0}
  motion: motion.csv

A value is a number or one of uniform, loguniform, normal: [mean, deviation], choice,
grid. It is for all joints; {each: value} draws one for each joint; a list or a
mapping names one per joint. The folder is one parquet table. Run the command again
to continue an interrupted sweep.""",
    'inspect': """
examples:
  kane-dynamics inspect arm.urdf
  kane-dynamics inspect arm.urdf --tip tool0 --json
  kane-dynamics inspect arm.urdf --against pinocchio
  kane-dynamics inspect arm.urdf --frames
  kane-dynamics inspect arm.urdf --operations

Exits with 1 if the torques differ from those of Pinocchio.""",
    'export': """
examples:
  kane-dynamics export arm.urdf -o arm.c
  kane-dynamics export arm.urdf -o src/arm.c --kernel inverse_dynamics --payload-frame tool0

Writes arm.c and arm.h: C99 that needs only libm. Its function arm_self_test()
returns 0 if the compiled functions return the same numbers as this library.""",
    'equations': """
examples:
  kane-dynamics equations two_link.urdf
  kane-dynamics equations arm.urdf --joints shoulder elbow --numbers
  kane-dynamics equations two_link.urdf --latex -o two_link.tex
  kane-dynamics equations four_bar.urdf --constraints four_bar.yaml --c -o four_bar.c
  kane-dynamics equations two_rods.urdf --auxiliary rod_a_joint:rx --axes rod_a
  kane-dynamics equations rolling_disc.py

A Python file has one variable with a Robot. m1, r1, I1 are mass, center of mass and
moment of inertia of the first body, l1 the position of its joint. --c and --python
print code. Operation counts share common subexpressions; those of the compiled kernels
are printed too.""",
    'identify': """
examples:
  kane-dynamics identify arm.urdf recording.csv
  kane-dynamics identify arm.urdf recording.npz --cutoff 8 --out identified.urdf
  kane-dynamics identify arm.urdf recording.csv --friction-only --json
  kane-dynamics identify arm.urdf recording.csv --friction-only --unbounded
  kane-dynamics identify arm.urdf run.mcap --supplement arm.yaml --payload tool0 --out load.yaml
  kane-dynamics identify press.urdf run.csv --constraints press.yaml --payload slide

A recording has the columns t, q.<joint>, u.<joint>, udot.<joint>, tau.<joint>, or
numbered from the base: q1, v1, a1, tau1, over all joints of the robot, or over those
of --joints or --tip. The npz file of simulate --out is accepted too. Missing speeds
and accelerations are derived from q, which should then be filtered with --cutoff.
The first half is fitted; the second half is held out. --out arm.urdf also writes
arm.supplement.yaml: load both. With --payload the arm and its friction are known,
and --out is the supplement with the payload; with --constraints the recording is of
the actuated joints.""",
    'calibrate': """
examples:
  kane-dynamics calibrate arm.urdf poses.csv --out arm.supplement.yaml
  kane-dynamics calibrate arm.urdf empty.mcap --loaded loaded.mcap --load tool0 --load-mass 0.5
  kane-dynamics calibrate arm.urdf free.csv --collision
  kane-dynamics calibrate arm.urdf free.mcap --collision --tip tool0 --out thresholds.yaml
  kane-dynamics calibrate press.urdf run.csv --collision --constraints press.yaml --json

A table of held poses has the columns q.<joint> and tau.<joint>, one row a pose. Ten
poses or more, each approached from both sides, give gravity, offsets and friction. The
scales of the efforts can be told apart from the masses only by a known load in about
half of the poses. --out arm.supplement.yaml also writes arm.supplement.node.yaml, which
the node reads at once: kane_dynamics --ros-args --params-file ...

With --collision the recording is as for identify, of half a minute or more: the task at
its speeds with its payload and no contact. Friction beyond that of the model is fitted;
thresholds are 1.4 times the largest error that remains plus a tenth of the friction,
which may change so much. --out is a parameter file: ros2 run kane_dynamics
kane_dynamics --ros-args --params-file thresholds.yaml ...""",
    'excite': """
examples:
  kane-dynamics excite arm.urdf --out motion.csv
  kane-dynamics excite arm.urdf --out motion.csv --duration 20 --periods 2 --share 0.6 --floor 0.1
  kane-dynamics excite arm.urdf --out slow.csv --friction --loads 4

Optimizes sums of sines within the limits of the URDF for the identification of
inertial parameters and friction. Move the arm to the start, run the motion, record q
and tau, and pass the recording to identify. The motion keeps above the floor, and
its links apart; links that are near each other at rest keep half of that distance.
Exits with 1 if that is less than --distance. With --friction the motion is slow
reversals under several loads, for identify --friction-only.""",
    'replay': """
examples:
  kane-dynamics replay arm.urdf recording.csv --plot torques.png
  kane-dynamics replay arm.urdf bag_folder --topic /joint_states --cutoff 10
  kane-dynamics replay arm.urdf run.mcap --supplement identified.supplement.yaml --json
  kane-dynamics replay arm.urdf today.csv --reference sound.csv

A recording is a file as for identify, or a ROS 2 bag (MCAP or SQLite) of joint
states with efforts. ROS is not needed. Missing accelerations are derived from q;
filter them with --cutoff. With --reference, a payload, friction, an offset, a torque
constant or a delay that differs from that of the sound arm is named with its joint,
and the exit code is 1. Small changes show only in the same motion.""",
    'view': """
examples:
  kane-dynamics view arm.urdf
  kane-dynamics view arm.urdf --motion fall.npz
  kane-dynamics view arm.urdf --motion motion.csv --export motion.html

Without a motion each joint has a slider, and the arrows show the torques that hold
the arm against gravity. A motion is a file as for torque, or an .npz file of
simulate. Meshes are searched in the folder of the URDF, in every folder above it,
and in share/ of AMENT_PREFIX_PATH. An exported page needs no server.""",
    'feasible': """
examples:
  kane-dynamics feasible arm.urdf --motion motion.csv
  kane-dynamics feasible arm.urdf --motion motion.yaml --out as_fast_as_it_may.csv
  kane-dynamics feasible arm.urdf --motion motion.csv --payload-frame tool0 --plot use.png
  kane-dynamics feasible arm.urdf --motion motion.csv --time-optimal --out fastest.csv

Exits with 1 if the motion exceeds a limit of torque, speed, position or, with
--power, power. Prints the highest feasible speed of the motion and, with
--payload-frame, the largest payload. With --time-optimal, each part of the path has
its own highest speed.""",
    'fill': """
examples:
  kane-dynamics fill arm.urdf --motion plan.yaml --out filled.yaml
  kane-dynamics fill arm.urdf --motion plan.yaml --tolerance 0.5 --json
  kane-dynamics fill arm.urdf --motion run.mcap --topic /plan --out filled

A motion is a CSV file with the columns t, q.<joint>, u.<joint>, udot.<joint>, a
saved npz file, a YAML file like a trajectory_msgs/JointTrajectory (as ros2 topic
echo prints it), or a bag with such messages, which are all filled. The result has
all fields, for a controller that claims the command interface effort.""",
    'doctor': """
examples:
  kane-dynamics doctor arm.urdf
  kane-dynamics doctor arm.urdf --config arm.yaml --live 3
  kane-dynamics doctor arm.urdf --live 5 --namespace left --json
  kane-dynamics doctor arm.urdf --live 5 --commands /forward_effort_controller/commands

Compares names, limits, the sign of gravity, publishers and subscribers, rates,
stamps and QoS. With --config, --live examines the robot of that file, of the node in
--namespace if there are several. Both options need ROS. Exits with 1 if there is a
problem.""",
    'send': """
examples:
  kane-dynamics send arm.urdf --by 0.2
  kane-dynamics send arm.urdf --by 0.2 -0.4 0.1 --duration 3
  kane-dynamics send arm.urdf --motion motion.yaml --json

Publishes a trajectory for the dynamics node, which must be active, and prints the
largest difference between measured and desired positions. On a real arm this moves
the arm. Needs ROS.""",
}
