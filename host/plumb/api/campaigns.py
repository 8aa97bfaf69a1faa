"""`plumb.runs`: a campaign from Python, run by run as they are finished, or as a table."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from plumb.api import arguments
from plumb.campaign import campaign, report, statistics, study
from plumb.campaign.batch import Batch, identity
from plumb.campaign.results import Results
from plumb.errors import UsageError


class Runs:
    """The runs of a campaign, which begins when they are first asked for.

    Iterating gives a dict for each run as its batch is finished: index, seed, steps, digest (CRC-32 over the records of
    its steps), error (None, or why it failed), then what is varied and the metrics by name. `table`, `figures` and
    `to_pandas` wait for all runs.
    """

    def __init__(self, declared: study.Study, where: campaign.Where) -> None:
        self._study, self._where = declared, where
        self._batches: list[Batch] = []
        self._coming: Iterator[Batch] | None = None
        self._results: Results | None = None

    def __repr__(self) -> str:
        return f"<Runs of {self._study.system}: {self._study.runs} from seed {self._study.first_seed} on>"

    def __len__(self) -> int:
        return self._study.runs

    def __iter__(self) -> Iterator[dict[str, Any]]:  # Any: columns of several types
        for batch in self._all():
            yield from Results([batch]).rows()

    def _all(self) -> Iterator[Batch]:
        yield from list(self._batches)
        if self._coming is None:
            self._coming = campaign.run(self._study, self._where)
        for batch in self._coming:
            self._batches.append(batch)
            yield batch

    def _whole(self) -> Results:
        if self._results is None:
            for _ in self._all():
                pass
            self._results = Results(self._batches)
        return self._results

    def table(self) -> dict[str, Any]:  # Any: columns of several types
        """Column name -> values of all runs, in the order of their seeds; metrics as arrays (runs,), NaN where a run
        has no such figure."""
        return self._whole().columns()

    def to_pandas(self) -> Any:  # Any: columns of several types
        """The table as a DataFrame; raises UsageError where pandas is not installed."""
        return self._whole().to_pandas()

    @property
    def figures(self) -> dict[str, dict[str, float | int]]:
        """Metric -> mean, low and high (the 95 % interval of the mean), runs, sd, min, p05, median, p95, max."""
        return statistics.to_json(statistics.figures(self._whole()))

    def write_report(self, folder: Path | str) -> None:
        """Write report.html, summary.json and runs.parquet (runs.csv without pyarrow) into a folder. Raises UsageError
        for a folder that cannot be written."""
        from plumb.campaign.folder import ADVICE
        from plumb.files import whole_files

        place = arguments.path_of("folder", folder)
        said = report.of(self._study, self._whole(), identity(self._study), "plumb.runs")
        whole_files.write_whole({place / name: content for name, content in said.files().items()}, ADVICE)


def runs(
    system: str | Path,
    *,
    runs: int | None = None,
    first_seed: int | None = None,
    seconds: float | None = None,
    scenario: str | None = None,
    tuning: str | None = None,
    start: str | None = None,
    faults: Sequence[str] = (),
    conditions: Mapping[str, float] | None = None,
    vary: Mapping[str, object] | None = None,
    recordings: Path | str | None = None,
    draw: str | None = None,
    open_loop: bool = False,
    reference: bool = False,
    workers: int | None = None,
    scheduler: str | None = None,
    out: Path | str | None = None,
    resume: bool = False,
) -> Runs:
    """Thousands of runs of a system, on all cores or on a cluster: `plumb campaign`.

    Args:
        system: Name of a system, or a study: a path, or a text that ends in .toml.
        runs: Runs in all; None: the study's, else 400.
        first_seed: Seed of the first run; None: the study's, else 1000.
        seconds: Length of a run, 1 to 3600 s; None: the scenario's own.
        scenario: Name of a scenario; None: the system's default.
        tuning: Name of a tuning; None: that of the scenario.
        start: Start-up mode of the filter instead of the tuning's own.
        faults: Faults of every run as text, as for `plumb.run`.
        conditions: Conditions of every run by name.
        vary: What differs from run to run: `scenario`, `tuning`, `start`, `faults`, `condition.NAME`, `tuning.PATH`, or
            on recordings `recording` (files) and `grade` (errors, as `plumb compare` names them) -> a list of choices,
            or `{"low": .., "high": .., "log": ..}`.
        recordings: Folder of the recordings; None: the study's, else that of PLUMB_DATA.
        draw: `grid`, `random` or `latin-hypercube`; None: the study's, else `grid`.
        open_loop: Prescribed motion: the outputs move nothing.
        reference: Compare every run with the float64 reference, too.
        workers: Processes; None: one for each core.
        scheduler: Address of a Dask scheduler, `tcp://HOST:PORT`, instead of processes.
        out: Folder that keeps every batch as soon as it is done.
        resume: Go on with the campaign in that folder.

    Raises:
        UsageError: A name that does not exist, a study that cannot be run.
        LinkError: The scheduler does not answer.
    """
    arguments.require_whole(
        **{name: value for name, value in (("runs", runs), ("first_seed", first_seed)) if value is not None}
    )
    arguments.require_number(seconds=seconds)
    given = str(system)
    declared = study.read(Path(given)).to_json() if given.endswith(".toml") else {"system": given}
    asked: dict[str, Any] = {  # Any: columns of several types
        "runs": runs, "first_seed": first_seed, "seconds": seconds, "scenario": scenario, "tuning": tuning,
        "start": start, "draw": draw, "vary": vary, "conditions": conditions, "faults": list(faults) or None,
        "open_loop": open_loop or None, "reference": reference or None,
        "recordings": None if recordings is None else str(Path(recordings).absolute()),
    }  # fmt: skip
    table = {name: value for name, value in {**declared, **_given(asked)}.items() if value is not None}
    if resume and out is None:
        raise UsageError("resume=True goes on with a folder: name it with out=...")
    where = campaign.Where(workers, scheduler, arguments.optional_path_of("out", out), resume)
    return Runs(study.from_table(table, given if given.endswith(".toml") else None), where)


def _given(values: Mapping[str, Any]) -> dict[str, Any]:  # Any: columns of several types
    return {name: value for name, value in values.items() if value is not None}
