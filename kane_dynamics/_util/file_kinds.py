"""Say what a file seems to be, for messages on files of the wrong kind."""

import re

from kane_dynamics._util.text import listing

LONGEST = 4000  # bytes that are looked at
MARKS = ((b'\x93NUMPY', 'one NumPy array (.npy)'), (b'PK\x03\x04', 'an npz file'),
         (b'\x89MCAP', 'a ROS 2 bag'), (b'SQLite format 3', 'a ROS 2 bag'))
ROOTS = ((b'<robot', 'a URDF'), (b'<mujoco', 'an MJCF file'), (b'<sdf', 'an SDF file'))


def kind_of_content(data: bytes) -> str:
    """Return the kind of file that a content has, in words, with the columns of a table."""
    start = data[:LONGEST].lstrip(b'\xef\xbb\xbf \t\r\n')
    for mark, kind in MARKS:
        if start.startswith(mark):
            return kind
    if re.match(rb'<[?!\w]', start):
        for root, kind in ROOTS:
            if root in data[:LONGEST]:
                return kind
        return 'XML'
    try:
        # A letter of several bytes may be cut at the end.
        text = start.decode('utf-8', 'ignore' if len(data) > LONGEST else 'strict')
    except UnicodeDecodeError:
        return 'a binary file'
    lines = text.split('\n')
    columns = [name.strip() for name in lines[0].split(',')]
    if len(columns) > 1 and not set('#{[:') & set(lines[0]):
        return f'a CSV file with the columns {listing(columns, 12)}'
    if any(line.partition('#')[0].rstrip().endswith(':') or ': ' in line for line in lines):
        return 'a YAML file'
    return 'text' if start else 'an empty file'
