"""Measure at the pins when the outputs are unsafe: pulses of speed controllers, motors and gates of the bridge."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from plumb.f103.core.timeline import TICKS_PER_US
from plumb.f103.machine import PWM_PINS
from plumb.f103.peripherals.tim1 import LOW_PINS
from plumb.spec.speed_controllers import FRAME_MAX_US, FRAME_MIN_US, GAP_HALFUS, PULSE_US

if TYPE_CHECKING:
    from plumb.f103.machine import Machine

LOOK_US = 100
"""Interval of the checks, and the resolution of every time that is measured here."""
SAFE_PULSE_US = (900.0, 1050.0)
"""A speed controller stops its motor for a pulse of this length, and without any pulse."""
PHASES = 3
PROGRAM, RESET = "the program", "a reset"
"""The layer that made the outputs safe: instructions that set neutral pulses and open gates, or a reset that released
the pins."""


def unsafe(machine: Machine) -> bool:
    """Whether a motor may turn now: a pulse outside SAFE_PULSE_US on any pin that carries pulses, a motor whose PWM is
    on, or a gate of the bridge that is driven on."""
    shortest, longest = SAFE_PULSE_US
    for pin in PWM_PINS:
        pulse = machine.pwm(pin)
        if pulse.enabled and not shortest <= pulse.pulse_us <= longest:
            return True
    if any(machine.duty(pin) is not None for pin in LOW_PINS):
        return True
    bridge = machine.bridge()
    if not bridge.enabled:
        return False
    return any(share is not None for share in bridge.duty) or gate_on(machine)


def out_of_bounds(machine: Machine) -> bool:
    """Whether a pin carries a pulse that no speed controller may ever get, armed or not: too short, too long, in a
    frame too short or too long, or without a gap before the next."""
    shortest, longest = PULSE_US
    pulses = [pulse for pin in PWM_PINS if (pulse := machine.pwm(pin)).enabled]
    return not all(
        shortest <= pulse.pulse_us <= longest
        and FRAME_MIN_US <= pulse.period_us <= FRAME_MAX_US
        and pulse.period_us - pulse.pulse_us >= GAP_HALFUS / 2
        for pulse in pulses
    )


def gate_on(machine: Machine) -> bool:
    """Whether a gate is high at this moment."""
    return any(True in machine.tim1.levels(phase, machine.now) for phase in range(PHASES))


@dataclass
class Watch:
    """Checks the outputs every LOOK_US from `begin` on, while simulated time passes."""

    machine: Machine
    begun: int = 0
    last_unsafe: int | None = None
    out_of_bounds: int | None = None
    """When a pulse was first found out of its bounds."""
    resets: list[int] = field(default_factory=list)
    """When the board was found to have been reset."""
    _reset_count: int = 0

    def begin(self) -> None:
        self.begun, self.last_unsafe, self.out_of_bounds = self.machine.now, None, None
        self.resets.clear()
        self._reset_count = self.machine.reset_count
        self._look(self.begun)

    def end(self) -> None:
        self.machine.timeline.cancel("watch")

    def _look(self, now: int) -> None:
        if unsafe(self.machine):
            self.last_unsafe = now
        if self.out_of_bounds is None and out_of_bounds(self.machine):
            self.out_of_bounds = now
        if self.machine.reset_count != self._reset_count:
            self._reset_count = self.machine.reset_count
            self.resets.append(now)
        self.machine.timeline.at("watch", now + LOOK_US * TICKS_PER_US, self._look)

    def ms(self, time: int) -> float:
        return round((time - self.begun) / (1000 * TICKS_PER_US), 1)

    @property
    def made_safe_by(self) -> str:
        """Which layer ended the last unsafe moment: RESET, when the reset came with it, else PROGRAM."""
        after = None if self.last_unsafe is None else self.last_unsafe + LOOK_US * TICKS_PER_US
        return RESET if after in self.resets else PROGRAM

    @property
    def safe_ms(self) -> float | None:
        """From `begin` until the outputs stay safe; None when the last check found them unsafe."""
        if self.last_unsafe is None:
            return 0.0
        safe = self.last_unsafe + LOOK_US * TICKS_PER_US
        return None if safe >= self.machine.now else self.ms(safe)
