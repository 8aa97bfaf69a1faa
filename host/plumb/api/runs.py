"""`plumb.run`: a run of a system on a board, every step compared with the integer model; and its result."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
import numpy.typing as npt

from plumb.api import arguments
from plumb.api.signals import ArraySignals
from plumb.contract.parameters import ControlParams
from plumb.errors import UsageError, counted
from plumb.proof import runs, scenario_run
from plumb.proof.compare import Divergence
from plumb.proof.runs import RunInputs
from plumb.proof.scenario_run import OWN, RunRequest, ScenarioRun
from plumb.spec import declarations
from plumb.spec.arrays import FloatArray
from plumb.spec.records import Words

if TYPE_CHECKING:
    from plumb.boards.contract import StepBoard
    from plumb.spec.tuning import AnyTuning

Verdict = Literal["pass", "fail", "unverified"]


class RunResult(ArraySignals):
    """A run of N steps: a mapping of signal -> array (N,) in deg, deg/s, g, m/s and us.

    The keys are the words of the system's record with the unit at the end: `tilt_deg`, `bias_dps`, `pulse_0_us`, ...
    `list(result)` names them all, and docs/reference/records.md says what each is. The names in SI work, too, and every
    name is an attribute as well (plumb.api.signals). The values are those of the board.
    """

    SI = False

    def __init__(self, done: ScenarioRun) -> None:
        self._done = done

    def __repr__(self) -> str:
        heading = self._done.heading
        return f"<Run of {self.system} on {heading['board']}: {counted(self.steps, 'step')}, {self.verdict}>"

    @property
    def system(self) -> str:
        """Name of the system."""
        return self._done.run.system

    def _of(self) -> str:
        return self.system

    def _word(self, name: str) -> npt.NDArray[np.int64]:
        return self.words[name]

    @property
    def steps(self) -> int:
        """Number of steps, N."""
        return len(self.raw)

    @property
    def time_s(self) -> FloatArray:
        """Time of the samples, (N,) s, from 0."""
        return self._done.run.inputs.time_s

    @property
    def raw(self) -> npt.NDArray[np.int16]:
        """Raw counts of the samples, (N, 6); a system uses the first few."""
        return self._done.run.inputs.raw

    @property
    def setpoint(self) -> npt.NDArray[np.int32]:
        """Setpoints of the steps, (N,), in the integers of the system."""
        return self._done.run.inputs.setpoint

    @property
    def truth(self) -> dict[str, FloatArray]:
        """Truth of the plant, or of a recording's reference, by name with unit, (N,) each; NaN where it is not known,
        and empty for inputs of your own."""
        return self._done.run.inputs.truth

    @property
    def reference(self) -> dict[str, FloatArray]:
        """Results of the equations in float64 on the same counts, by name with unit, (N,) each."""
        return self._done.run.reference

    @property
    def words(self) -> Words:
        """The integer words of every step, (N,) int64 each: the board's, or over a link the model's, which the board's
        digests confirm."""
        return self._done.run.board_words

    @property
    def digests(self) -> npt.NDArray[np.uint32]:
        """CRC-32 of every step's words as the board gave it, (N,)."""
        return self._done.run.answer.digests

    @property
    def params(self) -> ControlParams:
        """The parameters of the run, as the board's integers."""
        return self._done.run.params

    @property
    def verdict(self) -> Verdict:
        """`pass`: every step of the board equals the model's in every bit. `fail`: one differs. `unverified`: answers
        were lost on the link, or in the log that is replayed. It says nothing of the estimate's distance from the
        truth: `accuracy` does."""
        verdict = self._done.verdict
        return "pass" if verdict == "pass" else "fail" if verdict == "fail" else "unverified"

    @property
    def bit_exact(self) -> bool | None:
        """Whether every step of the board equals the model's in every bit; None where answers were lost."""
        return {"pass": True, "fail": False}.get(self.verdict)

    @property
    def accuracy(self) -> Literal["pass", "fail"] | None:
        """Whether the estimate keeps the limits of this scenario, tuning and loop; None where the input is no scenario
        of the system, or nothing is to be scored. `summary()` names the limits and what each is based on: one that the
        mean of many seeds is to keep may be missed by a single seed."""
        if not self.truth:
            return None
        found = self._done.accuracy().verdict
        return "pass" if found == "pass" else "fail" if found == "fail" else None

    @property
    def first_divergence(self) -> Divergence | None:
        """The first step and word that differ from the model's; None where none does."""
        return self._done.run.divergence

    @property
    def metrics(self) -> dict[str, float | int | None]:
        """Figures of the run by name with unit, as `plumb run` prints them; None where there is nothing to score."""
        if not self.truth:
            return {"target_vs_fixed_mismatches": self._done.run.mismatches}
        return self._done.run.metrics()

    def summary(self) -> dict[str, object]:
        """The output of `plumb run --json`, as plain types; raises UsageError for inputs of your own."""
        self._require_truth()
        return self._done.summary()

    def write_report(self, folder: Path | str) -> None:
        """Write report.html, summary.json and steps.csv into a folder, as `plumb run --out` does.

        Raises:
            UsageError: The folder cannot be written, or the run was of inputs of your own.
        """
        from plumb.proof import run_report

        run_report.write_run(arguments.path_of("folder", folder), self._done.run, self.summary())

    def _require_truth(self) -> None:
        if not self.truth:
            raise UsageError("a run of inputs of your own has nothing to score: take its arrays")


def run(
    system: str,
    *,
    board: str = "native",
    scenario: str | None = None,
    seed: int = 1000,
    tuning: str | AnyTuning | None = None,
    start: str | None = None,
    seconds: float | None = None,
    faults: Sequence[str] = (),
    conditions: Mapping[str, float] | None = None,
    open_loop: bool = False,
    live: bool = False,
    link: Literal["serial", "can"] = "serial",
    image: Path | str | None = None,
    changes: Sequence[str] = (),
) -> RunResult:
    """Run a scenario of a system on a board, and compare every step with the integer model: `plumb run`.

    Args:
        system: Name of a system: `quad`, `balancer`, `turntable`, `phone`.
        board: `native`, `qemu`, `virtual`, `serial:PORT[@BAUD]` or `can:INTERFACE:CHANNEL[@KBIT]`.
        scenario: Name of a scenario; None: the system's default.
        seed: Seed of every random number, 0 or more.
        tuning: Name of a tuning, a tuning object, or None for the system's default.
        start: Start-up mode of the filter instead of the tuning's own.
        seconds: Length, 1 to 3600 s; None: the scenario's own.
        faults: Faults as text, KIND[:WHAT]@START[-STOP], for example `stuck:gyro@60-70`.
        conditions: Conditions of the scenario by name, 0 or more each.
        open_loop: Prescribed motion: the outputs of the board move nothing.
        live: StepBoard `virtual` alone: it samples its own sensors by its own timer, armed.
        link: Link to board `virtual`.
        image: Flash image of board `virtual`; None: the one that was built or installed.
        changes: Gains that change on the way of a live run, while the board is armed, as text: SECONDS:NAME=VALUE, for
            example `3:pid.kp=0.06`; each to at most twice and at least half. The model follows.

    Returns:
        The arrays of the run and the verdict.

    Raises:
        UsageError: A name that does not exist, or a board that cannot do what was asked.
        LinkError: The board does not answer.
    """
    request = request_of(
        system, board, scenario, seed, tuning, start, seconds, faults, conditions, open_loop, live, link, image, changes
    )
    return RunResult(scenario_run.perform(request))


def request_of(
    system: str,
    board: str,
    scenario: str | None,
    seed: int,
    tuning: str | AnyTuning | None,
    start: str | None,
    seconds: float | None,
    faults: Sequence[str],
    conditions: Mapping[str, float] | None,
    open_loop: bool,
    live: bool,
    link: str = "serial",
    image: Path | str | None = None,
    changes: Sequence[str] = (),
) -> RunRequest:
    """The request of these arguments; `run` says what each is."""
    arguments.require_text(system=system, board=board, scenario=scenario, start=start)
    if not isinstance(system, str) or not isinstance(board, str):
        raise UsageError("give the names of a system and of a board")
    arguments.require_whole(seed=seed)
    arguments.require_number(seconds=seconds)
    arguments.require_names(faults=faults)
    arguments.require_names(changes=changes)
    arguments.require_mapping(conditions=conditions)
    arguments.require_number(**{f"condition {name}": number for name, number in (conditions or {}).items()})
    arguments.require_link(link)
    return RunRequest(
        system=system,
        board=board,
        scenario=scenario,
        tuning=tuning,
        start=start,
        seed=seed,
        seconds=seconds,
        faults=list(faults),
        conditions=[f"{name}={number!r}" for name, number in (conditions or {}).items()],
        open_loop=open_loop,
        live=live,
        changes=list(changes),
        link=link,
        image=arguments.optional_path_of("image", image),
    )


def run_own(
    board: StepBoard, name: str, params: ControlParams, raw: npt.ArrayLike, setpoint: npt.ArrayLike | None
) -> RunResult:
    """Run raw counts of the caller's own in lockstep; raises UsageError for a wrong shape or number."""
    from plumb.contract.run_fixed import check_inputs

    try:
        given = np.asarray(raw)
    except ValueError:
        raise UsageError("raw counts are no array: give (N, 3 to 6)") from None
    if given.ndim != 2 or not len(given):
        raise UsageError(f"raw counts of shape {given.shape}: give (N, 3 to 6), N at least 1")
    arguments.require_steps("raw", len(given))
    asked = np.zeros(len(given), np.int32) if setpoint is None else setpoint
    counts, setpoints = check_inputs(params.system, given, asked)
    steps = len(counts)
    inputs = RunInputs(
        np.arange(steps, dtype=np.float64) * params.period_s,
        {},
        counts.astype(np.int16),
        setpoints.astype(np.int32),
        np.zeros(steps, np.bool_),
    )
    heading = {"system": declarations.system(params.system).name, "scenario": OWN, "loop": "open", "board": name}
    return RunResult(ScenarioRun(runs.open_loop(board, inputs, params), heading))
