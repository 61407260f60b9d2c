"""Messages of the library in the words of the command line."""

OPTIONS = {  # arguments of the library, as messages name them, and the command line's
    'strict=False': '--no-strict',
    'construct it with payload_frame=': 'give --payload-frame',
    'construct the Robot with wrench_frames=': 'give --wrench-frames',
    ", integrator='implicit'": ', --integrator implicit', "integrator='implicit'":
    '--integrator implicit', ', or its XML as str or bytes': '', ', or a dict': ''}


def in_options(text: str) -> str:
    """Return a message of the library in the words of the command line."""
    for ours, theirs in OPTIONS.items():
        text = text.replace(ours, theirs)
    return text
