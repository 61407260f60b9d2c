"""Build a ROS package of one message at test time, with the tools that build our interfaces."""

from pathlib import Path
import re
import shutil
import subprocess
import sys
import zipfile

INTERFACES = Path(__file__).resolve().parents[2] / 'kane_dynamics_interfaces'


def build_message(folder, package, name, fields):
    """
    Build package/msg/name; return the paths for PYTHONPATH and AMENT_PREFIX_PATH.

    The wheel is unpacked in `folder`, so that no environment changes.
    """
    source = folder / package
    (source / 'msg').mkdir(parents=True)
    (source / 'msg' / f'{name}.msg').write_text(fields)
    shutil.copy(INTERFACES / 'pip_ros.cmake', source)
    for file in ('package.xml', 'pyproject.toml'):
        text = (INTERFACES / file).read_text()
        text = text.replace('kane_dynamics_interfaces', package).replace(
            'kane-dynamics-interfaces', package.replace('_', '-'))
        (source / file).write_text(text)
    text = (INTERFACES / 'CMakeLists.txt').read_text()
    text = re.sub(r'(?:  "(?:action|msg|srv)/\w+\.\w+"\n)+', f'  "msg/{name}.msg"\n', text)
    (source / 'CMakeLists.txt').write_text(
        text.replace('kane_dynamics_interfaces', package))
    subprocess.run([Path(sys.executable).parent / 'uv', 'build', '--python', sys.executable,
                    '--quiet', '--wheel', '--out-dir', str(folder), str(source)], check=True,
                   timeout=900)
    wheel, = folder.glob('*.whl')
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(folder / 'wheel')
    prefix, = (folder / 'wheel').glob('*.data/data')
    packages, = prefix.glob('lib/python*/site-packages')
    return packages, prefix
