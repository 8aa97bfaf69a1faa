"""The fault table: what it declares, that a row can fail, and that what is run is safe within its limits."""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

pytest.importorskip("unicorn", reason="the virtual board needs unicorn (the extra virtual)")

from plumb import systems
from plumb.__main__ import main
from plumb.errors import UsageError
from plumb.flash.image import find_image
from plumb.link.identity import implausible
from plumb.proof.faults import host, table
from plumb.proof.faults.fault import Fault
from plumb.proof.faults.fault_report import write_report
from plumb.proof.faults.limits import limits
from plumb.proof.faults.reports import Told
from plumb.proof.faults.runner import Row, Runner
from plumb.proof.faults.scene import Scene
from plumb.proof.faults.sensors import ANALOG
from plumb.spec import declarations
from support.campaigns import LONG, campaign

LEAST = {
    "sensors": 10, "buses": 6, "clock": 3, "power": 3, "memory": 5, "host": 6, "frames": 6, "hangs": 5,
}  # fmt: skip
RATE_CHECK = 2
"""Bit of PLAUSIBILITY."""
ROOT = Path(__file__).parents[2]
DRIVEN = [name for name, declared in declarations.systems().items() if declared.is_driven]

try:
    find_image()
except UsageError as missing:
    pytest.skip(str(missing), allow_module_level=True)


FLIES = [name for name in DRIVEN if declarations.system(name).checks == "flight"]
SAMPLES = {
    "ROTORS": (
        "crash-without-reset", "crystal-fails", "host-silent", "loop-hangs", "pulses-wild",
        "flown-disarm", "flown-switched-off", "flown-sensor-gone", "flown-sensor-lost", "flown-receiver-silent",
        "flown-link-quality-0", "flown-accel-range-lost", "sample-channel-frozen",
    ),
    "WHEELS": (
        "crash-without-reset", "crystal-fails", "host-silent", "loop-hangs", "break-input", "gyro-silent",
        "accel-at-2g", "samples-cease", "ridden-fallen", "ridden-encoders-dead", "ridden-switched-off",
    ),
}  # fmt: skip
"""Kind of output -> rows of a vehicle that the short form runs: timer and pins of the others are not its own. The long
form runs all."""
VEHICLES = [name for name in DRIVEN if declarations.system(name).output in SAMPLES]


@pytest.fixture(scope="module", params=DRIVEN if LONG else [name for name in DRIVEN if name not in VEHICLES])
def runner(request: pytest.FixtureRequest) -> Iterator[Runner]:
    with Runner(request.param, phases=2) as runner:
        yield runner


@pytest.mark.slow
def test_every_driven_system_has_enough_faults_of_every_group(runner: Runner) -> None:
    count = Counter(fault.group for fault in table.FAULTS if runner.applies(fault))
    least = {**LEAST, "sensors": 6, "flights": 14} if runner.system in FLIES else LEAST
    assert {group: count[group] for group, at_least in least.items() if count[group] < at_least} == {}


def test_faults_have_unique_names_a_group_and_a_used_limit() -> None:
    names = [fault.name for fault in table.FAULTS]
    assert all(names.count(fault.name) == 1 for fault in table.FAULTS if not fault.needs)
    keys = [(fault.name, fault.needs) for fault in table.FAULTS]
    assert len(set(keys)) == len(keys)
    assert {fault.group for fault in table.FAULTS} <= set(table.GROUPS)
    assert {fault.limit for fault in table.FAULTS} == set(limits())
    assert all(fault.what and (fault.told or fault.holds) for fault in table.FAULTS)
    assert all(limit.why and 0 <= limit.safe_ms <= limit.detected_ms for limit in limits().values())


def test_what_is_driven_is_what_moves_something() -> None:
    assert DRIVEN and all(systems.load(name).OUTPUT_FRAMES for name in DRIVEN)


def test_security_md_names_existing_faults_and_tests() -> None:
    """Numbered promises, each with `Held by` and names."""
    text = (ROOT / "docs/explanation/security.md").read_text("utf-8")
    promises = re.findall(r"(?m)^\d+\. \*\*.*(?:\n(?!\d+\. |\n).*)*", text)
    assert len(promises) >= 8
    tests = {
        name for path in ROOT.glob("tests/**/test_*.py") for name in re.findall(r"def (test_\w+)", path.read_text())
    }
    known = {fault.name for fault in table.FAULTS} | tests
    for promise in promises:
        names = re.findall(r"`([^`]+)`", promise.partition("eld by")[2])
        assert names, promise
        assert set(names) <= known, set(names) - known


def nothing(scene: Scene) -> None:
    """No fault at all."""


def silent_or_disarms(scene: Scene) -> None:
    """The second way is sooner safe, and has another cause."""
    (host.disarms if scene.variant else host.silent)(scene)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("fault", "why"),
    [
        (Fault("none", "host", "nothing", nothing, "silence", (Told("EVENTS", "disarm_cause", 1 << 5),)),
         "never safe; not noticed; not told: EVENTS.disarm_cause: the keep-alive was lost"),
        (Fault("untold", "host", "DISARM", host.disarms, "command", (Told("STATUS", "faults", 1),)), "not told"),
        (Fault("slow", "host", "silence judged as a command", host.silent, "power"), "too late"),
        (Fault("unreported", "host", "nothing", nothing, "setpoint", (Told("SETPOINT_USED", "timed_out", 1),),
               moves_on=True), "never safe"),
        (Fault("untold-once", "host", "DISARM in one of two ways", silent_or_disarms, "silence",
               (Told("EVENTS", "disarm_cause", 1 << 5),), variants=2), "not told: EVENTS.disarm_cause"),
        (Fault("acts", "host", "DISARM", host.disarms, "held", holds=True), "it disarms; it acts"),
    ],
    ids=lambda value: value.name if isinstance(value, Fault) else "",
)  # fmt: skip
def test_a_row_can_fail(runner: Runner, fault: Fault, why: str) -> None:
    """A fault that is not one never ends safe; a report that does not come, a limit that is exceeded, and a command
    that acts where nothing may, are seen."""
    row = runner.run(fault)
    assert row.verdict == "fail" and why in row.why


@pytest.mark.slow
@pytest.mark.parametrize("system", VEHICLES)
def test_a_vehicle_is_safe_with_its_own_timer_and_pins(system: str) -> None:
    sample = SAMPLES[declarations.system(system).output]
    with Runner(system, phases=1) as runner:
        rows = [runner.run(fault) for fault in table.chosen([] if LONG else sample) if runner.applies(fault)]
    assert {row.name: row.why for row in rows if row.verdict != "pass"} == {}
    assert {row.name for row in rows} >= set(sample)


@pytest.mark.slow
def test_no_fault_that_must_not_act_passes(runner: Runner) -> None:
    """Nothing injected: every step is as without it."""
    row = runner.run(Fault("none", "host", "nothing", nothing, "held", holds=True))
    assert row.verdict == "pass" and row.safe_ms == 0.0


@pytest.mark.slow
def test_every_row_starts_from_the_same_moment(runner: Runner, monkeypatch: pytest.MonkeyPatch) -> None:
    """Through resets, power cuts and new connections in between."""
    monkeypatch.setattr(runner, "phases", campaign(1, 2))
    names = ["power-cut-again", "reset-pin", "host-disarms", "link-closed-on-can"]
    if LONG:
        names = ["power", "host-disarms", "link-closed*"]
    chosen = [fault for fault in table.chosen(names) if runner.applies(fault)]
    first = [runner.run(fault) for fault in chosen]
    assert [runner.run(fault) for fault in reversed(chosen)] == first[::-1]
    assert all(row.verdict == "pass" for row in first)


@pytest.mark.slow
def test_a_frozen_gyro_is_reported_alone(runner: Runner, monkeypatch: pytest.MonkeyPatch) -> None:
    """The pins of the accelerometer go on moving while that of the gyro is held."""
    monkeypatch.setattr(runner, "phases", campaign(1, 2))
    faults = [fault for fault in table.chosen(["gyro-frozen", "gyro-held-off"]) if fault.needs == ANALOG]
    if not all(map(runner.applies, faults)):
        return  # it reads chips over a bus
    frozen, held_off = map(runner.run, faults)
    assert frozen.verdict == held_off.verdict == "pass"
    assert frozen.reported.endswith("SENSORS.analog: input PA0 does not change")
    why = implausible(runner.system)[RATE_CHECK]
    assert held_off.reported == (f"EVENTS.disarm_cause: the sensors are implausible; PLAUSIBILITY.disarmed_by: {why}")


@pytest.mark.slow
def test_host_silent_over_many_phases(runner: Runner, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever the phase of steps, pulses and keep-alives, over either link."""
    monkeypatch.setattr(runner, "phases", campaign(4, 1000))
    for fault in table.chosen(["host-silent*"]):
        row = runner.run(fault)
        assert row.verdict == "pass", row.why
        # A value comes every 10 ms: sooner than that nobody can know of a silence.
        assert row.safe_ms is not None and 10.0 < row.safe_ms <= 50.0


@pytest.mark.slow
def test_json_is_the_same_bytes_every_time(capsys: pytest.CaptureFixture[str]) -> None:
    said = []
    for _ in range(2):
        assert main(["faults", "--system", DRIVEN[0], "host-silent", "brown-out", "--phases", "1", "--json"]) == 0
        said.append(capsys.readouterr().out)
    assert said[0] == said[1]
    rows = json.loads(said[0])
    assert rows["verdict"] == "pass"
    wanted = {"name", "safe_ms", "detected_ms", "reported", "limit_ms", "verdict"}
    assert all(wanted <= row.keys() for row in rows["faults"])
    assert [row["name"] for row in rows["faults"]] == ["brown-out", "host-silent"]


def test_the_table_for_people_and_the_exit_code(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    broken = Fault("no-fault", "host", "nothing is injected", nothing, "silence", (Told("STATUS", "faults", 1),))
    monkeypatch.setattr(table, "FAULTS", (table.chosen(["brown-out"])[0], broken))
    assert main(["faults", "--system", DRIVEN[0], "--out", str(tmp_path)]) == 1
    said = capsys.readouterr().out
    assert said.splitlines()[-2:] == [f"report: {tmp_path}/report.html", f"files: {tmp_path}/summary.json"]
    assert "pass brown-out" in said and "fail no-fault" in said and "2 faults, 1 failed: fail" in said
    assert "\x1b" not in said
    assert main(["faults", "--list"]) == 0
    assert "nothing is injected" in capsys.readouterr().out
    assert main(["faults", "--list", "brown-out"]) == 0
    listed = capsys.readouterr().out
    assert "brown-out" in listed and "no-fault" not in listed


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--system", "turntable"], "neither drives an actuator nor reads chips"),
        (["--phases", "0"], "from 1 to"),
        (["no-such-fault"], "no fault or group is called"),
    ],
)
def test_wrong_use_is_exit_2(capsys: pytest.CaptureFixture[str], arguments: list[str], said: str) -> None:
    assert main(["faults", *arguments]) == 2
    assert said in capsys.readouterr().err


def test_the_page_has_every_fault_and_what_it_was_made_with(tmp_path: Path) -> None:
    good = Row("quad", "", "host", "silent", "the host <stops>", "serial", 3.0, 4.0, "STATUS", 20.0, 40.0, "pass", "")
    late = replace(good, name="late", safe_ms=None, verdict="fail", why="never safe")
    page, summary = write_report(tmp_path / "new", [good, late], "fail", find_image(), "plumb faults --out new")
    told = json.loads(summary.read_text())
    assert told["verdict"] == "fail" and [row["name"] for row in told["faults"]] == ["silent", "late"]
    text = page.read_text()
    for part in (told["identity"]["part"]["image"]["sha256"], "plumb faults --out new", "the host &lt;stops&gt;"):
        assert part in text, part
    assert "1 of 2 faults" in text and text.count('<tr class="bad">') == 1 and "fail: never safe" in text
