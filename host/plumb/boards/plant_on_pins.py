"""A plant on the pins of the virtual board: it drives the sensor pins and reads the actuator pins.

The module `pins` of a system says how its plant is attached to a machine (plumb.systems.contracts.Pins).
"""

from __future__ import annotations

from collections.abc import Callable

from plumb import systems
from plumb.boards.contract import SimulatedBoard
from plumb.boards.link import LinkBoard
from plumb.boards.strap import BY_PIN_SET, set_strap
from plumb.boards.virtual_machine import START_US
from plumb.contract.parameters import ControlParams, quantise
from plumb.contract.scenario import Plant, Scenario, calibrated_words, fitted, link_words, sensor_words
from plumb.f103.core.timeline import TICKS_PER_S, TICKS_PER_US
from plumb.f103.machine import Machine
from plumb.link.identity import FAULT_STRAP
from plumb.link.session import Session
from plumb.spec import crsf, declarations
from plumb.systems.contracts import PINS, Coupling

FOUND_US = 50_000
"""The board finds digital sensors within this time after they are connected."""


def sampling_began_s(machine: Machine) -> float:
    """Simulated seconds at which the board's sampling timer (TIM3) was last started. The firmware restarts it at each
    RUN_BEGIN, so that every sample since then is a step of that run."""
    return machine.tim3.started_at / TICKS_PER_S


def coupler(system: str, plant: Plant) -> Callable[[Machine], None]:
    """A function that attaches a plant of this system to a machine, for `open_machine`."""
    pins = systems.load(system, PINS)

    def couple(machine: Machine) -> None:
        pins.couple(machine, plant)

    return couple


def configure_as(board: SimulatedBoard, params: ControlParams, **link: int) -> Session:
    """Configure the board for these parameters; link: parameters outside the control step, by name. The firmware reads
    strap and pin set only at start: for another pin set the parameters are saved, the strap is rewired and the board is
    restarted."""
    session = board.hold(params.system)
    pins = link.get("pins", 0)
    session.upload(params.words(), **{**params.link_words(), **link, "pins": pins})
    if session.require_match()["PINS"] != pins or session.require_match()["FAULTS"] >> FAULT_STRAP & 1:
        set_strap(board.machine, BY_PIN_SET[pins])
        session.execute_idle("SAVE")
        session = board.restart()
    return session


def show(board: SimulatedBoard, name: str, scenario: str | None, seed: int, *, open_loop: bool = True) -> None:
    """Configure the board for this system, and attach a plant. open_loop: it follows the scenario and ignores the
    outputs."""
    system, live = systems.load(name), systems.load(name, PINS)
    chosen, plant = plant_of(name, scenario, seed, open_loop=open_loop)
    params = quantise(fitted(chosen, system.TUNINGS[live.TUNING]))
    configure_as(board, params, period_us=chosen.period_us, **link_words(system, chosen))
    live.couple(board.machine, plant)
    board.machine.advance_us(FOUND_US)


class PlantOfRuns:
    """A plant that restarts with every run; only the first run configures the board."""

    def __init__(self, system: str, scenario: str | None, seed: int, *, open_loop: bool) -> None:
        plant_of(system, scenario, seed, open_loop=open_loop)  # raises UsageError for an unknown name
        self._system, self._scenario, self._seed, self._open_loop = system, scenario, seed, open_loop
        self._configured = False

    def attach(self, board: LinkBoard) -> None:
        """Put the plant on the pins of a simulated board; the first time, configure the board for the system."""
        assert isinstance(board, SimulatedBoard)
        if not self._configured:
            self._configured = True
            show(board, self._system, self._scenario, self._seed, open_loop=self._open_loop)
            return
        _, plant = plant_of(self._system, self._scenario, self._seed, open_loop=self._open_loop)
        systems.load(self._system, PINS).couple(board.machine, plant)
        board.machine.advance_us(FOUND_US)


def plant_of(name: str, scenario: str | None, seed: int, *, open_loop: bool) -> tuple[Scenario, Plant]:
    """The scenario and the plant for the pins of a board; scenario None: the system's default
    for open or closed loop. Raises UsageError for a system that has no pins, or not that scenario."""
    system, live = systems.load(name), systems.load(name, PINS)
    period_us = system.TUNINGS[live.TUNING].period_us
    chosen = system.scenario(scenario or (live.SHOWN if open_loop else live.SCENARIO), seed, period_us=period_us)
    return chosen, system.plant(chosen, open_loop=open_loop)


class PilotOnLine:
    """The pilot of a plant: the frames of his receiver go to the line of the board's receiver as CRSF, once a period,
    from now on. coupling: that of the plant; its time 0 is the first sample that the board reads. armed: the switch of
    the motors stays off until it is set, because a board is not armed over a switch that is on."""

    def __init__(self, machine: Machine, plant: Plant, coupling: Coupling, system: str, period_us: int) -> None:
        self._machine, self._plant, self._coupling = machine, plant, coupling
        self._counts, self._period = declarations.system(system).counts, period_us * TICKS_PER_US
        self._pilot, self.armed = crsf.Pilot(), False
        self._send(machine.now)

    def _send(self, now: int) -> None:
        taken = self._coupling.taken
        time_s = self._machine.now_s - taken[0].time_s if taken else 0.0
        commands = list(self._plant.counts(time_s)[self._counts :])
        if not self.armed:
            commands[crsf.SWITCHES_AT] &= ~crsf.MOTORS_ON
        if said := self._pilot.frames(self._plant.setpoint(time_s), commands):
            self._machine.usart3.receive(said)
        self._machine.timeline.at("pilot", now + self._period, self._send)


def boot_configured_as(machine: Machine, name: str, strap: str | None = None, *, calibrated: bool = False) -> None:
    """Configure a machine that was just started to run a system on its own sensors, as `plumb params tuning SYSTEM
    --save` and a reset do, and wire its strap: from then on it starts with this tuning, period and pin set from its
    flash. calibrated: it says that its sensors were."""
    system, live = systems.load(name), systems.load(name, PINS)
    tuning = system.TUNINGS[live.TUNING]
    with Session.open(machine.uart) as session:
        params = quantise(tuning)
        link = {**params.link_words(), **system.LINK, **sensor_words(system, live.TUNING)}
        link |= calibrated_words(name) if calibrated else {}
        session.upload(params.words(), period_us=tuning.period_us, **link)
        session.execute_idle("SAVE")
    set_strap(machine, strap or BY_PIN_SET[system.LINK.get("pins", 0)])
    machine.reset()
    machine.advance_us(START_US)
