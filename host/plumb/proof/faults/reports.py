"""Reports of the board: which frame and signal reported a fault, and when the host first received it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from plumb.link.identity import BLOCKED, FAULTS, RESET_CAUSES, bits_text, implausible, plausibility_text, sensors_text
from plumb.spec import declarations
from plumb.spec.protocol import protocol

if TYPE_CHECKING:
    from plumb.link.identity import Identity
    from plumb.proof.faults.scene import Heard

MEANINGS: Mapping[str, dict[int, str]] = {
    "disarm_cause": BLOCKED,
    "blocked": BLOCKED,
    "faults": FAULTS,
    "FAULTS": FAULTS,
    "RESET_CAUSE": RESET_CAUSES,
}
"""Signal, or item of IDENTITY -> meaning of its bits, which is that of every system."""
COUNTED = frozenset(
    {
        ("COUNTERS", "rejected"), ("COUNTERS", "lost"), ("COUNTERS", "dropped"), ("EVENTS", "starved"),
        ("CAN_HEALTH", "bus_offs"), ("SENSORS", "bus_failures"),
    }
)  # fmt: skip
"""Signals that are counters: a value other than the one before the fault is a report."""


@dataclass(frozen=True)
class Told:
    """A required report: a signal of a frame, or an item of IDENTITY.

    mask: at least one of these bits must be set; with 0, a counter must have changed, or another signal must not be 0.
    field: these bits hold one number, which must be that of the mask. choice: instead of a mask, the DBC's name of the
    value. value: instead of a mask, exactly this value. passes: all bits of the mask must be 0 again later on.
    """

    frame: str
    signal: str
    mask: int = 0
    choice: str = ""
    value: int | None = None
    passes: bool = False
    field: int = 0

    def holds(self, value: int, before: int) -> bool:
        if self.value is not None:
            return value == self.value
        if self.choice:
            return value == protocol()[self.frame].value(self.signal, self.choice)
        if self.field:
            return value & self.field == self.mask
        if self.mask:
            return bool(value & self.mask)
        return value != before if (self.frame, self.signal) in COUNTED else bool(value)

    def text(self, value: int, system: str) -> str:
        """The report of a board that runs this system, as text."""
        said = report_text(self.frame, self.signal, value, system, self.choice)
        return said + (", and good again" if self.passes else "")


def report_text(frame: str, signal: str, value: int, system: str, choice: str = "") -> str:
    """The report as text: frame, signal and meaning."""
    if choice:
        meaning = choice
    elif frame == "SENSORS" and signal != "bus_failures":
        meaning = "; ".join(sensors_text({signal: value}))
    elif signal == "flags":
        meaning = bits_text(value, {bit: flag.name for bit, flag in enumerate(declarations.system(system).flags)})
    elif signal == "missing":
        meaning = "; ".join(plausibility_text({signal: value}, system))
    elif signal == "disarmed_by":
        meaning = bits_text(value, implausible(system))
    elif signal in MEANINGS:
        meaning = bits_text(value, dict(MEANINGS[signal]))
    else:
        meaning = str(value)
    return f"{frame}.{signal}: {meaning}"


@dataclass
class Reports:
    """All signals received since the injection. before: the counters at the injection, by (frame, signal)."""

    begun_s: float
    before: dict[tuple[str, str], int]
    values: dict[tuple[str, str], list[tuple[float, int]]]

    @classmethod
    def of(cls, heard: Iterable[Heard], begun_s: float, before: dict[tuple[str, str], int]) -> Reports:
        known = protocol().by_identifier
        values: dict[tuple[str, str], list[tuple[float, int]]] = {}
        for frame in heard:
            message = known.get(frame.identifier)
            if message is None or frame.time_s < begun_s or message.name == "IDENTITY":
                continue
            for signal, value in message.decode(frame.data).items():
                values.setdefault((message.name, signal), []).append((frame.time_s, value))
        return cls(begun_s, before, values)

    def add_identity(self, identity: Identity, time_s: float) -> None:
        """Add the identity that the board sent after a restart."""
        for item, value in identity.items.items():
            self.values.setdefault(("IDENTITY", item), []).append((time_s, value))

    def first(self, told: Told) -> tuple[float, int] | None:
        """When the report was heard first, in simulated seconds, and its value."""
        key = told.frame, told.signal
        before, entries = self.before.get(key, 0), self.values.get(key, [])
        for number, entry in enumerate(entries):
            if told.holds(entry[1], before):
                over = any(not value & told.mask for _, value in entries[number + 1 :])
                return entry if over or not told.passes else None
        return None

    def disarmed_s(self) -> float | None:
        """When a frame first said that the board is disarmed."""
        said = [
            time_s
            for name, signal, disarmed in (("STEP", "armed", 0), ("STATUS", "armed", 0))
            for time_s, value in self.values.get((name, signal), [])
            if value == disarmed
        ]
        said += [time_s for time_s, value in self.values.get(("EVENTS", "disarm_cause"), []) if value]
        return min(said, default=None)

    def digests(self) -> dict[int, int]:
        """Step -> digest, of the steps heard."""
        steps, digests = self.values.get(("STEP", "step"), []), self.values.get(("STEP", "digest"), [])
        return {step: digest for (_, step), (_, digest) in zip(steps, digests, strict=True)}
