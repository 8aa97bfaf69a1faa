"""A Dask cluster of processes, by Dask's own two commands: its runs are those of this process, whoever dies."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from importlib.util import find_spec
from pathlib import Path

import pytest

from plumb.__main__ import main
from plumb.boards.native.core import CORE_VARIABLE, core_path
from plumb.campaign import campaign
from plumb.campaign.campaign import Where
from plumb.campaign.results import Results
from plumb.campaign.study import Study, from_table
from plumb.errors import LinkError, UsageError

pytestmark = [pytest.mark.slow, pytest.mark.skipif(find_spec("distributed") is None, reason="distributed is missing")]
STUDY = {"system": "quad", "runs": 64, "seconds": 4}


@contextmanager
def started(words: list[str], **environment: str) -> Iterator[subprocess.Popen[bytes]]:
    process = subprocess.Popen(
        [str(Path(sys.executable).parent / "dask"), *words],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env={**os.environ, **environment},
    )
    try:
        yield process
    finally:
        process.kill()
        process.wait()


@contextmanager
def scheduler(folder: Path) -> Iterator[str]:
    file = folder / "scheduler.json"
    with started(["scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", str(file)]):
        end_s = time.monotonic() + 60.0
        while not file.exists() and time.monotonic() < end_s:
            time.sleep(0.1)
        yield json.loads(file.read_text(encoding="utf-8"))["address"]


def worker(address: str) -> list[str]:
    return ["worker", address, "--host", "127.0.0.1", "--nthreads", "1", "--no-dashboard", "--no-nanny"]


def rows(study: Study, where: Where) -> list[dict[str, object]]:
    return list(Results(campaign.run(study, where)).rows())


def test_a_worker_that_dies_and_one_that_joins_late_change_nothing(tmp_path: Path) -> None:
    study = from_table(STUDY)
    alone = rows(study, Where(workers=1))
    with scheduler(tmp_path) as address, ExitStack() as late, started(worker(address)) as first:
        batches = campaign.run(study, Where(scheduler=address))
        found = [next(batches)]
        late.enter_context(started(worker(address)))
        first.kill()
        found += list(batches)
    assert list(Results(found).rows()) == alone


def test_a_worker_of_another_version_is_refused_in_a_sentence(tmp_path: Path) -> None:
    other = tmp_path / "other_core.so"
    shutil.copy(core_path(), other)
    with other.open("ab") as file:
        file.write(b"\0")
    with (
        scheduler(tmp_path) as address,
        started(worker(address), **{CORE_VARIABLE: str(other)}),
        pytest.raises(UsageError, match=r"worker tcp\S+ is of another version .core_sha256 \S+, here \S+.: install"),
    ):
        rows(from_table(STUDY), Where(scheduler=address))


def test_a_scheduler_that_is_not_there_is_one_sentence(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["campaign", "quad", "--runs", "4", "--seconds", "2", "--scheduler", "tcp://127.0.0.1:1"]) == 3
    said = capsys.readouterr().err
    assert "no Dask scheduler answers at tcp://127.0.0.1:1" in said and said.count("\n") == 1


@pytest.mark.parametrize("address", ["foo", "localhost:8786", "http://[::1", "tcp://127.0.0.1:x", "tcp://a b:1"])
def test_an_address_that_is_none_is_one_sentence(address: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["campaign", "quad", "--runs", "4", "--seconds", "2", "--scheduler", address]) == 2
    assert capsys.readouterr().err == f"plumb: '{address}' is no address of a Dask scheduler: write tcp://HOST:PORT\n"


def test_a_scheduler_without_workers_is_one_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from plumb.campaign import cluster

    monkeypatch.setattr(cluster, "WORKERS_S", 0.5)
    with scheduler(tmp_path) as address, pytest.raises(LinkError, match="no worker has joined"):
        rows(from_table(STUDY), Where(scheduler=address))
