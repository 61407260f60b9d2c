"""A headless Chromium, driven by its DevTools protocol over viser's web sockets."""

import base64
from contextlib import contextmanager, ExitStack
import io
import json
from pathlib import Path
import queue
import shutil
import subprocess
import tempfile
import threading
import time

import matplotlib.image
import numpy as np
from websockets.sync.client import connect

CHROMIUM = next(filter(None, map(shutil.which, ('chromium', 'chromium-browser',
                                                'google-chrome'))), None)
FLAGS = ('--headless=new', '--no-sandbox', '--disable-dev-shm-usage', '--no-first-run',
         '--disable-background-networking', '--disable-component-update',
         '--hide-scrollbars',
         '--use-gl=angle', '--use-angle=swiftshader', '--enable-unsafe-swiftshader',
         '--remote-debugging-port=0', '--window-size=1100,650')


@contextmanager
def browser(url):
    """Give a page in a browser of its own."""
    with ExitStack() as ending:
        folder = ending.enter_context(
            tempfile.TemporaryDirectory(ignore_cleanup_errors=True))
        process = ending.enter_context(subprocess.Popen(
            [CHROMIUM, *FLAGS, f'--user-data-dir={folder}', 'about:blank'],
            stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True))
        lines = queue.Queue()
        reader = threading.Thread(
            target=lambda: [lines.put(line) for line in process.stderr], daemon=True)
        reader.start()
        ending.callback(reader.join)
        ending.callback(process.terminate)
        line = ''
        while 'DevTools listening on' not in line:
            line = lines.get(timeout=30)
        yield Page(ending.enter_context(connect(line.split()[-1], max_size=None)), url)


class Page:
    """A page, its errors and what it asked for."""

    def __init__(self, socket, url):
        self._socket = socket
        self._count = 0
        self._session = None
        self.errors = []
        self.requests = []
        target = self.call('Target.createTarget', url='about:blank')['targetId']
        self._session = self.call('Target.attachToTarget', targetId=target,
                                  flatten=True)['sessionId']
        for domain in ('Runtime', 'Log', 'Network', 'Page'):
            self.call(f'{domain}.enable')
        self.call('Page.navigate', url=url)

    def call(self, method, **parameters):
        """Send a command and return its result; events are kept or dropped."""
        self._count += 1
        message = {'id': self._count, 'method': method, 'params': parameters}
        self._socket.send(json.dumps({**message, **(
            {'sessionId': self._session} if self._session else {})}))
        while True:
            answer = json.loads(self._socket.recv(timeout=60))
            if answer.get('id') == self._count:
                assert 'error' not in answer, answer
                return answer['result']
            self._note(answer.get('method'), answer.get('params', {}))

    def evaluate(self, expression):
        """Return the value of a JavaScript expression."""
        result = self.call('Runtime.evaluate', expression=expression, returnByValue=True)
        return result['result'].get('value')

    def wait(self, expression, seconds=30.0):
        """Return as soon as an expression is true."""
        end = time.monotonic() + seconds
        while not self.evaluate(f'!!({expression})'):
            assert time.monotonic() < end, f'never true: {expression}; {self.errors}'
            time.sleep(0.1)

    def press(self, key):
        """Press a key and let it go."""
        for kind in ('keyDown', 'keyUp'):
            self.call('Input.dispatchKeyEvent', type=kind, key=key, code=key,
                      windowsVirtualKeyCode={'End': 35, 'Home': 36}[key])

    def picture(self, path=None):
        """Return what the page looks like, (height, width, 3) from 0 to 1."""
        data = base64.b64decode(
            self.call('Page.captureScreenshot', format='png')['data'])
        if path:
            Path(path).write_bytes(data)
        return np.asarray(matplotlib.image.imread(io.BytesIO(data)))[..., :3]

    def _note(self, method, parameters):
        if method == 'Runtime.exceptionThrown':
            self.errors.append(parameters['exceptionDetails'])
        elif method == 'Log.entryAdded' and parameters['entry']['level'] == 'error':
            self.errors.append(parameters['entry'])
        elif method == 'Runtime.consoleAPICalled' and parameters['type'] == 'error':
            self.errors.append(parameters['args'])
        elif method == 'Network.requestWillBeSent':
            self.requests.append(parameters['request']['url'])
