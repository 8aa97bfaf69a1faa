"""Run faults: restore the armed scene, inject, watch pins and reports, compare with the limits."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from types import MappingProxyType

from plumb.errors import LinkError
from plumb.f103.core.bus import SimulationError
from plumb.f103.snapshot import Snapshot
from plumb.proof.faults import core
from plumb.proof.faults.fault import Fault
from plumb.proof.faults.limits import limits
from plumb.proof.faults.outputs import Watch
from plumb.proof.faults.reports import COUNTED, Reports, Told, report_text
from plumb.proof.faults.scene import ESTIMATE, Scene, driving

LISTEN_ON_S = 0.1
"""Time to watch the board after the limits have passed."""
BRIEF_S = 0.02
"""Time to watch the board at every phase but the first."""
REPORT_S = 0.15
"""Time to listen after a restart: the board sends STATUS, EVENTS and COUNTERS every 100 ms at the latest."""
AFTER_S = 0.15
"""Time to watch the outputs after Fault.after: a latched output must stay neutral."""
RESTART_S = 0.1
PHASE_SPAN_S = 0.06
"""Phases lie within this: whole periods of steps, pulses (20 ms) and keep-alives."""
PHASES = 50


@dataclass(frozen=True)
class Row:
    """One result. scenario: "" for that of a served board. safe_ms: from the injection until the outputs stay safe,
    None: never; for a fault that must have no effect, 0 when it had none. detected_ms: until the board
    disarmed, was reset or reported; None: not at all. reported: the reports. why: reasons to fail; empty when it
    passes."""

    system: str
    scenario: str
    group: str
    name: str
    what: str
    link: str
    safe_ms: float | None
    detected_ms: float | None
    reported: str
    limit_ms: float
    detected_limit_ms: float
    verdict: str
    why: str

    @property
    def scene(self) -> str:
        """System, and the scenario where it is not the default one."""
        return f"{self.system}, {self.scenario}" if self.scenario else self.system

    def to_json(self) -> dict[str, object]:
        return asdict(self)


@dataclass
class Measured:
    """Result of one injection."""

    safe_ms: float | None
    detected_ms: float | None
    reported: list[str]
    missing: list[str]
    why: list[str]


class Runner:
    """All faults of one system in one scenario; changes: other words of the parameter table. The scene is built once
    for each link, and restored for every fault."""

    def __init__(
        self,
        system: str,
        image: Path | None = None,
        phases: int = PHASES,
        scenario: str = "",
        changes: Mapping[str, int] = MappingProxyType({}),
    ) -> None:
        self.system, self.image, self.phases, self.scenario, self.changes = system, image, phases, scenario, changes
        self._scenes: dict[str, tuple[Scene, Snapshot]] = {}
        self._healthy: dict[tuple[str, str], dict[int, int]] = {}

    def __enter__(self) -> Runner:
        return self

    def __exit__(self, *_: object) -> None:
        for scene, snapshot in self._scenes.values():
            scene.machine.restore(snapshot)
            scene.board.close()

    def scene(self, link: str) -> tuple[Scene, Snapshot]:
        if link not in self._scenes:
            scene = driving(self.system, link, self.image, self.scenario, self.changes)
            self._scenes[link] = scene, scene.snapshot()
        return self._scenes[link]

    def applies(self, fault: Fault) -> bool:
        """Whether the system has what the fault breaks."""
        scene, _snapshot = self.scene("serial")
        if (ESTIMATE in fault.needs) != (ESTIMATE in scene.features):
            return False
        return fault.needs <= scene.features and (not fault.interrupt or core.handles(scene, fault.interrupt))

    def run(self, fault: Fault) -> Row:
        """Inject the fault, at every phase and variant that it asks for, and judge the worst result."""
        limit = limits()[fault.limit]
        count = self.phases if fault.phases else 1
        found = [
            self._measure(fault, phase * PHASE_SPAN_S / count, variant)
            for phase in range(count)
            for variant in range(fault.variants)
        ]
        worst = max(found, key=lambda one: (bool(one.why or one.missing), _late(one.safe_ms), _late(one.detected_ms)))
        why = list(worst.why)
        detected_late = _late(worst.detected_ms) > limit.detected_ms
        if _late(worst.safe_ms) > limit.safe_ms:
            why.append("it acts" if fault.holds else "outputs are safe too late" if worst.safe_ms else "never safe")
        if detected_late and (fault.told or not fault.holds):
            why.append("noticed too late" if worst.detected_ms is not None else "not noticed")
        why += [f"not told: {missing}" for missing in worst.missing]
        return Row(
            self.system,
            self.scenario,
            fault.group,
            fault.name,
            fault.what,
            fault.link,
            worst.safe_ms,
            worst.detected_ms,
            "; ".join(worst.reported or found[0].reported),
            limit.safe_ms,
            limit.detected_ms,
            "fail" if why else "pass",
            "; ".join(why),
        )

    def _measure(self, fault: Fault, phase_s: float, variant: int) -> Measured:
        scene, snapshot = self.scene(fault.link)
        machine = scene.machine
        machine.restore(snapshot)
        scene.variant = variant
        try:
            return self._inject(fault, scene, phase_s)
        except (LinkError, SimulationError) as error:
            return Measured(None, None, [], [], [f"the run broke off: {error}"])
        finally:
            scene.abandon()
            machine.restore(snapshot)

    def _inject(self, fault: Fault, scene: Scene, phase_s: float) -> Measured:
        machine, limit = scene.machine, limits()[fault.limit]
        window_s = max(limit.safe_ms, limit.detected_ms) * 1e-3 + LISTEN_ON_S
        brief = bool(phase_s)
        if brief:  # the first phase has checked reports and latching
            window_s = max(limit.safe_ms, limit.detected_ms) * 1e-3 + BRIEF_S
            scene.run(phase_s)
        if fault.prepare is not None:
            fault.prepare(scene)
        before = {key: scene.session.telemetry.get(key[0], {}).get(key[1], 0) for key in COUNTED}
        healthy = self._without(fault, scene, window_s) if fault.holds else {}
        watch, begun_s = Watch(machine), scene.now_s
        scene.listen_anew()
        was_armed = scene.says_armed
        watch.begin()
        fault.inject(scene)
        if scene.now_s < begun_s + window_s:
            scene.run(begun_s + window_s - scene.now_s)
        reports = Reports.of(scene.heard, begun_s, before)
        why: list[str] = []
        safe_ms = watch.safe_ms
        if fault.holds:
            safe_ms, why = self._held(scene, reports, healthy, watch, was_armed)
        if fault.prepare is None and not was_armed and ESTIMATE not in scene.features:
            why.append("the board was not armed when the fault came")
        if fault.judge is not None and (wrong := fault.judge(scene)):
            why.append(wrong)
        if fault.after is not None and not brief:
            fault.after(scene)
            scene.run(AFTER_S)
            if not fault.holds and watch.safe_ms != safe_ms:
                why.append("outputs leave safe again afterwards")
        watch.end()
        if watch.out_of_bounds is not None:
            why.append(f"a pulse out of its bounds after {watch.ms(watch.out_of_bounds):g} ms")
        if fault.by and watch.made_safe_by != fault.by:
            why.append(f"{watch.made_safe_by} made the outputs safe, not {fault.by}")
        if watch.resets or not scene.heard:
            self._ask(scene, reports, why)
        if fault.moves_on:
            said = [first[0] for told in fault.told if isinstance(told, Told) and (first := reports.first(told))]
            safe_ms = round((max(said) - begun_s) * 1e3, 1) if said else None
            why += ["it disarms"] if reports.disarmed_s() is not None else []
        measured = self._told(fault, reports, watch, safe_ms, why, was_armed)
        if brief:
            measured.missing.clear()
        return measured

    def _without(self, fault: Fault, scene: Scene, window_s: float) -> dict[int, int]:
        """Digests of the same steps without an injection."""
        here = scene.snapshot()
        begun_s = scene.now_s
        scene.listen_anew()
        scene.run(window_s)
        digests = Reports.of(scene.heard, begun_s, {}).digests()
        scene.machine.restore(here)
        return digests

    def _held(
        self, scene: Scene, reports: Reports, healthy: dict[int, int], watch: Watch, was_armed: bool
    ) -> tuple[float | None, list[str]]:
        """0 ms when everything continued as without the fault, else None; and the reasons."""
        digests = reports.digests()
        both = digests.keys() & healthy.keys()
        differing = [step for step in sorted(both) if digests[step] != healthy[step]]
        why = [f"step {differing[0]} differs from the run without the fault"] if differing else []
        if was_armed and (reports.disarmed_s() is not None or watch.safe_ms is not None):
            why.append("it disarms")
        if was_armed and not both:
            why.append("no step was heard")
        if not was_armed and watch.last_unsafe is not None:
            why.append("outputs move although nobody armed")
        return (None if why else 0.0), why

    def _ask(self, scene: Scene, reports: Reports, why: list[str]) -> None:
        """Connect anew to a board that was reset or was silent, and read its identity."""
        scene.host_alive = True
        scene.machine.advance_us(RESTART_S * 1e6)
        try:
            identity = scene.identify()
        except LinkError as error:
            why.append(f"the board does not come back: {error}")
            return
        time_s = scene.now_s
        reports.add_identity(identity, time_s)
        scene.run(REPORT_S)
        later = Reports.of(scene.heard, time_s, reports.before)
        for key, entries in later.values.items():
            reports.values.setdefault(key, []).extend(entries)

    def _told(
        self, fault: Fault, reports: Reports, watch: Watch, safe_ms: float | None, why: list[str], was_armed: bool
    ) -> Measured:
        times_ms = [watch.ms(time) for time in watch.resets]
        reported, missing = [], []
        for wanted in fault.told:
            choices: Sequence[Told] = wanted if isinstance(wanted, tuple) else (wanted,)
            found = [(choice, said) for choice in choices if (said := reports.first(choice)) is not None]
            if found:
                choice, (time_s, value) = found[0]
                text = choice.text(value, self.system)
                reported += [] if text in reported else [text]
                times_ms.append(round((time_s - reports.begun_s) * 1e3, 1))
            else:
                missing.append(" or ".join(_wanted(choice, self.system) for choice in choices))
        cause = Told("EVENTS", "disarm_cause")
        said = reports.first(cause)
        if said is not None and not any(text.startswith("EVENTS.disarm_cause") for text in reported):
            reported.append(cause.text(said[1], self.system))
        disarmed_s = reports.disarmed_s()
        if disarmed_s is not None and was_armed and not fault.holds:
            times_ms.append(round((disarmed_s - reports.begun_s) * 1e3, 1))
        return Measured(safe_ms, min(times_ms, default=None), reported, missing, why)


def _wanted(told: Told, system: str) -> str:
    if told.value is not None:
        return f"{told.frame}.{told.signal}: {told.value}"
    text = report_text(told.frame, told.signal, told.mask, system, told.choice or ("" if told.mask else "counted"))
    return f"{text}, and good again" if told.passes else text


def _late(time_ms: float | None) -> float:
    return float("inf") if time_ms is None else time_ms


def run_all(
    system: str,
    faults: Iterable[Fault],
    image: Path | None,
    phases: int,
    done: Callable[[], object] = lambda: None,
    scenario: str = "",
) -> list[Row]:
    """The rows of one system in one scenario, in order of the table; done() is called after each fault."""
    rows = []
    with Runner(system, image, phases, scenario) as runner:
        for fault in faults:
            if runner.applies(fault):
                rows.append(runner.run(fault))
            done()
    return rows
