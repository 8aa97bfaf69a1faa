"""Hangs: the main loop, each interrupt handler, masked interrupts, a core that locks up, a tick that stops."""

from __future__ import annotations

from plumb.f103.core.nvic import IRQ0, SYSTICK
from plumb.proof.faults import core
from plumb.proof.faults.fault import Action, Fault
from plumb.proof.faults.outputs import PROGRAM, RESET
from plumb.proof.faults.reports import Told
from plumb.proof.faults.scene import Scene

BY_WINDOW_WATCHDOG = Told("IDENTITY", "RESET_CAUSE", 1 << 6)
BY_WATCHDOG = Told("IDENTITY", "RESET_CAUSE", 1 << 5)
STALLED = Told("STATUS", "faults", 1 << 13)
DISARMED_BY_FAULT = Told("EVENTS", "disarm_cause", 1 << 3)
PAUSE_S = 0.035
"""Longer than the stall watch allows, shorter than the window watchdog allows, and long enough for a waiting keep-alive
to be late after it."""
KEEPALIVE_S, MOMENTS = 0.01, 12
"""Period of the values that the board sends, and moments in it at which a pause begins."""
PULSES_PAUSE_S, PAUSES, LONGER_S = 0.0325, 12, 0.0002
"""Shortest pause, number of pauses, and their increment; together they cover a frame of pulses, 2.5 ms here. A pulse
that is written after the pause reaches the pin only when a frame ends before the next tick of 1 ms writes neutral. The
first neutral began a frame 2.1 ms behind a tick, so that frames end 0.1 or 0.6 ms behind a tick from then on: the
pauses have one of the latter."""
IRQS = {
    "adc-dma": 11, "spi-dma": 12, "uart-tx-dma": 14, "uart-rx-dma": 15, "i2c-dma": 17, "can-tx": 19, "can-rx0": 20,
    "pulse-train": 27, "hall": 28, "steps": 29, "i2c-events": 31, "i2c-errors": 32, "uart": 37, "receiver": 39,
}  # fmt: skip
"""Interrupts that an image enables, whose handlers may hang, by what raises them (RM0008 table 63)."""


def loop_hangs(scene: Scene) -> None:
    core.patch_the_loop(scene, core.FOREVER)


def loop_hangs_masked(scene: Scene) -> None:
    core.patch_the_loop(scene, core.MASK_INTERRUPTS + core.FOREVER)


def loop_hangs_without(*causes: str) -> Action:
    """The main loop hangs with interrupts masked, and these resets fail."""

    def inject(scene: Scene) -> None:
        core.hold_off(scene, *causes)
        loop_hangs_masked(scene)

    return inject


def between_keepalives(scene: Scene) -> None:
    """Let a part of the keep-alive's period pass: by its length the waiting keep-alive is late after the pause, or
    not."""
    scene.run(scene.variant * KEEPALIVE_S / MOMENTS)


def loop_pauses(scene: Scene) -> None:
    """The main loop branches to itself for a while, then continues."""
    core.reach_the_loop(scene)
    core.pause_at(scene, scene.machine.cpu.pc, PAUSE_S)


def reaches_the_pulses(scene: Scene) -> None:
    """Let time pass until the next instructions write pulses that drive."""
    core.pause_at(scene, scene.symbol(scene.pulses.function).address, 0.0)


def loop_pauses_before_the_pulses(scene: Scene) -> None:
    """The main loop pauses just before the instructions that write driving pulses, for several lengths."""
    core.pause_at(scene, scene.symbol(scene.pulses.function).address, PULSES_PAUSE_S + scene.variant * LONGER_S)


def handler_hangs(number: int) -> Action:
    """The handler of an exception never returns, and is entered at once."""

    def inject(scene: Scene) -> None:
        core.patch_handler(scene, number, core.FOREVER)
        scene.machine.nvic.pend(number)

    return inject


def tick_stops(scene: Scene) -> None:
    """SysTick stops: the board's clock stands still."""
    systick = scene.machine.systick
    systick.ctrl = 0
    scene.machine.timeline.cancel("systick")


def locked_up(scene: Scene) -> None:
    """A fault while the stack pointer is wild: the core locks up."""
    core.reach_the_loop(scene)
    scene.machine.cpu.locked_up = "injected"


FAULTS = (
    Fault("loop-hangs", "hangs", "the main loop branches to itself", loop_hangs, "stall", (BY_WINDOW_WATCHDOG,),
          by=PROGRAM),
    Fault("loop-pauses", "hangs", "the main loop branches to itself for 35 ms", loop_pauses, "stall",
          (STALLED, DISARMED_BY_FAULT), prepare=between_keepalives, by=PROGRAM, variants=MOMENTS),
    Fault("loop-pauses-before-the-pulses", "hangs", "the main loop branches to itself for 30 ms, then writes pulses",
          loop_pauses_before_the_pulses, "stall", (STALLED, DISARMED_BY_FAULT), frozenset({"esc"}),
          prepare=reaches_the_pulses, by=PROGRAM, variants=PAUSES),
    Fault("loop-hangs-masked", "hangs", "interrupts are masked, and the main loop branches to itself",
          loop_hangs_masked, "hang", (BY_WINDOW_WATCHDOG,), by=RESET),
    Fault("loop-hangs-without-window-watchdog", "hangs",
          "interrupts are masked, the main loop branches to itself, and the window watchdog does not reset",
          loop_hangs_without("wwdg"), "last", (BY_WATCHDOG,), by=RESET),
    Fault("tick-handler-hangs", "hangs", "the handler of SysTick branches to itself", handler_hangs(SYSTICK), "hang",
          (BY_WINDOW_WATCHDOG,), by=RESET),
    Fault("tick-stops", "hangs", "SysTick counts no more", tick_stops, "hang", (BY_WINDOW_WATCHDOG,), by=RESET),
    Fault("core-locks-up", "hangs", "the core locks up", locked_up, "hang", (BY_WINDOW_WATCHDOG,), by=RESET),
    *(
        Fault(f"{name}-handler-hangs", "hangs", f"the handler of interrupt {number} ({name}) branches to itself",
              handler_hangs(IRQ0 + number), "stall", (BY_WINDOW_WATCHDOG,), by=PROGRAM, interrupt=IRQ0 + number)
        for name, number in IRQS.items()
    ),
)  # fmt: skip
