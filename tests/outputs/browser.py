"""A headless Chromium driven over its debugging pipe: no package, no port, no network."""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import subprocess
import tempfile
import time

NAMES = (
    "chromium-headless-shell",
    "chromium",
    "chromium-browser",
    "google-chrome",
    "google-chrome-stable",
)
WAIT_S = 60.0
ENDING = b"\0"


def found():
    """Path of a Chromium, or None."""
    return next(filter(None, map(shutil.which, NAMES)), None) if os.name == "posix" else None


class Browser:
    """One page: navigate, evaluate, send input; `events` holds what the browser reported."""

    def __init__(self, write, read):
        self._write, self._read, self._buffer, self._number, self.session = (
            write,
            read,
            b"",
            0,
            None,
        )
        self.events = []
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self.session = self.call("Target.attachToTarget", targetId=target, flatten=True)[
            "sessionId"
        ]
        for domain in ("Page", "Runtime", "Network", "Log", "Audits"):
            self.call(f"{domain}.enable")

    def _message(self):
        """Next message of the browser."""
        while ENDING not in self._buffer:
            part = os.read(self._read, 1 << 20)
            if not part:
                raise EOFError("the browser has ended")
            self._buffer += part
        message, _, self._buffer = self._buffer.partition(ENDING)
        return json.loads(message)

    def call(self, method, **parameters):
        """Result of one command; events that come meanwhile are kept."""
        self._number += 1
        session = {"sessionId": self.session} if self.session else {}
        message = {"id": self._number, "method": method, "params": parameters, **session}
        os.write(self._write, json.dumps(message).encode() + ENDING)
        while True:
            answer = self._message()
            if answer.get("id") != self._number:
                self.events.append(answer)
            elif "error" in answer:
                raise RuntimeError(f"{method}: {answer['error']}")
            else:
                return answer["result"]

    def open(self, path, *, width=1280, height=900, dark=False):
        """Open a file in a window of this size and wait until it has loaded."""
        self.events.clear()
        self.call(
            "Emulation.setEmulatedMedia",
            features=[{"name": "prefers-color-scheme", "value": "dark" if dark else "light"}],
        )
        self.call(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=1,
            mobile=False,
        )
        self.call("Page.navigate", url=path.resolve().as_uri())
        deadline = time.monotonic() + WAIT_S
        while not any(event.get("method") == "Page.loadEventFired" for event in self.events):
            assert time.monotonic() < deadline, "the page did not load"
            self.call("Runtime.evaluate", expression="1")

    def value(self, expression):
        """Value of a JavaScript expression."""
        answer = self.call(
            "Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True
        )
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    def mouse(self, kind, x, y, **more):
        """One mouse event."""
        self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, **more)

    def said(self):
        """What the console, the log and the auditor reported, and exceptions."""
        kinds = {
            "Runtime.consoleAPICalled",
            "Runtime.exceptionThrown",
            "Log.entryAdded",
            "Audits.issueAdded",
        }
        return [event for event in self.events if event.get("method") in kinds]

    def requests(self):
        """Addresses that the page asked for."""
        return [
            event["params"]["request"]["url"]
            for event in self.events
            if event.get("method") == "Network.requestWillBeSent"
        ]


@contextlib.contextmanager
def browser():
    """Run a Chromium and end it."""
    (child_reads, write), (read, child_writes) = os.pipe(), os.pipe()
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        options = [
            "--headless",
            "--no-sandbox",
            "--disable-gpu",
            "--disable-dev-shm-usage",
            "--remote-debugging-pipe",
        ]
        options += [
            f"--user-data-dir={profile}",
            "--no-first-run",
            "--disable-background-networking",
            "--hide-scrollbars",
        ]
        script = f'exec "$0" "$@" 3<&{child_reads} 4>&{child_writes}'
        with subprocess.Popen(
            ["bash", "-c", script, found(), *options],
            pass_fds=(child_reads, child_writes),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        ) as process:
            os.close(child_reads)
            os.close(child_writes)
            try:
                yield Browser(write, read)
            finally:
                os.close(write)  # with the pipe the browser ends, and its other processes with it
                os.close(read)
                with contextlib.suppress(subprocess.TimeoutExpired):
                    process.wait(timeout=10.0)
                process.kill()
