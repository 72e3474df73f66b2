"""A Dask cluster of processes of its own: a scheduler and workers that can be killed."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from pathlib import Path
from types import TracebackType
from typing import Any, Self


class Cluster:
    """A scheduler and workers, each a process; `workers` by name."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.workers: dict[str, subprocess.Popen[bytes]] = {}
        self.port = "0"
        self.start_scheduler()

    def start_scheduler(self) -> None:
        """Start it; a second time at the address of the first."""
        file = self.folder / f"scheduler-{time.monotonic_ns()}.json"
        words = ["--host", "127.0.0.1", "--port", self.port, "--no-dashboard", "--scheduler-file", str(file)]
        self.scheduler = self._start("scheduler", words)
        until = time.monotonic() + 60
        while not (file.exists() and file.read_text()):
            assert time.monotonic() < until, "no scheduler"
            time.sleep(0.05)
        self.address: str = json.loads(file.read_text())["address"]
        self.port = self.address.rpartition(":")[2]

    def start_worker(self, name: str, *words: str) -> None:
        """Start a worker of one thread, which nobody starts again when it dies."""
        common = ["--no-nanny", "--nthreads", "1", "--no-dashboard", "--name", name, "--memory-limit", "0"]
        folder = ["--local-directory", str(self.folder)]
        self.workers[name] = self._start("worker", [self.address, *common, *folder, *words])

    def kill(self, name: str) -> None:
        """As `kill -9` does."""
        process = self.workers.pop(name)
        process.kill()
        process.wait()

    def _start(self, what: str, words: list[str]) -> subprocess.Popen[bytes]:
        environment = {**os.environ, "DASK_DISTRIBUTED__WORKER__PROFILE__ENABLED": "false"}
        with (self.folder / f"{what}.log").open("ab") as log:
            return subprocess.Popen(
                [sys.executable, "-m", f"distributed.cli.dask_{what}", *words],
                stdout=log,
                stderr=log,
                env=environment,
            )

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for process in [*self.workers.values(), self.scheduler]:
            process.kill()
        for process in [*self.workers.values(), self.scheduler]:
            process.wait()


def client_of(cluster: Cluster) -> Any:
    """A client of a cluster."""
    from distributed import Client

    return Client(cluster.address, timeout=20, set_as_default=False)
