"""Devices fitted by Dask workers, on this machine or others; workers see the folders of data and
runs under the same paths.
"""

import threading
from collections.abc import Generator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from calibkit.errors import UsageError
from calibkit.fleet import device
from calibkit.fleet.device import DeviceTask, Outcome
from calibkit.libraries.extras import install_hint
from calibkit.records.version import __version__

PATIENCE_S = 15
"""How long a scheduler, then a first worker, is waited for."""

_one_device = threading.Lock()


def fit_devices(plan: DeviceTask, serials: Sequence[str], address: str) -> Generator[Outcome]:
    """Outcome of each device as it is finished, in any order.

    Raises UsageError for a scheduler that is not there, has no workers, or has workers that cannot
    do the work.
    """
    try:
        from distributed import Client, as_completed
    except ImportError:
        raise UsageError("--cluster needs Dask", hint=install_hint("cluster")) from None
    try:
        client = Client(address, timeout=PATIENCE_S, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:  # TypeError: tls:// without certificates
        raise UsageError(
            f"--cluster {address}: no scheduler there: {error}",
            hint="start `dask scheduler`; for tls:// name the certificates in Dask's configuration",
        ) from None
    with client:
        _require_able_workers(client, plan, address)
        futures = client.map(partial(_outcome, plan), serials, pure=False)
        serials_by_key = {
            future.key: serial for future, serial in zip(futures, serials, strict=True)
        }
        try:
            for future in as_completed(futures, loop=client.loop):
                # the scheduler gives the device of a lost worker to another one, a few times, and
                # then calls it an error
                serial = serials_by_key[future.key]
                yield device.Failure.lost(serial) if future.status == "error" else future.result()
                future.release()
        finally:
            client.cancel(futures)


def _outcome(plan: DeviceTask, serial: str) -> Outcome:
    """One device; the threads of a worker take turns, because figures are drawn with settings that
    threads share.
    """
    with _one_device:
        return device.fit_device(plan, serial)


def _require_able_workers(client: Any, plan: DeviceTask, address: str) -> None:  # noqa: ANN401 (Dask has no types)
    """Refuse a cluster with a worker that has another calibkit or does not see the folders."""
    try:
        client.wait_for_workers(1, timeout=PATIENCE_S)
    except TimeoutError:
        raise UsageError(
            f"--cluster {address}: has no workers", hint=f"start `dask worker {address}`"
        ) from None
    # a dry run makes no folder for runs
    folders = [str(plan.data)] if plan.dry_run else [str(plan.data), str(plan.out)]
    for name, (version, unseen) in sorted(client.run(_describe_worker, folders).items()):
        if version != __version__:
            raise UsageError(
                f"--cluster {address}: worker {name} has calibkit {version}, here is {__version__}",
                hint="install the same version",
            )
        if unseen:
            raise UsageError(
                f"--cluster {address}: worker {name} sees no folder {unseen[0]}",
                hint=(
                    "--data and --out must be the same folders under the same path on every worker"
                ),
            )


def _describe_worker(folders: list[str]) -> tuple[str, list[str]]:
    """Version of this worker's calibkit, and the folders that it does not see."""
    return __version__, [folder for folder in folders if not Path(folder).is_dir()]
