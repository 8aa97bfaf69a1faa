"""Run a stretch of a study's runs in this process: the same steps as `plumb run --board native`, without the integer
model.

An open loop gives all samples to the core in one call; a closed one runs core and plant in C, or step by step where the
plant is in Python alone. Only one run is in memory at a time, but for those that a reference or a board confirms.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from plumb import systems
from plumb.boards import open_board
from plumb.boards.contract import Answer
from plumb.boards.native import core as native_core
from plumb.boards.native import plant as native_plant
from plumb.campaign import recorded
from plumb.campaign.recorded import RecordedRequest
from plumb.campaign.study import Study
from plumb.campaign.violated import Violated, judged, violated_by
from plumb.contract import disturbance, run_reference
from plumb.contract.parameters import ControlParams
from plumb.errors import PlumbError, UsageError
from plumb.physics.sensors import Push
from plumb.proof import runs, scenario_run
from plumb.proof.invariants import Violation
from plumb.proof.run_identity import image_of
from plumb.proof.runs import PLOTS, Run, RunInputs
from plumb.proof.scenario_run import Drawn, RunRequest
from plumb.spec.arrays import FloatArray
from plumb.spec.records import Words
from plumb.systems.compiled_plants import COMPILED
from plumb.version import installed

SAMPLES = 400_000
"""Samples of a batch, about: 133 runs of 60 s at 50 Hz."""
BATCH_MOST = 256
PIECES = 16
"""A small campaign has so many batches at least, so that all cores have work."""


@dataclass
class Batch:
    """Results of some runs, a list entry for each, in the order of their indices.

    digest: CRC-32 over the records of all steps, None for a run that failed. error: why a run failed, None for one that
    did not. values: of the factors, by name. metrics: by name, None where a run has no such figure. identity: of the
    part that ran them. violations: of the invariants, in no order of runs: most have none.
    """

    identity: dict[str, object]
    index: list[int] = field(default_factory=list)
    seed: list[int] = field(default_factory=list)
    steps: list[int] = field(default_factory=list)
    digest: list[int | None] = field(default_factory=list)
    error: list[str | None] = field(default_factory=list)
    values: dict[str, list[Any]] = field(default_factory=dict)  # Any: columns of several types
    metrics: dict[str, list[float | None]] = field(default_factory=dict)
    violations: list[Violated] = field(default_factory=list)

    def add(
        self,
        study: Study,
        index: int,
        run: Run | None,
        error: str | None,
        metrics: dict[str, Any],  # Any: by column
    ) -> None:
        before = len(self.index)
        self.index.append(index)
        self.seed.append(study.seed(index))
        self.steps.append(len(run.inputs.raw) if run else 0)
        self.digest.append(digest_of(run.words) if run else None)
        self.error.append(error)
        for name, value in study.values(index).items():
            self.values.setdefault(name, [None] * before).append(list(value) if isinstance(value, tuple) else value)
        for name in [*self.metrics, *(name for name in metrics if name not in self.metrics)]:
            self.metrics.setdefault(name, [None] * before).append(metrics.get(name))


class Attempt(NamedTuple):
    """A run that was made, or why it failed; and the first violation of each invariant, if the study has them."""

    run: Run | None
    error: str | None
    violations: tuple[Violation, ...] = ()


_NO_DIGESTS = np.zeros(0, np.uint32)
"""No digests of steps: a campaign has the digest of the run alone."""


class _Unknown(dict[str, FloatArray]):
    """The result of a float64 reference that nobody has computed: NaN by any name."""

    def __init__(self, steps: int) -> None:
        super().__init__()
        self._steps = steps

    def __missing__(self, name: str) -> FloatArray:
        return np.full(self._steps, np.nan)


def identity(study: Study | None = None) -> dict[str, object]:
    """Everything besides its study that decides the bits of a run: native core, package, numpy, content of recordings.
    Workers whose identity differs do not run the same campaign. Raises UsageError for a recording that is not there."""
    files = study.recording_files() if study is not None else []
    version = installed()
    return {
        "plumb": version.version,
        "commit": version.commit or None,
        "core_sha256": _core_sha256(),
        "numpy": np.__version__,
        **({"recordings_sha256": recorded.content_sha256(files)} if files else {}),
    }


@cache
def _core_sha256() -> object:
    """SHA-256 of the core that this process has loaded: its file is read once, not for every batch."""
    return image_of(native_core.core_path())["sha256"]


def layout(study: Study) -> tuple[int, int]:
    """Runs of a batch, and samples of a run; they depend on the study alone, so that its batches are the same wherever
    they run. Raises UsageError for a study whose first run cannot be drawn."""
    try:
        replay = study.replay(0)
        if replay is None:
            steps = scenario_run.draw(study.request(0)).scenario.steps
        else:
            steps = len(recorded.inputs_of(replay)[0].raw)
    except (PlumbError, ValueError, ArithmeticError) as error:
        raise UsageError(f"{study.path or study.system}: run 0 cannot be drawn: {error}") from None
    return max(1, min(BATCH_MOST, SAMPLES // max(1, steps), -(-study.runs // PIECES))), steps


def run_batch(study: Study, indices: range) -> Batch:
    """Run these runs; one that fails is noted with its reason, and the others go on."""
    found = Batch(identity(study))
    if not (study.reference or study.confirm):
        for index in indices:
            _note(found, study, index, _attempt(study, index))
        return found
    attempts = [_attempt(study, index) for index in indices]
    finished = [one.run for one in attempts if one.run is not None]
    if study.reference:
        finished = _with_reference(finished)
    mismatches = _confirmed(study, finished) if study.confirm else [None] * len(finished)
    completed = iter(zip(finished, mismatches, strict=True))
    for index, attempt in zip(indices, attempts, strict=True):
        if attempt.run is None:
            _note(found, study, index, attempt)
            continue
        run, differ = next(completed)
        _note(found, study, index, attempt._replace(run=run), differ)
    return found


def _note(found: Batch, study: Study, index: int, attempt: Attempt, differ: int | None = None) -> None:
    """Add a run to its batch. differ: steps that the board which confirms gives otherwise; None: none was asked."""
    more = {} if differ is None else {"confirmed_mismatches": differ}
    found.add(study, index, attempt.run, attempt.error, {**_metrics(attempt.run, study), **more})
    if attempt.violations:
        found.violations += violated_by(study, index, attempt.violations, found.violations, run_one)


def digest_of(words: Words) -> int:
    """The digest of a run: CRC-32 over the bytes of which its steps have their digests, in order."""
    return zlib.crc32(np.ascontiguousarray(words.record).view(np.uint8).data)


def run_one(request: RunRequest) -> Run:
    """One run on the native core, without the model and the reference."""
    drawn = scenario_run.draw(request)
    inputs, words = _answer(request, drawn)
    return _run(inputs, drawn.params, words)


def run_recorded(request: RecordedRequest) -> Run:
    """The same on a recording."""
    inputs, params = recorded.inputs_of(request)
    return _run(inputs, params, native_core.run_control(params, inputs.raw, inputs.setpoint))


def _run(inputs: RunInputs, params: ControlParams, words: Words) -> Run:
    return Run(inputs, params, words, _Unknown(len(inputs.raw)), Answer(_NO_DIGESTS, words), None)


def _answer(request: RunRequest, drawn: Drawn) -> tuple[RunInputs, Words]:
    scenario, params = drawn.scenario, drawn.params
    if _compiled(request, drawn):
        answer = native_plant.closed_loop(scenario, params, open_loop=not drawn.closes)
        inputs = RunInputs(scenario.time_s, answer.truth, answer.raw, answer.setpoint, scenario.scored)
        return inputs, answer.words
    if not drawn.closes:
        inputs = runs.prescribed(scenario)
    else:
        with open_board("native") as board:
            inputs, _ = runs.closed_loop_inputs(board, scenario, params, progress=False)
    return inputs, native_core.run_control(params, inputs.raw, inputs.setpoint)


def _compiled(request: RunRequest, drawn: Drawn) -> bool:
    """Whether plant.c runs it. A prescribed motion is that without the pushes of the request, which plant.c has."""
    if not native_plant.available(request.system):
        return False
    if drawn.closes:
        return True
    if not systems.load(request.system, COMPILED).PRESCRIBES:
        return False
    asked = systems.load(request.system).faults([disturbance.parse(text) for text in request.faults])
    return not any(isinstance(fault, Push) for fault in asked)


def _attempt(study: Study, index: int) -> Attempt:
    try:
        replay = study.replay(index)
        run = run_one(study.request(index)) if replay is None else run_recorded(replay)
        return Attempt(run, None, judged(run) if study.invariants else ())
    except PlumbError as error:
        return Attempt(None, str(error))
    except Exception as error:  # a defect in one run out of thousands must not take the others with it
        return Attempt(None, f"{type(error).__name__}: {error}")


def _metrics(run: Run | None, study: Study) -> dict[str, Any]:  # Any: columns of several types
    """Figures of a run by name, without those that were not computed."""
    if run is None:
        return {}
    with np.errstate(invalid="ignore"):
        found = systems.load(run.system, PLOTS).metrics(run)
    return {
        name: None if value is None or not math.isfinite(value) else float(value)
        for name, value in found.items()
        if study.reference or not name.startswith("fixed_vs_reference")
    }


def _with_reference(finished: Sequence[Run]) -> list[Run]:
    """The runs with their float64 references: those of the same parameters and steps at once."""
    groups: dict[tuple[object, ...], list[int]] = {}
    for place, run in enumerate(finished):
        groups.setdefault((tuple(run.params.words()), len(run.inputs.raw)), []).append(place)
    found: dict[int, Run] = {}
    for places in groups.values():
        members = [finished[place] for place in places]
        for place, run, ideal in zip(places, members, _references(members), strict=True):
            found[place] = Run(run.inputs, run.params, run.words, ideal, run.answer, None)
    return [found[place] for place in range(len(finished))]


def _references(members: Sequence[Run]) -> Iterator[dict[str, FloatArray]]:
    params: ControlParams = members[0].params
    if len(members) == 1:
        yield run_reference.run_control(params, members[0].inputs.raw, members[0].inputs.setpoint)
        return
    raw = np.stack([run.inputs.raw for run in members], axis=2)
    setpoint = np.stack([run.inputs.setpoint for run in members], axis=1)
    together = run_reference.run_control(params, raw, setpoint)
    for place in range(len(members)):
        yield {name: values[:, place] for name, values in together.items()}


def _confirmed(study: Study, finished: Sequence[Run]) -> list[int | None]:
    """Steps of each run whose digests another board gives otherwise."""
    from plumb.proof.compare import count_mismatches

    assert study.confirm is not None
    image = Path(study.image) if study.image is not None else None
    with open_board(study.confirm, link=study.link, image=image) as board:
        answers = [board.run_injected(run.params, run.inputs.raw, run.inputs.setpoint) for run in finished]
    return [count_mismatches(run.words.digests(), other.digests) for run, other in zip(finished, answers, strict=True)]
