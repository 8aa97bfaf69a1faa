"""A plant on the pins of the virtual board: it drives the pins of the sensors and follows those of the actuators.

How a system's plant is joined to a machine its part `pins` says:

    Coupling(machine, plant)    the plant's time 0 is the first sample of a step that the board takes; it has
        taken                   the samples that the board took, a `Conversion` each
    FRAMES                      what a step sends: the raw counts that the system uses, and what a viewer wants
    SCENARIO                    what a served board's plant does unless told otherwise
    SHOWN, TUNING               what a plant that is only looked at does; the tuning for the board's own sensors
"""

from __future__ import annotations

from collections.abc import Callable

from plumb import systems
from plumb.boards.strap import BY_PIN_SET, set_strap
from plumb.boards.virtual import VirtualBoard
from plumb.boards.virtual_machine import START_US
from plumb.f103.core.timeline import TICKS_PER_S
from plumb.f103.machine import Machine
from plumb.link.identity import FAULT_STRAP
from plumb.link.session import Session
from plumb.systems.contracts import Scenario
from plumb.tuning.quantise import ControlParams, quantise

FOUND_US = 50_000
"""Digital sensors that were just connected are found within this time."""


def sampling_began_s(machine: Machine) -> float:
    """When the timer that paces the board's samples (TIM3) was last started, simulated seconds: the image stops and
    starts it at each RUN_BEGIN, so that every sample since then is a step of that run."""
    return machine.tim3.started_at / TICKS_PER_S


def coupler(system: str, scenario: Scenario) -> Callable[[Machine], None]:
    """What `serve` calls to put a plant on the pins of the machine it serves."""
    pins = systems.load(system, "pins")

    def couple(machine: Machine) -> None:
        pins.Coupling(machine, systems.load(system).plant(scenario))

    return couple


def configure_as(board: VirtualBoard, params: ControlParams, **link: int) -> Session:
    """Make the board this system; link: words of the link's part of the parameters. Strap and pins are read at the
    start alone, so that for others it is rewired and started again, with what it then has saved."""
    session = board.session
    pins = link.get("pins", 0)
    session.upload(params.words(), **{**params.link_words(), **link, "pins": pins})
    if session.require_match()["PINS"] != pins or session.require_match()["FAULTS"] >> FAULT_STRAP & 1:
        set_strap(board.machine, BY_PIN_SET[pins])
        session.execute_idle("SAVE")
        session = board.restart()
    return session


def show(board: VirtualBoard, name: str, scenario: str | None, seed: int) -> None:
    """Make the board this system, and put a plant on its pins that moves as the scenario says, whatever comes back."""
    system, live = systems.load(name), systems.load(name, "pins")
    chosen = system.scenario(scenario or live.SHOWN, seed)
    plant = system.plant(chosen, open_loop=True)
    configure_as(board, quantise(system.TUNINGS[live.TUNING]), period_us=chosen.period_us, **system.LINK)
    live.Coupling(board.machine, plant)
    board.machine.advance_us(FOUND_US)


def boot_configured_as(machine: Machine, name: str, strap: str | None = None) -> None:
    """Make a machine that was just started a system for its own sensors, as `plumb params tuning SYSTEM --save` and a
    reset do, with its strap wired for the system: tuning, period and pin set come out of its flash from then on."""
    system, live = systems.load(name), systems.load(name, "pins")
    with Session.open(machine.uart) as session:
        params = quantise(system.TUNINGS[live.TUNING])
        session.upload(params.words(), **params.link_words(), period_us=system.PERIOD_US, **system.LINK)
        session.execute_idle("SAVE")
    set_strap(machine, strap or BY_PIN_SET[system.LINK.get("pins", 0)])
    machine.reset()
    machine.advance_us(START_US)
