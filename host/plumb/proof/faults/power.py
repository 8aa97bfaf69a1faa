"""Faults of the supply, and resets from outside."""

from __future__ import annotations

from plumb.boards.strap import BY_PIN_SET, set_strap
from plumb.proof.faults.fault import Action, Fault
from plumb.proof.faults.reports import Told
from plumb.proof.faults.scene import Scene

POWER, PIN, FALLBACK, STRAP = 1 << 3, 1 << 2, 1 << 8, 1 << 15
AWAY_US = 5_000.0
BY_POWER = Told("IDENTITY", "RESET_CAUSE", POWER)


def cut(*on_us: float) -> Action:
    """Switch the supply off and on; again after each of these times."""

    def inject(scene: Scene) -> None:
        for wait_us in (0.0, *on_us):
            scene.machine.advance_us(wait_us)
            scene.machine.power_cut()
            scene.machine.advance_us(AWAY_US)
            scene.machine.power_on()

    return inject


def brown_out(scene: Scene) -> None:
    scene.machine.brown_out()


def reset_pin(scene: Scene) -> None:
    scene.machine.reset()


def cut_and_no_crystal(scene: Scene) -> None:
    scene.machine.rcc.crystal_dead = True
    cut()(scene)


def strap_moved(scene: Scene) -> None:
    """The wiring of another pin set, and a power cycle."""
    pins = (scene.session.identity or scene.session.connect())["PINS"]
    other = next(name for number, name in enumerate(BY_PIN_SET) if number != pins)
    set_strap(scene.machine, other)
    cut()(scene)


def saved(scene: Scene) -> None:
    """The run is over, and the parameters in use are saved."""
    scene.session.execute_idle("SAVE")


FAULTS = (
    Fault("strap-moved", "power", "the strap says another pin set than the saved parameters after a power cycle",
          strap_moved, "power", (BY_POWER, Told("STATUS", "faults", STRAP)), prepare=saved),
    Fault("power-cut", "power", "the supply is away for 5 ms", cut(), "power", (BY_POWER,)),
    Fault("power-cut-again", "power", "the supply is away for 5 ms, and again 1, 3 and 20 ms into the start",
          cut(1_000.0, 3_000.0, 20_000.0), "power", (BY_POWER,)),
    Fault("brown-out", "power", "the supply dips below the reset threshold: half of the RAM's bits are lost", brown_out,
          "power", (BY_POWER,)),
    Fault("power-back-without-crystal", "power", "the supply is away, and the crystal does not start again",
          cut_and_no_crystal, "power", (BY_POWER, Told("IDENTITY", "FAULTS", FALLBACK))),
    Fault("reset-pin", "power", "the reset pin is pulled", reset_pin, "power", (Told("IDENTITY", "RESET_CAUSE", PIN),)),
)  # fmt: skip
