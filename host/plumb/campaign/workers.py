"""Workers that run the batches of a campaign: this process, processes on all cores, or the workers of a Dask cluster.

Each is a function of numbered batches that gives (number, Batch) as they are finished, in any order.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool

from plumb.campaign.batch import Batch, run_batch
from plumb.campaign.study import Study
from plumb.errors import PlumbError

Task = tuple[int, range]
"""Number of a batch, and the indices of its runs."""
AHEAD = 2
"""Batches that wait for each worker: enough to keep it busy, few enough to keep memory flat."""
ATTEMPTS = 3
"""A batch whose process dies so often is given up."""


def cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def in_this_process(study: Study, tasks: Sequence[Task]) -> Iterator[tuple[int, Batch]]:
    for number, indices in tasks:
        yield number, run_batch(study, indices)


def _begin_worker() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent handles Ctrl-C
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """A worker whose parent was killed would wait for a batch for ever: it has both ends of the queue itself."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


@contextlib.contextmanager
def _without_script() -> Iterator[None]:
    """A spawned process imports the script that the user runs, and a script without a guard would begin its campaign
    again in every worker. A batch needs nothing of it: while processes begin, the script has no file."""
    script: dict[str, object] = sys.modules["__main__"].__dict__
    kept: dict[str, object] = {name: script.pop(name) for name in ("__file__", "__spec__") if name in script}
    script["__spec__"] = None
    try:
        yield
    finally:
        script.update(kept)


def in_processes(study: Study, tasks: Sequence[Task], workers: int) -> Iterator[tuple[int, Batch]]:
    """On this machine. A process that dies loses its batch, which is run again. Raises PlumbError for a batch that
    kills its process every time."""
    left, died = list(reversed(tasks)), dict.fromkeys((number for number, _ in tasks), 0)
    while left:
        waiting: dict[Future[Batch], Task] = {}
        pool = ProcessPoolExecutor(workers, multiprocessing.get_context("spawn"), initializer=_begin_worker)
        try:
            while left or waiting:
                while left and len(waiting) < AHEAD * workers:
                    task = left.pop()
                    with _without_script():
                        waiting[pool.submit(run_batch, study, task[1])] = task
                for future in wait(waiting, return_when=FIRST_COMPLETED).done:
                    found = future.result()
                    yield waiting.pop(future)[0], found
        except BrokenProcessPool:
            for number, indices in waiting.values():
                died[number] += 1
                if died[number] >= ATTEMPTS * AHEAD:
                    raise PlumbError(
                        f"the process of runs {indices.start} to {indices.stop - 1} was killed again and again: "
                        "is there enough memory?"
                    ) from None
            left += [*waiting.values()]
        except BaseException:  # also GeneratorExit: nobody wants the batches that are being run
            for process in list((getattr(pool, "_processes", None) or {}).values()):
                process.terminate()
            raise
        finally:
            pool.shutdown(cancel_futures=True)
