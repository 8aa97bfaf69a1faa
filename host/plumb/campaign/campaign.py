"""A campaign from its study to its results: what is kept, what is still to be run, who runs it."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from plumb.boards.preconditions import require_boards
from plumb.campaign import batch as batches
from plumb.campaign import statistics, workers
from plumb.campaign.batch import Batch
from plumb.campaign.folder import Folder, differences
from plumb.campaign.study import CHOSEN, Study
from plumb.campaign.workers import Task
from plumb.errors import UsageError

ALONE_SAMPLES = 200_000
"""A campaign of fewer samples is over before a further process has begun."""


@dataclass(frozen=True)
class Where:
    """workers: processes on this machine; None: as many as it has cores. scheduler: address of a Dask scheduler
    instead. out: the folder that keeps every batch; None: nothing is kept. resume: go on with the one that is there."""

    workers: int | None = None
    scheduler: str | None = None
    out: Path | None = None
    resume: bool = False


def run(study: Study, where: Where, done: Callable[[int], object] = lambda runs: None) -> Iterator[Batch]:
    """Every batch of a study, in the order in which they are finished; those that are kept come first. done: called
    with the number of runs of each.

    Raises UsageError for a folder of another campaign, a full disk, a cluster of another version; LinkError for a
    scheduler that does not answer.
    """
    if where.resume and where.out is None:
        raise UsageError("--resume goes on with a folder: name it with --out")
    if study.confirm is not None and where.scheduler is None:
        require_boards([study.confirm], Path(study.image) if study.image is not None else None)
    identity, (size, steps) = batches.identity(study), batches.layout(study)
    tasks = [
        (number, range(begin, min(begin + size, study.runs))) for number, begin in enumerate(range(0, study.runs, size))
    ]
    with contextlib.ExitStack() as ending:
        folder = Folder(where.out, study, identity, size) if where.out is not None else None
        if folder is not None:
            ending.callback(folder.end)
            folder.begin(resume=where.resume)
        yield from _batches(study, where, tasks, folder, identity, steps, done)


def _batches(
    study: Study,
    where: Where,
    tasks: Sequence[Task],
    folder: Folder | None,
    identity: Mapping[str, object],
    steps: int,
    done: Callable[[int], object],
) -> Iterator[Batch]:
    """Those that are kept, then those that are run."""
    left: list[Task] = []
    for number, indices in tasks:
        kept = folder.batch(number, indices) if folder is not None and where.resume else None
        if kept is None:
            left.append((number, indices))
        else:
            done(len(indices))
            yield kept
    alike = not any(factor.name in CHOSEN for factor in study.vary)
    for number, found in _chosen(study, where, left, steps):
        if found.identity != identity:
            odd = differences(found.identity, identity)
            raise UsageError(f"a worker is of another version ({odd}): install the same plumb on it and start it again")
        if folder is not None:
            folder.keep(number, found)
        if alike and found.metrics:  # a limit without a figure is reported before the other batches are run
            statistics.check_limits(study.limits, found.metrics)
        done(len(found.index))
        yield found


def _chosen(study: Study, where: Where, left: list[Task], steps: int) -> Iterator[tuple[int, Batch]]:
    if where.scheduler is not None:
        from plumb.campaign import cluster

        return cluster.on_cluster(study, left, where.scheduler)
    small = steps * sum(len(indices) for _, indices in left) < ALONE_SAMPLES
    wanted = min(where.workers or (1 if small else workers.cores()), len(left))
    return workers.in_processes(study, left, wanted) if wanted > 1 else workers.in_this_process(study, left)
