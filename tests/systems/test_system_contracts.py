"""Every module of a system offers what its contract says, and one that does not is refused in one sentence."""

from __future__ import annotations

import inspect
import os
import shutil
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

from plumb import systems
from plumb.analyses.comparison.contenders import COMPARE
from plumb.analyses.flights.estimators import FLIGHT
from plumb.boards.plant_on_pins import coupler
from plumb.cli.demo import DEMO
from plumb.contract.parameters import QUANTISER
from plumb.contract.scenario import SCENARIOS, Plant, Scenario, System
from plumb.contract.step import FIXED, REFERENCE
from plumb.errors import UsageError
from plumb.proof.figures import FIGURES
from plumb.proof.invariants import INVARIANTS
from plumb.proof.runs import PLOTS
from plumb.readers.replay import REPLAY
from plumb.spec import system_parts
from plumb.spec.system_parts import Part
from plumb.systems.balancer import pins as balancer_pins
from plumb.systems.balancer import scenarios as balancer
from plumb.systems.contracts import PINS, Coupling
from plumb.systems.quad import pins as quad_pins
from plumb.systems.quad import scenarios as quad
from plumb.systems.turntable import pins as turntable_pins
from plumb.systems.turntable import scenarios as turntable
from support.declared_systems import without_part

TOY = Path(__file__).resolve().parents[1] / "toy_systems" / "toy"
PARTS: list[Part[object]] = [
    SCENARIOS, FIXED, REFERENCE, QUANTISER, PLOTS, PINS, FIGURES, INVARIANTS, REPLAY, COMPARE, FLIGHT,
    DEMO,
]  # fmt: skip
OPTIONAL = {"pins", "figures", "invariants", "replay", "compare", "flight", "demo"}


def plants_and_couplings() -> tuple[list[Scenario], list[Plant], list[type[Coupling]]]:
    """What the type checker holds to the contracts; `load` cannot see what the functions give."""
    one, two = quad.scenario("quiet", 1, seconds=1.0), balancer.scenario("smooth", 1, seconds=1.0)
    three = turntable.scenario(turntable.DEFAULT_SCENARIO, 1, seconds=1.0)
    plants: list[Plant] = [quad.plant(one), balancer.plant(two), turntable.plant(three)]
    return (
        [one, two, three],
        plants,
        [quad_pins.QuadCoupling, balancer_pins.BalancerCoupling, turntable_pins.TurntableCoupling],
    )


@pytest.mark.parametrize("name", systems.SYSTEMS)
@pytest.mark.parametrize("part", PARTS, ids=lambda part: part.name)
def test_the_parts_of_a_system_offer_what_their_contracts_say(name: str, part: Part[object]) -> None:
    assert (part.name in OPTIONAL) == bool(part.without)
    if name in systems.with_part(part.name):
        offered = systems.load(name, part)
        assert all(hasattr(offered, member) for member in system_parts.members_of(part.contract))
    else:
        with pytest.raises(UsageError, match=rf"^{name}: {part.without}"):
            systems.load(name, part)


@pytest.mark.parametrize("name", systems.SYSTEMS)
def test_conditions_are_keywords_of_scenario(name: str) -> None:
    system = systems.load(name)
    taken = inspect.signature(system.scenario).parameters
    any_keyword = any(parameter.kind is parameter.VAR_KEYWORD for parameter in taken.values())
    assert any_keyword or set(system.CONDITIONS) <= set(taken)


def test_a_contract_has_the_members_of_the_system() -> None:
    members = system_parts.members_of(System)
    assert {"SCENARIOS", "TUNINGS", "OUTPUT_FRAMES", "scenario", "plant", "faults"} <= set(members)
    assert not any(name.startswith("_") for name in members)


def test_everything_that_a_module_lacks_is_named_at_once() -> None:
    module = ModuleType("plumb.systems.odd.pins")
    module.__file__ = "odd/pins.py"
    vars(module).update(couple=object, FRAMES=(), SHOWN="still")
    with pytest.raises(UsageError, match=r"^odd/pins\.py lacks SCENARIO, TUNING; CONTRIBUTING"):
        system_parts.check(module, PINS.contract)


def test_a_function_takes_the_keywords_of_the_contract() -> None:
    module = ModuleType("plumb.systems.odd.plots")
    module.__file__ = "odd/plots.py"
    vars(module).update(metrics="none", MEASURES=(), MAIN="", APART="", plots=lambda run: [])
    with pytest.raises(UsageError, match=r"^odd/plots\.py lacks metrics\(\), closed of plots\(\);"):
        system_parts.check(module, PLOTS.contract)


def plumb(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "PLUMB_SYSTEM_PATH": str(folder)}
    return subprocess.run(
        [sys.executable, "-m", "plumb", *words], env=environment, capture_output=True, text=True, timeout=60
    )


def test_a_command_says_in_one_sentence_what_a_system_lacks(tmp_path: Path) -> None:
    shutil.copytree(TOY.parent, tmp_path, dirs_exist_ok=True)
    scenarios = tmp_path / "toy" / "scenarios.py"
    scenarios.write_text(scenarios.read_text().replace("TUNING_NOTES", "TUNED_NOTES").replace("def plant(", "def p("))
    done = plumb(tmp_path, "systems", "--system", "toy")
    assert done.returncode == 2 and not done.stdout
    assert done.stderr.strip().count("\n") == 0
    assert f"{scenarios} lacks TUNING_NOTES, plant(); CONTRIBUTING.md" in done.stderr
    (tmp_path / "toy" / "scenarios.py").unlink()
    assert "toy has no scenarios.py: every system has this file" in plumb(tmp_path, "systems", "--system", "toy").stderr


def test_a_plant_without_pins_is_refused_before_it_is_coupled() -> None:
    name = without_part("pins")
    own = systems.load(name)
    with pytest.raises(UsageError, match="no sensors of its own"):
        coupler(name, own.plant(own.scenario(own.DEFAULT_SCENARIO, 1, seconds=4.0)))


def test_plants_and_couplings_are_typed() -> None:
    scenarios, plants, couplings = plants_and_couplings()
    assert all(len(plant.counts(0.0)) == 6 for plant in plants)
    assert all(scenario.counts().shape == (scenario.steps, 6) for scenario in scenarios) and len(couplings) == 3
