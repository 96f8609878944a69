"""Local pages over run folders: what they show, what they never show, and how fast they are."""

import http.client
import json
import os
import signal
import subprocess
import sys
import threading
import time

import pytest

from calibkit.errors import CoefficientError
from calibkit.viewer import index
from calibkit.viewer.server import RunPages, Server
from conftest import ROOT
from kept import LIMITED, RECIPES, keep, model, rate_table


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Folder of runs: a gyro over four years, one device with marks in its texts, one that was
    changed.
    """
    folder = tmp_path_factory.mktemp("served")
    text = (RECIPES / "rate_table.toml").read_text(encoding="utf-8")
    recipe = text.replace("[acceptance]", LIMITED)
    for k in range(4):
        made = rate_table(1e4 * (1.0 + 8e-6 * k), 0.02)
        keep(folder, made, serial="GY-1", date=f"{2021 + k}-06-01", recipe=recipe)
    evil = "<script>alert(1)</script>"
    plain = model({"K": (1.0, "1", 0.1)}, name=evil)
    keep(folder, plain, serial="陀螺-7", logs=(evil,), verdict="rejected")
    changed = keep(folder, plain, serial="CHANGED")
    report = changed / "report.txt"
    report.write_text("another text\n", encoding="utf-8")
    return folder


@pytest.fixture(scope="module")
def served(runs, tmp_path_factory):
    """Running server and the function that asks it."""
    cache = tmp_path_factory.mktemp("cache")
    with Server(RunPages(runs, cache), 0) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()

        def ask(path, *, method="GET", host=None):
            connection = http.client.HTTPConnection("127.0.0.1", server.server_port, timeout=60)
            connection.putrequest(method, path, skip_host=True, skip_accept_encoding=True)
            own = f"127.0.0.1:{server.server_port}" if host is None else host
            connection.putheader("Host", own)
            connection.endheaders()
            answer = connection.getresponse()
            body = answer.read()
            connection.close()
            return answer.status, body.decode("utf-8", "replace"), dict(answer.getheaders())

        ask.server = server
        yield ask
        server.shutdown()


def test_a_device_shows_its_answer_its_runs_and_its_key_values(served):
    """The two newest runs are compared; values over the years are drawn."""
    status, text, _ = served("/device/GY-1")
    assert status == 200
    assert "Still good: scale factor of gyro x changed by 8.0" in text
    assert text.count("<svg") == 1
    assert "Key values over the years" in text
    status, text, _ = served("/compare/GY-1?old=r001&new=r004")
    assert (status, text.count("<svg")) == (200, 1)
    assert "Cannot tell" in text or "Still good" in text
    assert served("/compare/GY-1?old=r001&new=r009")[0] == 404


def test_what_a_run_states_of_itself_is_never_markup(served):
    """Names of logs, models and recipes are escaped."""
    status, text, _ = served("/run/%E9%99%80%E8%9E%BA-7/r001")
    assert status == 200
    assert "&lt;script&gt;alert(1)&lt;/script&gt;" in text
    assert "<script" not in text
    assert "<script" not in served("/device/%E9%99%80%E8%9E%BA-7")[1]
    assert "<script" not in served("/?q=%3Cscript%3E")[1]


@pytest.mark.parametrize(
    "path",
    [
        "/run/GY-1/r001/../../../etc/passwd",
        "/run/GY-1/r001/..%2f..%2fsecret.txt",
        "/run/GY-1/r001/%2e%2e/r002/run.json",
        "/run/GY-1/r001/report.txt%00.html",
        "/run/..%2fGY-1/r001/run.json",
        "/run/../secret.txt",
        "/device/..",
        "/device/",
        "/run/GY-1/r001/secret.txt",
        "/run/LINK/r001/run.json",
        "/run/GY-1/r099",
        "//etc/passwd",
        "http://elsewhere/",
        "/" + "a/" * 5000,
    ],
)
def test_nothing_outside_the_listed_files_of_a_run_is_served(served, runs, path):
    """Neither by dots, encoded or not, nor by links, nor by names that a run.json does not list."""
    secret = runs.parent / "secret.txt"
    secret.write_text("SECRET", encoding="utf-8")
    if not (runs / "LINK").is_symlink():
        (runs / "LINK").symlink_to(runs / "GY-1", target_is_directory=True)
    status, text, _ = served(path)
    assert (status, "SECRET" in text, "root:" in text) in {
        (404, False, False),
        (414, False, False),
        (200, False, False),
    }
    if status == 200:  # a file of the run itself, however it was written
        assert path == "/run/GY-1/r001/report.txt/"
        assert text == "hello\n"


@pytest.mark.skipif(os.name != "posix", reason="needs pipes")
@pytest.mark.parametrize("file", ["run.json", "report.txt", "drift.json"])
def test_a_pipe_in_the_place_of_a_file_does_not_hold_the_pages(tmp_path, file):
    """The run is refused in one line, and the list of devices is still shown."""
    folder = keep(tmp_path / "runs", model({"K": (1.0, "1", 0.1)}), serial="P", stage="drift")
    (folder / file).unlink()
    os.mkfifo(folder / file)
    site = RunPages(tmp_path / "runs", tmp_path / "cache")
    assert "P" in site.answer("/", {}).content.decode()
    with pytest.raises(CoefficientError, match="a pipe or a device"):
        site.answer("/run/P/r001", {})


def test_a_run_that_was_changed_is_not_shown(served):
    """Its page names the file whose digest is wrong."""
    status, text, _ = served("/run/CHANGED/r001/report.txt")
    assert status == 409
    assert "another text" not in text
    assert "not the file that run.json lists" in text


@pytest.mark.parametrize("host", ["", "evil.example", "127.0.0.1", "127.0.0.1:1", "localhost.evil"])
def test_another_host_is_refused(served, host):
    """A name that somebody else's server points here (DNS rebinding) gets nothing."""
    status, text, _ = served("/", host=host)
    assert status == 421
    assert "GY-1" not in text
    port = served.server.server_port
    assert served("/", host=f"localhost:{port}")[0] == 200


def test_the_server_reads_and_never_writes(served, runs):
    """Other methods are not implemented; requests leave the folder as it is."""
    before = sorted((str(path), path.lstat().st_mtime_ns) for path in runs.rglob("*"))
    for method in ("POST", "PUT", "DELETE", "PATCH", "OPTIONS", "TRACE"):
        assert served("/", method=method)[0] == 501
    status, text, headers = served("/", method="HEAD")
    assert (status, text) == (200, "")
    assert int(headers["Content-Length"]) > 1000
    assert sorted((str(path), path.lstat().st_mtime_ns) for path in runs.rglob("*")) == before


# the index


def many(folder, devices=250, revisions=4):
    """Run folders with a run.json of real size, whose digests nobody has checked yet."""
    run = keep(folder / "one", model({"K": (1.0, "1", 0.1)}), verdict="accepted")
    document = json.loads((run / "run.json").read_text(encoding="utf-8"))
    document["recipe"]["text"] = "# recipe\n" * 600
    for d in range(devices):
        for r in range(1, revisions + 1):
            made = folder / "runs" / f"GYRO-{d:04d}" / f"r{r:03d}"
            made.mkdir(parents=True)
            own = {"serial": f"GYRO-{d:04d}", "revision": r, "effective_from": f"20{20 + r}-01-01"}
            (made / "run.json").write_text(json.dumps({**document, **own}), encoding="utf-8")
    return folder / "runs"


def test_a_thousand_runs_are_read_in_one_second(tmp_path):
    """Without a cache, and with one; processor time, for the test machine does other work."""
    runs = many(tmp_path)
    times = []
    for _ in range(2):
        start = time.process_time()
        found = index.read_index(runs, tmp_path / "cache")
        times.append(time.process_time() - start)
        assert sum(map(len, found.values())) == 1000
    assert max(times) < 1.0


# the command and the browser


def test_the_command_serves_until_it_is_stopped(runs, tmp_path):
    """It prints its address, answers there, and ends with 0 at Ctrl-C; an unknown serial is 2."""
    environment = os.environ | {"PYTHONPATH": str(ROOT), "XDG_CACHE_HOME": str(tmp_path)}
    call = [sys.executable, "-m", "calibkit", "open", "--runs", str(runs), "--json"]
    with subprocess.Popen(call, stdout=subprocess.PIPE, text=True, env=environment) as process:
        text = "".join(process.stdout.readline() for _ in range(4))
        url = json.loads(text)["url"]
        port = int(url.rstrip("/").rpartition(":")[2])
        connection = http.client.HTTPConnection("127.0.0.1", port, timeout=60)
        connection.request("GET", "/")
        assert connection.getresponse().status == 200
        process.send_signal(signal.SIGINT)
        try:
            assert process.wait(timeout=60) == 0
        finally:
            process.kill()
    unknown = subprocess.run([*call, "NOBODY"], capture_output=True, check=False, env=environment)
    assert unknown.returncode == 2
