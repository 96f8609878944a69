"""The server: this machine alone, reading alone, and nothing outside the runs folder."""

from __future__ import annotations

import re
import threading
from dataclasses import dataclass, field
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import TYPE_CHECKING, Any
from urllib.parse import parse_qs, unquote, urlsplit

from calibkit.errors import CalibkitError, UsageError
from calibkit.viewer import pages
from calibkit.viewer.index import REVISION, SERIAL, read_index

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

ADDRESS = "127.0.0.1"
TYPES = {
    ".html": "text/html; charset=utf-8",
    ".txt": "text/plain; charset=utf-8",
    ".json": "text/plain; charset=utf-8",
    ".pdf": "application/pdf",
}
"""Suffix of a run's file → its media type; other files are not served."""
OWN = (
    "default-src 'none'; style-src 'self'; img-src 'none'; form-action 'self'; base-uri 'none';"
    " frame-ancestors 'none'"
)
REPORT = (
    "sandbox allow-scripts; default-src 'none'; style-src 'unsafe-inline'; script-src"
    " 'unsafe-inline'; form-action 'none'; base-uri 'none'; frame-ancestors 'none'"
)
"""Content security policy of a report, which has its own script: it is alone in its sandbox, and
its own policy narrows this one to that script's digest.
"""
_FILE = re.compile(r"[^\W_][\w.+-]{0,200}", re.UNICODE)
_HIDDEN = re.compile(r"%(?:2f|5c|00)|\\|\x00", re.IGNORECASE)
"""What could hide a separator in a segment of a path."""
TIMEOUT_S = 20.0


@dataclass(frozen=True, slots=True)
class _Answer:
    """What is sent."""

    content: bytes
    media_type: str = TYPES[".html"]
    policy: str = OWN
    status: HTTPStatus = HTTPStatus.OK


class _NotFoundError(Exception):
    """There is no such page."""


@dataclass(slots=True)
class RunPages:
    """Pages over one folder of runs."""

    runs: Path
    cache: Path | None = None
    drawing: threading.Lock = field(default_factory=threading.Lock)
    """Figures are drawn one after the other."""

    def answer(self, path: str, query: Mapping[str, list[str]]) -> _Answer:
        """Page of a path; raises _NotFoundError, or CalibkitError for runs that cannot be used."""
        if _HIDDEN.search(path):
            raise _NotFoundError
        segments = [unquote(part, errors="strict") for part in path.strip("/").split("/")]
        parameters = {name: values[-1] for name, values in query.items()}
        match segments:
            case [""]:
                return _Answer(pages.list_devices(read_index(self.runs, self.cache), parameters))
            case ["style.css"]:
                return _Answer(pages.style(), "text/css; charset=utf-8")
            case ["device", serial]:
                entries = self._entries(serial)
                with self.drawing:
                    return _Answer(pages.show_device(serial, entries, self.runs))
            case ["compare", serial]:
                entries = self._entries(serial)
                revisions = {entry.revision for entry in entries}
                old, new = parameters.get("old", ""), parameters.get("new", "")
                if not {old, new} <= revisions:
                    raise _NotFoundError
                with self.drawing:
                    return _Answer(pages.show_comparison(serial, entries, old, new, self.runs))
            case ["run", serial, revision, *rest] if len(rest) <= 1:
                return self._run(serial, revision, *rest)
        raise _NotFoundError

    def _entries(self, serial: str) -> list[Any]:
        """Runs of a serial."""
        entries_by_serial = read_index(self.runs, self.cache) if SERIAL.fullmatch(serial) else {}
        if serial not in entries_by_serial:
            raise _NotFoundError
        return entries_by_serial[serial]

    def _run(self, serial: str, revision: str, name: str = "") -> _Answer:
        """Page of a run, or one of the files that its run.json lists, once all digests were
        checked.
        """
        from calibkit.records import store

        if not REVISION.fullmatch(revision):
            raise _NotFoundError
        if all(entry.revision != revision for entry in self._entries(serial)):
            raise _NotFoundError
        run = store.load_revision(self.runs, serial, int(revision[1:]))
        if not name:
            return _Answer(pages.show_run(run))
        file_names = {entry["name"] for entry in run.document["files"]} | {"run.json"}
        path = run.folder / name
        suffix = path.suffix.lower()
        if not _FILE.fullmatch(name) or name not in file_names or suffix not in TYPES:
            raise _NotFoundError
        if path.is_symlink() or not path.resolve().is_relative_to(self.runs.resolve()):
            raise _NotFoundError
        return _Answer(store.read_bytes(path), TYPES[suffix], REPORT if suffix == ".html" else OWN)


class _Handler(BaseHTTPRequestHandler):
    """One request."""

    server_version, sys_version = "calibkit", ""
    protocol_version = "HTTP/1.0"
    timeout = TIMEOUT_S
    server: Server

    def do_GET(self) -> None:
        """Send a page."""
        self._send(self._answer(), with_body=True)

    def do_HEAD(self) -> None:
        """Send the head of a page."""
        self._send(self._answer(), with_body=False)

    def _answer(self) -> _Answer:
        """Page that was asked for, or why there is none."""
        port = self.server.server_port
        if self.headers.get("Host") not in {f"{ADDRESS}:{port}", f"localhost:{port}"}:
            return _refusal(HTTPStatus.MISDIRECTED_REQUEST, "This page is for this machine alone.")
        try:
            url = urlsplit(self.path)
            if url.scheme or url.netloc:
                return _refusal(HTTPStatus.NOT_FOUND, "There is no such page.")
            return self.server.site.answer(url.path, parse_qs(url.query))
        except (_NotFoundError, ValueError, OSError):
            return _refusal(HTTPStatus.NOT_FOUND, "There is no such page.")
        except CalibkitError as error:
            return _refusal(HTTPStatus.CONFLICT, str(error))

    def _send(self, answer: _Answer, *, with_body: bool) -> None:
        """Write an answer with its headers."""
        self.send_response(answer.status)
        for name, value in (
            ("Content-Type", answer.media_type),
            ("Content-Length", str(len(answer.content))),
            ("Content-Security-Policy", answer.policy),
            ("X-Content-Type-Options", "nosniff"),
            ("Referrer-Policy", "no-referrer"),
            ("Cross-Origin-Resource-Policy", "same-origin"),
            ("Cross-Origin-Opener-Policy", "same-origin"),
            ("Cache-Control", "no-store"),
        ):
            self.send_header(name, value)
        self.end_headers()
        if with_body:
            self.wfile.write(answer.content)

    def log_message(self, format: str, *arguments: Any) -> None:  # noqa: A002, ANN401 (as of the library)
        """Nothing is printed of requests."""


def _refusal(status: HTTPStatus, text: str) -> _Answer:
    """Page that states why there is none."""
    return _Answer(pages.show_message(status.phrase, text), status=status)


class Server(ThreadingHTTPServer):
    """Server on this machine's own address."""

    daemon_threads = True

    def __init__(self, site: RunPages, port: int) -> None:
        try:
            super().__init__((ADDRESS, port), _Handler)
        except (OSError, OverflowError) as error:
            raise UsageError(
                f"--port {port}: cannot be opened: {getattr(error, 'strerror', error)}",
                hint="leave --port out, and a free one is taken",
            ) from None
        self.site = site
        threading.Thread(target=pages.warm_up, daemon=True).start()

    @property
    def url(self) -> str:
        """Address of the first page."""
        return f"http://{ADDRESS}:{self.server_port}/"
