"""The figures are those of the flash image: whatever native computes for the table, the virtual board computes, too."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

pytest.importorskip("unicorn")

from plumb import __main__ as front
from plumb import systems
from plumb.boards.contract import Answer
from plumb.boards.native.board import NativeBoard
from plumb.proof import confirmed
from support.campaigns import campaign
from support.declared_systems import without_output


@pytest.mark.slow
@pytest.mark.parametrize(("name", "link"), [*((name, "serial") for name in systems.SYSTEMS), ("balancer", "can")])
def test_every_scenario_and_tuning_is_the_same_on_the_virtual_board(
    name: str, link: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The first seconds of seed 1000, with PLUMB_LONG=1 in every scenario; `plumb systems --confirm virtual` runs them
    whole. Which code each system's steps take on the image is the matter of the golden vectors."""
    system = systems.load(name)
    others = [scenario for scenario in system.SCENARIOS if scenario != system.DEFAULT_SCENARIO]
    taken = [system.DEFAULT_SCENARIO, *others[: campaign(2, len(others))]]
    monkeypatch.setattr(system, "SCENARIOS", {scenario: system.SCENARIOS[scenario] for scenario in taken})
    seconds = {"phone": "4", "attitude": "2"}.get(name, "1")
    code = front.main(
        ["systems", "--confirm", "virtual", "--link", link, "--system", name, "--seconds", seconds, "--json"]
    )
    said = json.loads(capsys.readouterr().out)
    assert code == 0 and said["seed"] == 1000
    loops = 2 if system.OUTPUTS else 1
    assert len(said["runs"]) == loops * len(system.SCENARIOS) + len(system.TUNINGS) - 1
    assert all(run["differ"] == 0 and run["steps"] > 0 for run in said["runs"])


class Wrong(NativeBoard):
    """Native, but one digest of every run."""

    def run_injected(self, *arguments: Any) -> Answer:
        digests = super().run_injected(*arguments).digests.copy()
        digests[17] ^= np.uint32(1)
        return Answer(digests)


def test_a_board_that_differs_is_not_confirmed() -> None:
    name = without_output()
    steps = round(4.0e6 / systems.load(name).PERIOD_US)
    rows = list(confirmed.confirm(Wrong(), name, seconds=4.0))
    assert rows and {row.differ for row in rows} == {1}
    assert f"1 of {steps} steps differ" in str(rows[0])
