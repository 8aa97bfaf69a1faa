"""Monitor a running board: combine its telemetry into a snapshot ten times a second.

The monitor only receives; the run decides at its beginning which frames its steps send. A value that has not been
received for STALE_S of the board's time, or of listening to a silent link, is None, so that an old value is never shown
as a present one.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

from plumb.errors import LinkError
from plumb.link.board_frames import PERIODIC
from plumb.link.identity import BLOCKED, FAULTS, NOT_READY, bits_text, implausible, plausibility_text, sensors_text
from plumb.link.retries import REPLY_TIMEOUT_S, TRIES
from plumb.link.selection import RAW_FRAMES, raw_frames_of, selectable
from plumb.link.session import Session
from plumb.link.unarmable import blocked_texts
from plumb.spec import dbc, declarations
from plumb.spec.protocol import Frame, protocol
from plumb.spec.signals import signals

EVERY_S = 0.1
STATUS_EVERY_S = 0.1
STALE_S = 0.5
"""Age at which a value is dropped; the longest period of a run is 0.1 s."""
BATTERY_BITS = 1 << 8 | 1 << 9
"""Bits of PLAUSIBILITY.missing that an armed board reports, too."""
RATE_OVER_S = 1.0
"""Window over which steps_per_s is measured."""
SILENCE_S = TRIES * REPLY_TIMEOUT_S
"""A board that sends nothing for this long counts as lost; an open link carries TIME every 50 ms."""
LINE_FRAMES_PS = 921600 / 10 / 22
"""Capacity of the UART in frames per second: 921600 baud, 22 characters of 10 bits per frame."""
QUATERNION = ("w", "x", "y", "z")
"""Columns of an attitude quaternion; body rates are rate_x_dps to rate_z_dps."""

Snapshot = dict[str, Any]  # Any: a number, a text, a list or None, by the key
"""State of the board at one time; Monitor.snapshot has the keys."""


def selection(period_us: int, system: str, *, raw_first: bool = False) -> tuple[str, ...]:
    """The frames to select so that they fill at most two thirds of the UART, STEP included, at one step per period_us.

    Chosen in declared order, the raw counts last; raw_first: the raw counts in any case, then the others."""
    raw, named = raw_frames_of(system), dbc.frame_names(system)
    room = int(LINE_FRAMES_PS * period_us * 1e-6 * 2 / 3) - 1
    if raw_first:
        return (*raw, *named)[: max(len(raw), room)]
    return (*named, *raw)[: max(1, room)]


@lru_cache(maxsize=1)
def columns() -> tuple[str, ...]:
    """Columns of all systems: the keys of a snapshot that hold signals."""
    return tuple(dict.fromkeys(column for system in declarations.names() for _, column, _ in signals(system)))


@lru_cache(maxsize=1)
def _columns_of_frames() -> dict[int, list[tuple[int, str, float]]]:
    """Identifier -> (position among the words of the frame, column, scale) of every signal of a system."""
    found: dict[int, list[tuple[int, str, float]]] = {}
    for system in declarations.names():
        for (frame, signal), column, scale in signals(system):
            message = protocol()[frame]
            found.setdefault(message.identifier, []).append((message.words.index(signal), column, scale))
    return found


@dataclass
class Extremes:
    """Smallest and largest value of every column, over all frames and not only over those of a snapshot."""

    low: dict[str, float] = field(default_factory=dict)
    high: dict[str, float] = field(default_factory=dict)

    def note(self, column: str, value: float) -> None:
        self.low[column] = min(value, self.low.get(column, value))
        self.high[column] = max(value, self.high.get(column, value))

    def forget(self) -> None:
        """Begin again with the next value."""
        self.low.clear()
        self.high.clear()


@dataclass
class Monitor:
    """Combines received frames: call `feed` with them, and `snapshot` for the present state.

    extremes: where the smallest and largest values are noted, None for nowhere. lost_steps: steps whose STEP did not
    arrive.
    """

    session: Session
    extremes: Extremes | None = None
    lost_steps: int = 0
    _last: dict[str, tuple[int, bytes]] = field(default_factory=dict)
    _step: int | None = None
    _time_us: int = 0
    _passed_us: int = 0
    _clock: deque[tuple[int, int]] = field(default_factory=deque)

    def __post_init__(self) -> None:
        _columns_of_frames(), columns()  # slow the first time: not between a frame and its snapshot

    def feed(self, frames: list[Frame]) -> None:
        messages = self.session.protocol
        for identifier, data in frames:
            message = messages.by_identifier.get(identifier)
            if message is None:
                continue
            name = message.name
            self._last[name] = self._passed_us, data
            if self.extremes is not None:
                self._note_extremes(self.extremes, identifier, data)
            if name == "STEP":
                self._count(messages["STEP"].unpack(data)[2])
            elif name == "TIME":
                _, _, step, time_us = messages["TIME"].unpack(data)
                self._update_clock(step, time_us)

    def _note_extremes(self, extremes: Extremes, identifier: int, data: bytes) -> None:
        described = _columns_of_frames().get(identifier)
        if described is not None:
            words = self.session.protocol.by_identifier[identifier].unpack(data)[2:]
            for position, column, scale in described:
                extremes.note(column, words[position] * scale)

    def _count(self, step: int) -> None:
        gap = 0 if self._step is None else step - self._step - 1 & 0xFFFF
        if gap < 0x8000:  # otherwise the number went back: a new run has begun
            self.lost_steps += gap
        self._step = step

    def _update_clock(self, step: int, time_us: int) -> None:
        """Unwrap the board's clock; a step number that goes back restarts the measurement of steps_per_s."""
        ahead_us = time_us - self._time_us & 0xFFFFFFFF
        self._passed_us += ahead_us if self._clock else 0
        self._time_us += ahead_us
        if self._clock and step - self._clock[-1][1] & 0xFFFF >= 0x8000:
            self._clock.clear()
        self._clock.append((self._time_us, step))
        while self._time_us - self._clock[0][0] > RATE_OVER_S * 1e6:
            self._clock.popleft()

    @property
    def complete(self) -> bool:
        """True once every periodic message has been received."""
        return all(name in self._last for name in PERIODIC)

    def _fresh(self, name: str) -> dict[str, int] | None:
        """The last frame of that name as raw integers; None if it is older than STALE_S."""
        entry = self._last.get(name)
        if entry is None or self._passed_us - entry[0] > STALE_S * 1e6 or self.session.listening.quiet_s > STALE_S:
            return None
        return self.session.protocol[name].decode(entry[1])

    def _values(self) -> dict[str, float | None]:
        """Every column, those of the present system first in declared order; None for a signal that is not received at
        present."""
        system = self.session.parameters.uploaded
        own = [] if system is None else [column for _, column, _ in signals(system)]
        values: dict[str, float | None] = dict.fromkeys((*own, *columns()))
        for system in declarations.names():
            for (message, signal), column, scale in signals(system):
                said = self._fresh(message)
                if said is not None:
                    values[column] = said[signal] * scale
        return values

    def _commands(self, raw: Mapping[str, int]) -> Snapshot:
        """The commands that the newest step used, for a system that has some; raw: the inputs of that step."""
        system = self.session.parameters.uploaded
        declared = None if system is None else declarations.system(system)
        if declared is None or not declared.step_commands:
            return {}
        places = zip(declared.step_commands, declared.command_places(), strict=True)
        words = {one: [raw.get(f"raw_{at + i}") for i in range(one.size)] for one, at in places}
        known = {one.name: one.value([w for w in of if w is not None]) for one, of in words.items() if None not in of}
        return {"commands": known or None}

    def _steps_per_s(self) -> float | None:
        if len(self._clock) < 2:
            return None
        (first_us, first), (last_us, last) = self._clock[0], self._clock[-1]
        return (last - first & 0xFFFF) * 1e6 / (last_us - first_us)

    def snapshot(self) -> Snapshot:
        """The state of the board by name, with the unit in the name; None for what is not received at present."""
        status, counters, events, sensors, plausibility, can = (self._fresh(name) or {} for name in PERIODIC[1:])
        battery = self._fresh("BATTERY") or {}
        step = self._fresh("STEP")
        raw: dict[str, int] = {}
        for name in RAW_FRAMES:
            raw |= self._fresh(name) or {}
        counted = self.session.counters
        mode = status.get("mode")
        values, system = self._values(), self.session.parameters.uploaded
        return {
            "time_s": self._time_us * 1e-6,
            "mode": None if mode is None else self.session.protocol["STATUS"].choice("mode", mode),
            "live": _flag(status, "live"),
            "armed": _flag(status, "armed"),
            "blocked": blocked_texts(self.session, status.get("blocked", 0)) + plausibility_text(plausibility, system),
            "faults": _texts(status.get("faults", 0), FAULTS) + sensors_text(sensors),
            "staged": _flag(status, "staged"),
            "read_only": _flag(status, "read_only"),
            "step": None if step is None else step["step"],
            "steps_per_s": self._steps_per_s(),
            **values,
            "attitude": all_or_none(values, *QUATERNION),
            "rates_dps": all_or_none(values, *(f"rate_{axis}_dps" for axis in QUATERNION[1:])),
            "motors": motors_of(values, system),
            "choices": choices_of(values, system),
            "flags_set": flags_set(values, system),
            "raw": [raw[name] for name in (f"raw_{i}" for i in range(3 * len(RAW_FRAMES))) if name in raw] or None,
            **self._commands(raw),
            "saturated_steps": events.get("saturated"),
            "starved_steps": events.get("starved"),
            "disarm_cause": _texts(events.get("disarm_cause", 0), BLOCKED)
            + _texts(plausibility.get("disarmed_by", 0), implausible(system)),
            "bus_failures": sensors.get("bus_failures"),
            "battery_v": battery["voltage_mv"] / 1000 if "voltage_mv" in battery else None,
            "battery_a": battery["current_10ma"] / 100 if "current_10ma" in battery else None,
            "battery_trouble": _texts(plausibility.get("missing", 0) & BATTERY_BITS, NOT_READY),
            "can_off_bus": _flag(can, "bus_off"),
            "can_transmit_errors": can.get("transmit_errors"),
            "can_receive_errors": can.get("receive_errors"),
            "can_bus_offs": can.get("bus_offs"),
            "board_rejected": counters.get("rejected"),
            "board_lost": counters.get("lost"),
            "board_dropped": counters.get("dropped"),
            "host_rejected": self.session.frames.rejected,
            "host_lost": counted.lost,
            "host_lost_steps": self.lost_steps,
        }


def all_or_none(values: Mapping[str, float | None], *names: str) -> list[float] | None:
    """The named values as a list; None if one of them is missing."""
    known = [value for value in map(values.get, names) if value is not None]
    return known if len(known) == len(names) else None


def motors_of(values: Mapping[str, float | None], system: str | None) -> dict[str, float]:
    """Column -> duty, -1 to 1, of a system that drives several motors; those received at present."""
    declared = None if system is None else declarations.system(system)
    if declared is None:
        return {}
    duties = {word.name for word in declared.output_words if word.format == "Q15"}
    halves = [frame.half.name for frame in declared.frames if frame.half and frame.half.word.name in duties]
    known = {name: value for name in halves if (value := values.get(name)) is not None}
    return known if len(halves) > 1 else {}


def choices_of(values: Mapping[str, float | None], system: str | None) -> dict[str, str]:
    """Column -> meaning of its value, of the words whose values are choices; those received at present."""
    words = () if system is None else declarations.system(system).words
    known = {word.name: (word.choices, values.get(word.name)) for word in words if word.choices}
    return {name: of.get(int(value), f"{value:.0f}") for name, (of, value) in known.items() if value is not None}


def flags_set(values: Mapping[str, float | None], system: str | None) -> list[str] | None:
    """Names of the flags of the newest step; None while they are not received."""
    value = values.get("flags")
    if system is None or value is None:
        return None
    return [flag.name for bit, flag in enumerate(declarations.system(system).flags) if int(value) >> bit & 1]


def _flag(said: dict[str, int], name: str) -> bool | None:
    return bool(said[name]) if name in said else None


def _texts(bits: int, names: dict[int, str]) -> list[str]:
    return bits_text(bits, names).split("; ") if bits else []


def require_frames(session: Session) -> None:
    """Raises LinkError when the link has brought nothing for SILENCE_S of listening, as the board's time passes."""
    if session.listening.silent(SILENCE_S):
        raise LinkError("the board fell silent: check cable and power, then start again")


def read_only(session: Session) -> None:
    """Make the UART link read-only: the board rejects every frame from it. Has no effect on CAN."""
    if session.fast is not None:
        session.fast.write_text(b"L\r")


def present_run(session: Session) -> tuple[str, int]:
    """Mode of the board and tag of the run in progress, as its STATUS and TIME have them; raises LinkError when the
    board does not say within SILENCE_S."""
    said = session.listening.timeout(SILENCE_S)
    while not {"STATUS", "TIME"} <= session.telemetry.keys():
        if said.over:
            raise LinkError("the board sends no status: check cable and power, then start again")
        session.receive(EVERY_S)
    mode = session.protocol["STATUS"].choice("mode", session.telemetry["STATUS"]["mode"])
    return mode, session.telemetry["TIME"]["run_tag"]


def begin_live(session: Session, *, raw_first: bool = False) -> None:
    """Begin a run in real time on the board's own sensors, disarmed, with the frames of `selection`."""
    from plumb.spec.parameter_file import by_name

    period_us = by_name(session.read_parameters())["period_us"]
    wanted = selection(period_us, session.system, raw_first=raw_first)
    session.begin("REALTIME_LIVE", frames=[name for name in selectable(session.system) if name in wanted])


def watch(
    session: Session,
    seconds: float | None = None,
    extremes: Extremes | None = None,
    also: Callable[[list[Frame]], None] | None = None,
) -> Iterator[Snapshot]:
    """Yield a snapshot every EVERY_S of the session's clock, for `seconds` (None: without end).

    extremes: where the smallest and largest value of every column are noted. also: called with all received frames.
    Raises LinkError if nothing is received for SILENCE_S.
    """
    monitor = Monitor(session, extremes)

    def feed(frames: list[Frame]) -> None:
        monitor.feed(frames)
        if also is not None:
            also(frames)

    session.listener = feed
    begin_s = session.clock()
    shown = 0
    try:
        while seconds is None or shown * EVERY_S < seconds - 1e-9:
            due_s = begin_s + (shown + 1) * EVERY_S
            while True:  # once at least: a look that is late shows what has come meanwhile
                session.receive(max(due_s - session.clock(), EVERY_S / 10))
                require_frames(session)
                if monitor.complete and session.clock() >= due_s:
                    break
            shown += 1
            yield monitor.snapshot()
    finally:
        session.listener = None
