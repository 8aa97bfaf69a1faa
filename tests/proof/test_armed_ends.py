"""At both ends of what an armed board takes, it is armed, and the faults of the promises that a parameter can weaken
end as promised.

Beyond the ends the board refuses to arm: tests/link/test_unsafe_parameters.py.
"""

from __future__ import annotations

import itertools
from dataclasses import replace

import pytest

pytest.importorskip("unicorn", reason="the virtual board needs unicorn (the extra virtual)")

from plumb import systems
from plumb.contract.parameters import quantise
from plumb.contract.scenario import fitted
from plumb.errors import UsageError
from plumb.flash.image import find_image
from plumb.proof.faults import table
from plumb.proof.faults.fault import Fault
from plumb.proof.faults.limits import limits
from plumb.proof.faults.runner import Row, Runner
from plumb.proof.faults.scene import SEED, scenarios_of
from plumb.spec import armed_values, declarations, parameters
from plumb.spec.armed_values import LEAST
from plumb.systems import shipped_tunings
from plumb.systems.contracts import PINS

try:
    find_image()
except UsageError as missing:
    pytest.skip(str(missing), allow_module_level=True)

SCENES = [
    (name, scenario)
    for name, declared in declarations.systems().items()
    if declared.is_driven
    for scenario in scenarios_of(name)
]
LIMITED = {row.name: row for row in parameters.table() if row.armed}
FILTER = ("kalman.", "tilt.", "start.", "period_us", "variance_turn2_q56")
"""Words of the table that a tuning of the filter sets."""
PAIRS = [("rail_ms", "stuck_ms"), ("period_us", "esc_period_us")]
PROMISED = {
    1: ("host-silent", "setpoints-cease"),
    5: ("host-disarms", "neutral-wild"),
    7: ("sensors",),
    8: ("steps-stop", "loop-hangs"),
}
"""Promise -> faults that hold it."""
SHORTEST_HALFUS = 2000
"""The shortest pulse that drives, in the shipped tables."""
BY_A_CHECK = "EVENTS.disarm_cause: the sensors are implausible"
ANOTHER_CHECK = "not told: PLAUSIBILITY.disarmed_by: "
FOUND_BY_ANOTHER = {
    "outputs are safe too late",
    "noticed too late",
    "not told: EVENTS.disarm_cause: the board has a fault",
}
"""What a row says when another check was first than the one it waits for, or when its own one is slower at this end."""


def tuned_for(system: str, scenario_name: str, period_us: int) -> dict[str, int]:
    """The words of the driving tuning at this period, as `plumb params set period_us` gives them: with those of another
    period the loop swings up until the board finds its sensors implausible, without any fault."""
    loaded, parts = systems.load(system), systems.load(system, PINS)
    tuning = loaded.TUNINGS[parts.TUNING]
    scenario = loaded.scenario(scenario_name or parts.SCENARIO, SEED, period_us=tuning.period_us)
    params = quantise(replace(fitted(scenario, tuning), period_us=period_us))
    return {**params.values, **params.link_words()}


def moved(name: str, end: int) -> dict[str, int]:
    """The words that a table needs with this end: a neutral pulse is no longer than the shortest that drives."""
    return {"esc.min_halfus": end} if name == "esc.neutral_halfus" and end > SHORTEST_HALFUS else {}


def possible(system: str, changes: dict[str, int]) -> dict[str, int]:
    """The changes, at the ends that this system has: those of its own conditions, and pulses in their order."""
    least = {one.words[0]: one.limit for one in armed_values.conditions() if (one.system, one.kind) == (system, LEAST)}
    held = {name: max(value, least.get(name, value)) for name, value in changes.items()}
    parts = systems.load(system, PINS)
    mid = quantise(systems.load(system).TUNINGS[parts.TUNING])["esc.mid_halfus"]
    return {**held, "esc.mid_halfus": max(mid, held["esc.min_halfus"])} if "esc.min_halfus" in held else held


def ends(name: str) -> tuple[int, int]:
    row = next(row for row in parameters.table() if row.name == name)
    low, high = row.armed or (row.min, row.max)
    return low, high


CASES = [{name: end, **moved(name, end)} for name in LIMITED for end in ends(name)]
CASES += [
    {**moved(pair[0], both[0]), **dict(zip(pair, both, strict=True))}
    for pair in PAIRS
    for both in itertools.product(*map(ends, pair))
]
SAMPLE = [
    ({"rail_ms": 100, "stuck_ms": 100}, ("gyro-frozen", "sensors-unplugged")),
    ({"period_us": 20_000, "esc_period_us": 20_000}, ("steps-stop", "host-silent")),
]


def broken(row: Row) -> str:
    """Why the row breaks its promise; "" when it keeps it. A row of the sensors names the check that is first with the
    shipped parameters; the promise is that one of them disarms within 500 ms and says so."""
    if row.verdict == "pass":
        return ""
    promised = limits()["sensor"]
    in_time = row.safe_ms is not None and row.safe_ms <= promised.safe_ms
    in_report = row.detected_ms is not None and row.detected_ms <= promised.detected_ms
    if row.group == "sensors" and in_time and in_report and BY_A_CHECK in row.reported:
        reasons = [why for why in row.why.split("; ") if why not in FOUND_BY_ANOTHER]
        return "; ".join(why for why in reasons if not why.startswith(ANOTHER_CHECK))
    return row.why


def failures(system: str, scenario: str, changes: dict[str, int], faults: list[Fault]) -> dict[str, str]:
    """Fault -> why its row failed. The board has to be armed with this table: LinkError when it is not."""
    changes = possible(system, changes)
    period_us = changes.get("period_us")
    changes = {**(tuned_for(system, scenario, period_us) if period_us else {}), **changes}
    with Runner(system, phases=1, scenario=scenario, changes=changes) as runner:
        runner.scene("serial")
        rows = [runner.run(fault) for fault in faults if runner.applies(fault)]
    assert rows
    return {row.name: why for row in rows if (why := broken(row))}


def test_every_limited_parameter_and_promise_has_its_rows() -> None:
    promised = {number for row in parameters.table() for number in row.weakens}
    assert promised == PROMISED.keys() == armed_values.promises().keys()
    assert {name for case in CASES for name in case} == {
        *LIMITED,
        "esc_period_us",
        "esc.min_halfus",
    }


@pytest.mark.slow
@pytest.mark.parametrize(("changes", "names"), SAMPLE)
def test_a_sample_of_the_ends(changes: dict[str, int], names: tuple[str, ...]) -> None:
    assert failures(*SCENES[0], changes, table.chosen(names)) == {}


@pytest.mark.long
@pytest.mark.parametrize(("system", "scenario"), SCENES)
@pytest.mark.parametrize("changes", CASES, ids=str)
def test_every_end(system: str, scenario: str, changes: dict[str, int]) -> None:
    weakened = {number for row in parameters.table() if row.name in changes for number in row.weakens}
    names = [name for number in sorted(weakened) for name in PROMISED[number]]
    assert failures(system, scenario, changes, table.chosen(names)) == {}


@pytest.mark.long
@pytest.mark.parametrize("tuning", systems.load("quad").TUNINGS)
def test_no_filter_hides_a_turned_accelerometer(tuning: str) -> None:
    """Gyro and accelerometer are compared without the filter: neither a gain that follows the accelerometer soon, nor a
    variance whose 6 standard deviations are more than the turn, hides it."""
    words = shipped_tunings.table_of("quad", tuning)
    changes = {name: words[name] for name in words if name.startswith(FILTER)}
    assert failures("quad", "", changes, table.chosen(("accel-turned", "accel-turned-soon"))) == {}
