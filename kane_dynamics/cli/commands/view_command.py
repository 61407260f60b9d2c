"""The command `view`: a robot, its motion and its loads in the browser."""

from argparse import Namespace
import webbrowser

from kane_dynamics._util.optional_imports import extra
from kane_dynamics.cli.printing import model_warnings, print_json
from kane_dynamics.cli.robot_options import load_robot, source_of
from kane_dynamics.cli.tables import load_trajectory
from kane_dynamics.urdf.link_shapes import load_visuals


def view(options: Namespace) -> None:
    """Serve the page until interrupted, or write it to a file."""
    page = extra('kane_dynamics.view', 'view', 'the view')  # report a missing extra early
    _, robot = load_robot(options)
    with model_warnings(verbose=options.verbose):
        visuals = load_visuals(source_of(options))
    trajectory = load_trajectory(options.motion, robot) if options.motion else None
    window = page.Window(robot, trajectory, visuals=visuals, host=options.host,
                         port=0 if options.export else options.port)
    try:
        if options.export:
            window.export(options.export)
            _say(options, 'file', options.export, 'wrote')
            return
        _say(options, 'url', window.url, 'press Ctrl+C to stop; page at')
        if not options.no_open:
            webbrowser.open(window.url)
        window.run()
    except KeyboardInterrupt:
        pass  # the user ends it by Ctrl+C
    finally:
        window.close()


def _say(options: Namespace, key: str, value: str, words: str) -> None:
    """Print the address or the file of the page."""
    if options.json:
        print_json({key: value})
    else:
        print(f'{words} {value}', flush=True)
