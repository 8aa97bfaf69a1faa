"""The scene of every fault: the flash image on the virtual board, its plant on the pins, armed and driving, or
estimating where it drives nothing."""

from __future__ import annotations

import itertools
import random
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, NamedTuple

import can

from plumb import systems
from plumb.boards import plant_on_pins
from plumb.boards.contract import SimulatedBoard
from plumb.boards.virtual import VirtualBoard
from plumb.contract.parameters import quantise
from plumb.contract.scenario import fitted, link_words
from plumb.errors import LinkError, UsageError
from plumb.f103.core.timeline import TICKS_PER_S
from plumb.f103.peripherals.tim import Timer
from plumb.f103.snapshot import Snapshot
from plumb.flash.elf import Elf, Symbol
from plumb.flash.image import find_image
from plumb.link import parameter_table
from plumb.link.identity import Identity
from plumb.link.monitor import selection
from plumb.link.session import Session
from plumb.proof.faults import pilot
from plumb.proof.faults.pilot import PILOT, RIDER, Pilot, flies, rides
from plumb.proof.faults.sample_source import Source
from plumb.spec import declarations, images
from plumb.spec.parameter_file import by_name
from plumb.spec.protocol import Frame, protocol
from plumb.spec.system import AXIS, RIDE
from plumb.systems.contracts import PINS, AnalogPins, BridgePins, CommandedPins, Coupling, Pins, SensorSets

if TYPE_CHECKING:
    from plumb.f103.machine import Machine

SEED = 1
DRIVING_S = 0.5
"""Time armed before the fault: the outputs are away from neutral, and the estimate has converged."""
ESTIMATE = "estimate"
CHECKED = "checked"
"""A feature: implausible sensors disarm. A vehicle that flies is never disarmed by that."""
HELD_BY_ITSELF = "held by itself"
"""A feature: the outputs are away from neutral with the setpoint 0; a setpoint that ceases does not stop them."""
LINKED = "linked"
"""A feature: another link than the owner's may give the setpoint."""
RECEIVER = "receiver"
"""In place of a host's link: what armed the scene. A host on serial listens."""
ARMING_S = 3.0
"""Longest time to arming, while the sensors come up and the estimate converges."""
LISTEN_S = 0.001
"""Interval at which the host reads its link; frames get the time of that reading."""


@dataclass(frozen=True)
class Heard:
    """A frame from the board, and the simulated time in s at which the host received it."""

    time_s: float
    identifier: int
    data: bytes


class Pulses(NamedTuple):
    """function: of the image, writes them; timer: gives them."""

    function: str
    timer: Timer


@dataclass
class Scene:
    """Build it with `driving`. heard: the frames that came since `listen_anew`. kept_back: frames of the host that a
    fault holds back, and when the host wrote them.

    host_alive: when False, the host sends nothing but still listens. deaf: the host receives nothing.
    variant: number of the variant to inject, from 0 on. notes, stuck: numbers and frames that an injection
    keeps from its preparation. source: of injected samples. pilot: his receiver, where he has armed the board.
    """

    name: str
    link: str
    board: SimulatedBoard
    coupling: Coupling
    image: Path | None = None
    heard: list[Heard] = field(default_factory=list)
    sent: list[Frame] = field(default_factory=list)
    kept_back: list[tuple[float, Frame]] = field(default_factory=list)
    host_alive: bool = True
    deaf: bool = False
    variant: int = 0
    notes: dict[str, int] = field(default_factory=dict)
    stuck: list[Frame] = field(default_factory=list)
    source: Source | None = None
    pilot: Pilot | None = None

    @property
    def machine(self) -> Machine:
        return self.board.machine

    @property
    def session(self) -> Session:
        return self.board.session

    @property
    def live(self) -> Pins:
        return systems.load(self.name, PINS)

    @property
    def period_s(self) -> float:
        """Of its steps."""
        return systems.load(self.name).TUNINGS[self.live.TUNING].period_us * 1e-6

    @property
    def adc_pins(self) -> tuple[str, ...]:
        """The pins of the raw channels; () where the sensors are digital."""
        return self.live.ADC_PINS if isinstance(self.live, AnalogPins) else ()

    @property
    def break_pin(self) -> str:
        """The pin at which the bridge's driver reports a fault. Raises UsageError where there is no bridge."""
        if not isinstance(self.live, BridgePins):
            raise UsageError(f"{self.name} drives no bridge")
        return self.live.BREAK_PIN

    @property
    def pulses(self) -> Pulses:
        """The outputs to its speed controllers. Raises UsageError where there are none."""
        output = declarations.system(self.name).output
        if output == "PULSES":
            return Pulses("board_set_actuator", self.machine.tim4)
        if output == "ROTORS":
            return Pulses("board_set_rotors", self.machine.tim2)
        raise UsageError(f"{self.name} drives no speed controllers")

    def symbol(self, name: str) -> Symbol:
        """A variable or function of the image, from the ELF file beside it. Raises UsageError without that file."""
        elf = Elf(find_image(self.image or images.running(self.name)).with_suffix(".elf"))
        found = elf.symbols.get(name)
        if found is None:
            raise UsageError(f"{elf.path} has no symbol '{name}': this table belongs to another image")
        return found

    @property
    def features(self) -> frozenset[str]:
        """Parts that a fault can break: analog (sensors on ADC pins), chips (on I2C), bridge, break (its
        input), esc (speed controllers); estimate of a system that drives nothing; and the features above."""
        inputs, declared = "analog" if isinstance(self.live, AnalogPins) else "chips", declarations.system(self.name)
        if not systems.load(self.name).OUTPUT_FRAMES:
            return frozenset({inputs, ESTIMATE})
        found = {
            inputs: True,
            "bridge": declared.output == "BRIDGE",
            "break": isinstance(self.live, BridgePins),
            "esc": declared.output in ("PULSES", "ROTORS"),
            CHECKED: declared.checks in (AXIS, RIDE),
            HELD_BY_ITSELF: not isinstance(self.live, CommandedPins),
            LINKED: declared.command_source == "link",
            PILOT: flies(self.name),
            RIDER: rides(self.name),
        }
        return frozenset(name for name, is_there in found.items() if is_there)

    @property
    def says_armed(self) -> bool:
        """True when the last STATUS says that the board is armed."""
        return bool(self.session.telemetry.get("STATUS", {}).get("armed", 0))

    @property
    def now_s(self) -> float:
        return self.session.clock()

    @property
    def next_step(self) -> int:
        """The number that makes a SETPOINT new now; another number is refused because of its age."""
        return self.session.setpoint.next_step & 0xFFFF

    def snapshot(self) -> Snapshot:
        """A snapshot of the board, its plant, the host and this scene."""
        return self.machine.snapshot(self)

    def listen_anew(self) -> None:
        """Drop the recorded frames, and record every frame from now on."""
        self.heard.clear()
        self.session.listener = self._note

    def abandon(self) -> None:
        """Drop the connection without telling the board."""
        can.BusABC.shutdown(self.session.bus)

    def reconnect(self) -> None:
        """Connect anew as the same host, and continue to listen."""
        self.abandon()
        self.board.reconnect().listener = self._note
        self.host_alive, self.deaf = True, False

    def _note(self, frames: list[Frame]) -> None:
        if self.deaf:
            return
        now_s = self.now_s
        self.heard += [Heard(now_s, identifier, data) for identifier, data in frames]

    def listen(self, wait_s: float) -> list[Frame]:
        """Receive frames while the host only listens."""
        frames = self.session.frames.read_frames(wait_s)
        self._note(frames)
        return frames

    def record(self) -> None:
        """Record every frame that the host sends from now on, as it is on the wire."""
        write = self.session.frames.write_frames

        def write_and_note(frames: Sequence[Frame]) -> None:
            self.sent.extend(frames)
            write(frames)

        vars(self.session.frames)["write_frames"] = write_and_note

    def recorded(self, name: str) -> list[Frame]:
        """The frames of a message that the host has sent since `record`."""
        identifier = protocol()[name].identifier
        return [frame for frame in self.sent if frame[0] == identifier]

    def run(self, seconds: float) -> None:
        """Let time pass: the host answers keep-alives and listens; when it is not alive it only listens."""
        end = self.machine.now + round(seconds * TICKS_PER_S)
        while self.machine.now < end:
            wait_s = min(LISTEN_S, (end - self.machine.now) / TICKS_PER_S)
            if self.source is not None:
                self.source.send_due(self.session)
            if self.pilot is not None:
                self.pilot.send_due(self.machine)
            if self.host_alive:
                self.session.receive(wait_s)
            else:
                self.listen(wait_s)

    def send_again(self, frames: Sequence[Frame], seconds: float, every_s: float) -> None:
        """Another sender repeats these frames for `seconds`, byte for byte."""
        end_s = self.now_s + seconds
        for frame in itertools.cycle(frames):
            if self.now_s >= end_s:
                break
            self.session.frames.write_frames([frame])
            self.run(every_s)

    def run_until(self, holds: Callable[[], bool], limit_s: float) -> bool:
        """Let time pass until holds() is true, checked every LISTEN_S; False when the limit comes first."""
        end = self.machine.now + round(limit_s * TICKS_PER_S)
        while not holds():
            if self.machine.now >= end:
                return False
            self.run(LISTEN_S)
        return True

    def identify(self) -> Identity:
        """Connect again and read the identity, as after a reset. Raises LinkError if the board does not answer."""
        self.reconnect()
        return self.session.connect()


def scenarios_of(name: str) -> tuple[str, ...]:
    """The scenarios in which faults are injected: one for each set of sensors that the system can have, or "" for the
    scenario of a served board."""
    parts = systems.load(name, PINS)
    return parts.SENSOR_SETS if isinstance(parts, SensorSets) else ("",)


def driving(
    name: str,
    link: str = "serial",
    image: Path | None = None,
    scenario_name: str = "",
    changes: Mapping[str, int] = MappingProxyType({}),
    period_us: int | None = None,
) -> Scene:
    """A system with its plant on the pins of the virtual board, running over `link` for DRIVING_S; one that drives
    something is armed, by the host over that link, or with RECEIVER by its pilot.

    The plant runs the scenario, by default that of a served board, in closed loop. changes: words of the
    parameter table that replace those of the scenario. period_us: another period than the tuning's, at which the board
    sends the frames that its UART has room for. Raises LinkError with the board's reason when it does not arm
    within ARMING_S.
    """
    system, parts = systems.load(name), systems.load(name, PINS)
    tuning, frames = system.TUNINGS[parts.TUNING], parts.FRAMES
    if period_us is not None:
        tuning, frames = replace(tuning, period_us=period_us), selection(period_us, name)
    scenario = system.scenario(scenario_name or parts.SCENARIO, SEED, period_us=tuning.period_us)
    by_pilot = link == RECEIVER
    board = VirtualBoard(image, link="serial" if by_pilot else link)
    try:
        params = quantise(fitted(scenario, tuning))
        given = link_words(system, scenario) | (pilot.words(name) if by_pilot else {})
        session = plant_on_pins.configure_as(board, params, period_us=scenario.period_us, arm_hold_ms=0, **given)
        if changes:
            parameter_table.commit(session, {**by_name(parameter_table.read_table(session)), **changes})
        coupling = parts.couple(board.machine, system.plant(scenario))
        scene = Scene(name, link, board, coupling, image)
        board.machine.uart.timeout = LISTEN_S
        board.machine.advance_us(plant_on_pins.FOUND_US)
        session.begin("REALTIME_LIVE", frames=frames)
        if by_pilot:
            arm_by_receiver(scene)
        elif system.OUTPUT_FRAMES:
            arm(scene)
            command(scene)
        scene.run(DRIVING_S)
    except BaseException:
        board.close()
        raise
    return scene


def arm(scene: Scene) -> None:
    """Arm as soon as the board allows it; raises LinkError with its reason after ARMING_S."""
    end_s = scene.now_s + ARMING_S
    while True:
        try:
            scene.session.arm()
            return
        except LinkError:
            if scene.now_s > end_s:
                raise
        scene.run(0.05)


def arm_by_receiver(scene: Scene) -> None:
    """The pilot arms by his switch once the vehicle has stood for long enough, and raises the throttle, or rides ahead;
    raises LinkError when the board does not arm."""
    scene.pilot = held = Pilot(scene.machine.now_s)
    scene.run(pilot.STANDS_S if flies(scene.name) else pilot.HELD_S)
    held.says = (0.0, True)
    if not scene.run_until(lambda: scene.says_armed, pilot.SWITCH_S):
        raise LinkError("the switch of the receiver did not arm the board")
    if isinstance(scene.live, CommandedPins):
        held.says = (scene.live.DRIVING[0] / 32767, True)
    else:
        held.pitch = pilot.RIDDEN
        scene.run(pilot.RIDES_S)


def command(scene: Scene) -> None:
    """Set the inputs of a system whose outputs rest without."""
    if isinstance(scene.live, CommandedPins):
        setpoint, commands = scene.live.DRIVING
        scene.session.set_commands(commands, setpoint)


def noise(seed: str, sigma: float) -> Callable[[float], float]:
    """Gaussian noise as a function of time: seeded, and the same value for the same instant."""
    return lambda time_s: sigma * random.Random(f"{seed} {time_s!r}").gauss(0.0, 1.0)
