"""Fleets on Dask workers: a real scheduler and two workers on loopback, one of which is killed."""

import json
import os
import signal
import subprocess
import sys
import time

import pytest

from calibkit import recipe
from calibkit.errors import UsageError
from calibkit.fleet import cluster, device
from cli.fleet_units import DAY, RECIPE, fit, fleet_logs, tree
from conftest import ROOT

distributed = pytest.importorskip("distributed", reason="the extra 'cluster' is not installed")
PATIENCE_S = 120.0


def until(condition, *processes):
    """Wait until something is so, while the processes that should make it so are alive."""
    end = time.monotonic() + PATIENCE_S
    while not condition():
        assert all(process.poll() is None for process in processes), (
            "a process of the cluster ended"
        )
        assert time.monotonic() < end, "the cluster does not come up"
        time.sleep(0.02)


@pytest.fixture
def cluster_of(tmp_path):
    """Start a scheduler with so many worker processes; return its address and the workers."""
    environment = os.environ | {"PYTHONPATH": str(ROOT), "OPENBLAS_NUM_THREADS": "1"}
    running, file = [], tmp_path / "scheduler.json"

    def start(kind, *arguments):
        command = [
            sys.executable,
            "-m",
            f"distributed.cli.dask_{kind}",
            *arguments,
            "--host",
            "127.0.0.1",
            "--no-dashboard",
        ]
        with (tmp_path / f"{kind}_{len(running)}.log").open("wb") as log:
            running.append(
                subprocess.Popen(command, cwd=tmp_path, env=environment, stdout=log, stderr=log)
            )
        return running[-1]

    def started(count):
        scheduler = start("scheduler", "--port", "0", "--scheduler-file", str(file))
        until(
            lambda: file.exists() and file.read_text(encoding="utf-8").strip().endswith("}"),
            scheduler,
        )
        address = json.loads(file.read_text(encoding="utf-8"))["address"]
        workers = [start("worker", address, "--nthreads", "1", "--no-nanny") for _ in range(count)]
        with distributed.Client(address, set_as_default=False) as client:
            until(
                lambda: len(client.scheduler_info(n_workers=-1)["workers"]) == count,
                scheduler,
                *workers,
            )
        return address, workers

    yield started
    for process in reversed(running):
        process.kill()
        process.wait()


@pytest.mark.drawn
def test_two_workers_fit_a_fleet_though_one_is_killed_and_write_what_one_process_writes(
    tmp_path, cluster_of
):
    """With one of two workers killed (-9) after two units all six are fitted once, to the same
    bytes as here.
    """
    fleet_logs(tmp_path / "units", 2)
    address, workers = cluster_of(2)

    def killing(items, what):
        for number, item in enumerate(items):
            if number == 2:
                workers[0].kill()
            yield item

    rehearsed = fit(tmp_path / "units", tmp_path / "cluster", address=address, dry_run=True)
    assert not (tmp_path / "cluster").exists()
    fleet_logs(tmp_path / "units", 6)
    done = fit(tmp_path / "units", tmp_path / "cluster", address=address, progress=killing)
    assert rehearsed.table.entries == done.table.entries[:2]
    assert workers[0].wait() == -signal.SIGKILL
    assert {(entry.run, entry.verdict) for entry in done.table.entries} == {("r001", "no verdict")}
    fit(tmp_path / "units", tmp_path / "here")
    assert tree(tmp_path / "cluster") == tree(tmp_path / "here")


def test_a_cluster_that_cannot_do_the_work_is_refused_before_any_unit(
    tmp_path, cluster_of, monkeypatch
):
    """No scheduler, no workers, a worker with another calibkit, a worker without the folders: each
    is said as such.
    """
    monkeypatch.setattr(cluster, "PATIENCE_S", 1)
    plan = device.DeviceTask(recipe.Source("bias.toml", RECIPE), tmp_path, tmp_path, DAY)
    elsewhere = device.DeviceTask(plan.source, tmp_path / "elsewhere", tmp_path, DAY)

    def refused(plan, address, said):
        with pytest.raises(UsageError, match=said):
            list(cluster.fit_devices(plan, ["U000"], address))

    refused(plan, "tcp://127.0.0.1:1", "no scheduler there")
    refused(plan, "nonsense://x", "no scheduler there")
    empty, _ = cluster_of(0)
    refused(plan, empty, "has no workers")
    (tmp_path / "scheduler.json").unlink()
    address, _ = cluster_of(1)
    refused(elsewhere, address, r"sees no folder .*elsewhere; .*same path on every worker")
    monkeypatch.setattr(cluster, "__version__", "99")
    refused(plan, address, "has calibkit .*, here is 99")
