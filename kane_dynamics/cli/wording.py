"""Translate messages of the library to options of the command line."""

OPTIONS = {  # arguments as messages of the library name them, and the options
    'strict=False': '--no-strict',
    'construct it with payload_frame=': 'give --payload-frame',
    'construct the Robot with wrench_frames=': 'give --wrench-frames',
    ", integrator='implicit'": ', --integrator implicit',
    "integrator='implicit'": '--integrator implicit',
    "integrator 'implicit' is used": '--integrator implicit is used',
    ', or its XML as str or bytes': '', ', or a dict': ''}


def in_options(text: str) -> str:
    """Return a message of the library with options of the command line in place of arguments."""
    for ours, theirs in OPTIONS.items():
        text = text.replace(ours, theirs)
    return text
