"""At both ends of what an armed board takes, the faults of the promises that a parameter can weaken still end safe.

Beyond the ends the board refuses to arm: tests/link/test_unsafe_parameters.py.
"""

from __future__ import annotations

import itertools

import pytest

pytest.importorskip("unicorn", reason="the virtual board needs unicorn (the extra virtual)")

from plumb import systems
from plumb.errors import LinkError, UsageError
from plumb.flash.image import find_image
from plumb.proof.faults import table
from plumb.proof.faults.fault import Fault
from plumb.proof.faults.runner import Runner
from plumb.spec import parameters

try:
    find_image()
except UsageError as missing:
    pytest.skip(str(missing), allow_module_level=True)

DRIVEN = [name for name in systems.SYSTEMS if systems.load(name).OUTPUT_FRAMES]
LIMITED = {row.name: row.armed for row in parameters.table() if row.armed and "." not in row.name}
PAIRS = [("rail_ms", "stuck_ms"), ("period_us", "esc_period_us")]
PROMISED = {1: ("host-silent", "setpoints-cease"), 7: ("sensors",), 8: ("steps-stop", "loop-hangs")}
"""Promise -> faults that hold it."""


def ends(name: str) -> tuple[int, ...]:
    row = next(row for row in parameters.table() if row.name == name)
    return row.armed or (row.min, row.max)


CASES = [{name: end} for name in LIMITED for end in ends(name)]
CASES += [dict(zip(pair, both, strict=True)) for pair in PAIRS for both in itertools.product(*map(ends, pair))]
SAMPLE = [
    ({"rail_ms": 150, "stuck_ms": 150}, ("gyro-frozen", "sensors-unplugged")),
    ({"period_us": 20_000, "esc_period_us": 20_000}, ("steps-stop", "host-silent")),
]


def failures(system: str, changes: dict[str, int], faults: list[Fault]) -> dict[str, str]:
    """Fault -> why its row failed. A table with which the board is not armed at all has none."""
    with Runner(system, phases=1, changes=changes) as runner:
        try:
            runner.scene("serial")
        except LinkError:
            return {}
        rows = [runner.run(fault) for fault in faults if runner.applies(fault)]
    assert rows
    return {row.name: row.why for row in rows if row.verdict != "pass"}


@pytest.mark.slow
@pytest.mark.parametrize(("changes", "names"), SAMPLE)
def test_a_sample_of_the_ends(changes: dict[str, int], names: tuple[str, ...]) -> None:
    assert failures(DRIVEN[0], changes, table.chosen(names)) == {}


@pytest.mark.long
@pytest.mark.parametrize("system", DRIVEN)
@pytest.mark.parametrize("changes", CASES, ids=str)
def test_every_end(system: str, changes: dict[str, int]) -> None:
    weakened = {number for row in parameters.table() if row.name in changes for number in row.weakens}
    names = [name for number in sorted(weakened) for name in PROMISED[number]]
    assert failures(system, changes, table.chosen(names)) == {}
