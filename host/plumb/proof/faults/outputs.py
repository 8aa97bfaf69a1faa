"""Measure at the pins when the outputs are unsafe: pulses of speed controllers and gates of the bridge."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from plumb.f103.core.timeline import TICKS_PER_US
from plumb.f103.machine import PWM_PINS

if TYPE_CHECKING:
    from plumb.f103.machine import Machine

LOOK_US = 100
"""Time between two looks, and the resolution of every time that is measured here."""
SAFE_PULSE_US = (900.0, 1100.0)
"""A speed controller stops its motor for a pulse of this length, and without any pulse."""
PHASES = 3


def unsafe(machine: Machine) -> bool:
    """Whether a motor may turn now: a pulse outside SAFE_PULSE_US on any pin that carries pulses, or a gate of the
    bridge that is driven on."""
    shortest, longest = SAFE_PULSE_US
    for pin in PWM_PINS:
        pulse = machine.pwm(pin)
        if pulse.enabled and not shortest <= pulse.pulse_us <= longest:
            return True
    bridge = machine.bridge()
    if not bridge.enabled:
        return False
    return any(share is not None for share in bridge.duty) or gate_on(machine)


def gate_on(machine: Machine) -> bool:
    """Whether a gate is high at this moment."""
    return any(True in machine.tim1.levels(phase, machine.now) for phase in range(PHASES))


@dataclass
class Watch:
    """Checks the outputs every LOOK_US from `begin` on, while simulated time passes."""

    machine: Machine
    begun: int = 0
    last_unsafe: int | None = None
    resets: list[int] = field(default_factory=list)
    """When the board was found to have been reset."""
    _reset_count: int = 0

    def begin(self) -> None:
        self.begun, self.last_unsafe = self.machine.now, None
        self.resets.clear()
        self._reset_count = self.machine.reset_count
        self._look(self.begun)

    def end(self) -> None:
        self.machine.timeline.cancel("watch")

    def _look(self, now: int) -> None:
        if unsafe(self.machine):
            self.last_unsafe = now
        if self.machine.reset_count != self._reset_count:
            self._reset_count = self.machine.reset_count
            self.resets.append(now)
        self.machine.timeline.at("watch", now + LOOK_US * TICKS_PER_US, self._look)

    def ms(self, time: int) -> float:
        return round((time - self.begun) / (1000 * TICKS_PER_US), 1)

    @property
    def safe_ms(self) -> float | None:
        """From `begin` until the outputs are safe for good; None when the last look found them unsafe."""
        if self.last_unsafe is None:
            return 0.0
        safe = self.last_unsafe + LOOK_US * TICKS_PER_US
        return None if safe >= self.machine.now else self.ms(safe)
