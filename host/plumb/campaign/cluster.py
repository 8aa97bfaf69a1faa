"""The workers of a Dask cluster run the batches: `dask scheduler` and `dask worker` are Dask's own commands.

A worker that is lost loses its batch, which Dask gives to another; one that joins late takes part. What a worker of
another version gives is refused by its identity (plumb.campaign.campaign).
"""

from __future__ import annotations

import logging
import re
from collections.abc import Iterator, Sequence
from typing import Any

from plumb.campaign.batch import Batch, identity, run_batch
from plumb.campaign.folder import differences
from plumb.campaign.study import Study
from plumb.campaign.workers import AHEAD, Task
from plumb.errors import LinkError, UsageError
from plumb.extras import required

ADDRESS = re.compile(r"(tcp|tls|ws|wss|ucx)://(\[[0-9a-fA-F:.%\w]+\]|[^\s/:\[\]]+):\d{1,5}")
"""Dask's client leaves a traceback behind when it is closed after an address that it does not know."""
CONNECT_S, WORKERS_S = 10.0, 60.0
"""Longest wait for the scheduler's answer, and for its first worker."""


def on_cluster(study: Study, tasks: Sequence[Task], address: str) -> Iterator[tuple[int, Batch]]:
    """Raises UsageError without the package, and for workers of another version; LinkError for a scheduler or workers
    that do not answer."""
    distributed = required("distributed", "distributed", "--scheduler", "campaign")
    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # its errors are reported as sentences
    if not ADDRESS.fullmatch(address):
        raise UsageError(f"'{address}' is no address of a Dask scheduler: write tcp://HOST:PORT")
    if not tasks:
        return
    try:
        client = distributed.Client(address, timeout=CONNECT_S, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        raise LinkError(
            f"no Dask scheduler answers at {address} ({_first_line(error)}): start one with `dask scheduler`"
        ) from None
    try:
        try:
            client.wait_for_workers(1, timeout=WORKERS_S)
        except (TimeoutError, OSError):
            raise LinkError(
                f"no worker has joined {address} within {WORKERS_S:g} s: start one with `dask worker {address}`"
            ) from None
        _check_versions(client, study)
        yield from _run(client, distributed, study, tasks, address)
    finally:
        client.close(timeout=2)


def _check_versions(client: Any, study: Study) -> None:  # Any: distributed has no types
    here = identity(study)
    for worker, there in client.run(identity, study, on_error="return").items():
        if isinstance(there, UsageError):
            raise UsageError(f"worker {worker} cannot run this campaign: {there}")
        if isinstance(there, BaseException):
            raise UsageError(f"worker {worker} cannot run this campaign ({_first_line(there)}): install plumb on it")
        if there != here:
            odd = differences(there, here)
            raise UsageError(f"worker {worker} is of another version ({odd}): install the same plumb on it")


def _run(
    client: Any,  # Any: dask has no types
    distributed: Any,  # Any: dask has no types
    study: Study,
    tasks: Sequence[Task],
    address: str,
) -> Iterator[tuple[int, Batch]]:
    left, numbers = list(reversed(tasks)), {}
    finished = distributed.as_completed(loop=client.loop)

    def give() -> None:
        number, indices = left.pop()
        future = client.submit(run_batch, study, indices, pure=False, retries=1)
        numbers[future.key] = number
        finished.add(future)

    try:
        while left and len(numbers) < AHEAD * max(1, sum(client.nthreads().values())):
            give()
        for future in finished:
            try:
                found = future.result()
            except distributed.scheduler.KilledWorker:
                raise LinkError("a batch has lost its worker again and again: is there enough memory?") from None
            number = numbers.pop(future.key)
            future.release()
            while left and len(numbers) < AHEAD * max(1, sum(client.nthreads().values())):
                give()
            yield number, found
    except (OSError, distributed.client.FutureCancelledError) as error:
        raise LinkError(
            f"the Dask scheduler at {address} was lost ({_first_line(error)}); what is done is kept"
        ) from None


def _first_line(error: BaseException) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0][:120]
