"""The wiring drawings: fresh, and every wire on a pin that the booted image uses in just that way."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

pytest.importorskip("unicorn", reason="the virtual board needs unicorn (the extra virtual)")
from plumb.boards.strap import BY_PIN_SET, set_strap
from plumb.errors import UsageError
from plumb.f103 import Machine
from plumb.flash.image import find_image
from plumb.link.session import Session
from plumb.spec.parameters import table

ROOT = Path(__file__).parents[2]
IMAGES = {"wheels": Path("wheels"), "quadrotor": Path("quadrotor")}
"""Pin sets whose actuators the image of all systems does not have."""
CONTROL_WORDS = sum(row.owner == "control" for row in table())
MODES = {"analog": {0b0000}, "input": {0b1000}, "output": {0b0001, 0b1001, 0b1010}, "open drain": {0b1101}}
"""RM0008 9.2.1: inputs have their pull, outputs belong to a peripheral, but for the select line."""


def tool() -> ModuleType:
    spec = importlib.util.spec_from_file_location("gen_wiring", ROOT / "tools/gen_wiring.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["gen_wiring"] = module
    spec.loader.exec_module(module)
    return module


GENERATOR = tool()


def booted(pins: str) -> Machine:
    try:
        machine = Machine(find_image(IMAGES.get(pins)))
    except UsageError as error:
        pytest.skip(str(error))
    machine.advance_us(60_000)
    if pins != "standard":
        with Session.open(machine.uart) as session:
            session.upload(session.read_parameters()[:CONTROL_WORDS], pins=BY_PIN_SET.index(pins))
            session.execute("SAVE")
        set_strap(machine, pins)
        machine.reset()
        machine.advance_us(60_000)
    return machine


def test_the_drawings_are_fresh() -> None:
    for name, text in GENERATOR.generate().items():
        file = ROOT / "docs/wiring" / name
        assert file.read_text(encoding="utf-8") == text, f"{name} is stale: run tools/gen_wiring.py"


@pytest.mark.parametrize("drawing", GENERATOR.DRAWINGS, ids=lambda drawing: drawing.name)
def test_every_wire_ends_on_a_pin_that_is_what_the_drawing_says(drawing: Any) -> None:
    machine = booted(drawing.pins)
    wires = drawing.wires()
    assert len({wire.pin for wire in wires}) == len(wires)
    for wire in wires:
        assert machine.port(wire.pin).mode(int(wire.pin[2:])) in MODES[wire.role], (wire.pin, wire.label)


@pytest.mark.parametrize("pins", BY_PIN_SET)
def test_no_pin_that_drives_is_missing_from_the_drawings(pins: str) -> None:
    """Whoever wires something to a pin that drives would like to know."""
    machine = booted(pins)
    drawn = {wire.pin for drawing in GENERATOR.DRAWINGS for wire in drawing.wires() if drawing.pins == pins}
    driving = {f"P{'ABC'[i]}{n}" for i in range(3) for n in range(16) if machine.ports[i].is_output(n)}
    spi, i2c, can = {"PA4", "PA5", "PA7"}, {"PB8", "PB9"}, {"PA12"}
    assert driving - drawn <= spi | i2c | can
