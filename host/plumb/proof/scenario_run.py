"""Runs a scenario of a system on a board and compares it with the model, for `plumb run` and `plumb demo`."""

from __future__ import annotations

import math
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, cast

from plumb import systems
from plumb.boards import open_board
from plumb.boards.contract import SimulatedBoard, StepBoard
from plumb.boards.qemu import QemuBoard
from plumb.contract import disturbance
from plumb.contract.parameters import ControlParams, quantise
from plumb.contract.scenario import Scenario, fitted, tuning_for
from plumb.errors import UsageError
from plumb.proof import invariants, limits, runs
from plumb.proof.invariants import Violation
from plumb.proof.report import Statement
from plumb.proof.runs import Run
from plumb.spec.tuning import AnyTuning
from plumb.systems.contracts import PINS


@dataclass(frozen=True)
class RunRequest:
    """Request for a run.

    scenario, tuning: names of the system's lists; None: the default scenario, and the scenario's tuning; the tuning may
    be an object, too. The period is that of the tuning. start: a start-up mode of the filter instead of the tuning's.
    seconds: length; None: the scenario's own. faults: KIND[:WHAT]@START[-STOP] each. conditions: NAME=NUMBER each.
    open_loop: prescribed motion, the outputs move nothing. live: the virtual board samples its own sensors by its own
    timer. changes: of gains in a live run, each SECONDS:NAME=VALUE. link, image: of board `virtual`.
    """

    system: str
    board: str
    scenario: str | None = None
    tuning: str | AnyTuning | None = None
    start: str | None = None
    seed: int = 1000
    seconds: float | None = None
    faults: Sequence[str] = ()
    conditions: Sequence[str] = ()
    open_loop: bool = False
    live: bool = False
    changes: Sequence[str] = ()
    link: str = "serial"
    image: Path | None = None


@dataclass(frozen=True)
class ScenarioRun:
    """A run with its system, scenario and settings."""

    run: Run
    heading: dict[str, Any]

    @property
    def verdict(self) -> str:
        """pass, fail or unverified."""
        return self.run.verdict

    def accuracy(self) -> limits.Accuracy:
        """The metrics against the limits that the system declares for this run."""
        return self.run.accuracy(self.heading)

    def violations(self) -> tuple[Violation, ...] | None:
        """The first violation of each invariant of the system; None for a run that is not judged by invariants."""
        judged = invariants.judges(self.run.system, str(self.heading.get("scenario")))
        return invariants.violations_of(self.run) if judged else None

    def statements(self) -> list[Statement]:
        """Statements of the system's invariants about this run; []: it is not judged by them."""
        found = self.violations()
        return [] if found is None else invariants.statements(self.run.system, found)

    def summary(self, **changed: Any) -> dict[str, Any]:
        """The output of `run --json`; changed: entries of the heading with another value, None: left out."""
        heading = {**self.heading, **changed}
        left_out = {name for name, value in changed.items() if value is None}
        said = self.run.summary(**{name: value for name, value in heading.items() if name not in left_out})
        found = self.violations()
        return said if found is None else {**said, "violations": [one.to_json() for one in found]}


def check(request: RunRequest) -> None:
    """Raises UsageError for errors in a request that no board accepts, such as a name that the system does not have."""
    from plumb.proof import gain_changes

    system = systems.load(request.system)
    if request.scenario is not None and request.scenario not in system.SCENARIOS:
        raise UsageError(f"{request.system} has no scenario '{request.scenario}'; it has {', '.join(system.SCENARIOS)}")
    tuning_of(request.system, request.tuning)
    if request.start and request.start not in system.STARTS:
        modes = ", ".join(system.STARTS) or "none"
        raise UsageError(f"{request.system} has no start-up mode '{request.start}'; it has {modes}")
    system.faults([disturbance.parse(text) for text in request.faults])
    conditions_of(request.system, system.CONDITIONS, request.conditions)
    if request.changes and not request.live:
        raise UsageError("--change is for --live: in lockstep a run has one table")
    for text in request.changes:
        gain_changes.parse(text)


def perform(request: RunRequest, opened: StepBoard | None = None) -> ScenarioRun:
    """Open the board, run the scenario, compare every step with the model. opened: the board, where it is open; it
    stays open.

    Raises UsageError for a name that the system does not have or a board that cannot do it, LinkError.
    """
    drawn = draw(request)
    scenario, params, closes = drawn.scenario, drawn.params, drawn.closes
    if request.live and request.board != "virtual":
        raise UsageError(
            "--live is for --board virtual: there the board samples its own sensors, and the plant's pilot sends to "
            "its receiver; on another board leave --live out, and the same scenario and pilot run in lockstep"
        )
    if request.live:
        systems.load(request.system, PINS)
    if opened is None:
        with open_board(request.board, link=request.link, image=request.image) as board:
            result = _run(board, request, scenario, params, closes)
    else:
        result = _run(opened, request, scenario, params, closes)
    heading: dict[str, Any] = {
        "system": request.system,
        "scenario": drawn.name,
        "tuning": drawn.tuning,
        "loop": "closed" if closes else "open",
        "board": request.board,
        **({"live": True} if request.live else {}),
        **({"changes": list(request.changes)} if request.changes else {}),
        "link": request.link if request.board == "virtual" else None,
        "seed": request.seed,
        **({"faults": list(request.faults)} if request.faults else {}),
        **({"conditions": drawn.conditions} if drawn.conditions else {}),
    }
    return ScenarioRun(result, heading)


@dataclass(frozen=True)
class Drawn:
    """The run of a request, drawn from its seed. name: of the scenario. closes: the outputs move the plant."""

    name: str
    tuning: str
    scenario: Scenario
    params: ControlParams
    conditions: dict[str, float]
    closes: bool


def draw(request: RunRequest) -> Drawn:
    """Draw the run of a request; raises UsageError for a name that the system does not have."""
    check(request)
    system = systems.load(request.system)
    name = request.scenario or system.DEFAULT_SCENARIO
    tuning, settings = tuning_of(request.system, request.tuning or tuning_for(system, name))
    if request.start:
        settings, tuning = replace(settings, start=system.STARTS[request.start]), f"{tuning}, {request.start}"
    faults = system.faults([disturbance.parse(text) for text in request.faults])
    conditions = conditions_of(request.system, system.CONDITIONS, request.conditions)
    scenario = system.scenario(
        name, request.seed, seconds=request.seconds, period_us=settings.period_us, faults=faults, **conditions
    )
    params = _quantised(cast(Hashable, fitted(scenario, settings)))
    return Drawn(name, tuning, scenario, params, conditions, bool(system.OUTPUTS) and not request.open_loop)


@lru_cache(maxsize=4)
def _quantised(tuning: Hashable) -> ControlParams:
    """The parameters of a tuning, cached for the runs of a campaign."""
    return quantise(cast(AnyTuning, tuning))


def _run(board: StepBoard, request: RunRequest, scenario: Scenario, params: ControlParams, closes: bool) -> Run:
    """Run live on the board's own sensors, in open loop, or in closed loop. `qemu` runs whole vectors only: the native
    core closes the loop, then QEMU runs the same inputs."""
    if request.live:
        from plumb.proof import gain_changes, live_run

        assert isinstance(board, SimulatedBoard)
        gains = [gain_changes.parse(text) for text in request.changes]
        return live_run.run_live(board, scenario, params, open_loop=not closes, gains=gains)
    if not closes:
        return runs.open_loop(board, runs.prescribed(scenario), params)
    if isinstance(board, QemuBoard):
        with open_board("native") as native:
            inputs = runs.closed_loop(native, scenario, params).inputs
        return runs.open_loop(board, inputs, params)
    return runs.closed_loop(board, scenario, params)


OWN = "own"
"""Name in a summary for a tuning or scenario that the caller gave as an object."""


def tuning_of(system: str, tuning: str | AnyTuning | None) -> tuple[str, AnyTuning]:
    """Name and settings of a tuning: by its name, the object itself, or for None the system's default. Raises
    UsageError for a tuning that the system does not have, or that is of another."""
    known = systems.load(system)
    if tuning is None or isinstance(tuning, str):
        name = tuning or known.DEFAULT_TUNING
        if name not in known.TUNINGS:
            raise UsageError(f"{system} has no tuning '{name}'; it has {', '.join(known.TUNINGS)}")
        return name, known.TUNINGS[name]
    if getattr(tuning, "system", None) != system:
        raise UsageError(f"the tuning is of {getattr(tuning, 'system', 'no system')}, the run of {system}")
    return OWN, tuning


def conditions_of(system: str, known: Mapping[str, str], texts: Sequence[str]) -> dict[str, float]:
    """NAME=NUMBER each; raises UsageError for a name that the system does not have, or no number from 0 up."""
    found = {}
    for text in texts:
        name, _, number = text.partition("=")
        if name not in known:
            raise UsageError(f"{system} has no condition '{name}'; it has {', '.join(known) or 'none'}")
        try:
            found[name] = float(number)
        except ValueError:
            raise UsageError(f"'{text}' sets nothing; write {name}=NUMBER") from None
        if not 0.0 <= found[name] < math.inf:
            raise UsageError(f"'{text}': a number from 0 up")
    return found
