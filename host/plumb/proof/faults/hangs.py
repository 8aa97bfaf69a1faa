"""Hangs: the main loop, each interrupt handler, masked interrupts, a core that locks up, a tick that stops."""

from __future__ import annotations

from plumb.f103.core.nvic import IRQ0, SYSTICK
from plumb.proof.faults import core
from plumb.proof.faults.fault import Action, Fault
from plumb.proof.faults.reports import Told
from plumb.proof.faults.scene import Scene

WATCHDOG = 1 << 5 | 1 << 6
STALLED = 1 << 13
NOTICED = (Told("IDENTITY", "RESET_CAUSE", WATCHDOG), Told("STATUS", "faults", STALLED))
IRQS = {
    "adc-dma": 11, "spi-dma": 12, "uart-tx-dma": 14, "uart-rx-dma": 15, "i2c-dma": 17, "can-tx": 19, "can-rx0": 20,
    "can-rx1": 21, "can-errors": 22, "hall": 28, "steps": 29, "i2c-events": 31, "i2c-errors": 32, "uart": 37,
}  # fmt: skip
"""Interrupts whose handlers may hang, by what raises them (RM0008 table 63)."""


def loop_hangs(scene: Scene) -> None:
    core.patch_the_loop(scene, core.FOREVER)


def loop_hangs_masked(scene: Scene) -> None:
    core.patch_the_loop(scene, core.MASK_INTERRUPTS + core.FOREVER)


def handler_hangs(number: int) -> Action:
    """The handler of an exception never returns, and is entered at once."""

    def inject(scene: Scene) -> None:
        core.patch_handler(scene, number, core.FOREVER)
        scene.machine.nvic.pend(number)

    return inject


def tick_stops(scene: Scene) -> None:
    """SysTick counts no more: the board's clock stands still."""
    systick = scene.machine.systick
    systick.ctrl = 0
    scene.machine.timeline.cancel("systick")


def locked_up(scene: Scene) -> None:
    """A fault while the stack pointer is wild: the core locks up."""
    core.reach_the_loop(scene)
    scene.machine.cpu.locked_up = "injected"


FAULTS = (
    Fault("loop-hangs", "hangs", "the main loop branches to itself", loop_hangs, "hang", (NOTICED,)),
    Fault("loop-hangs-masked", "hangs", "interrupts are masked, and the main loop branches to itself",
          loop_hangs_masked, "hang", (NOTICED,)),
    Fault("tick-handler-hangs", "hangs", "the handler of SysTick branches to itself", handler_hangs(SYSTICK), "hang",
          (NOTICED,)),
    Fault("tick-stops", "hangs", "SysTick counts no more", tick_stops, "hang", (NOTICED,)),
    Fault("core-locks-up", "hangs", "the core locks up", locked_up, "hang", (NOTICED,)),
    *(
        Fault(f"{name}-handler-hangs", "hangs", f"the handler of interrupt {number} ({name}) branches to itself",
              handler_hangs(IRQ0 + number), "hang", (NOTICED,), interrupt=IRQ0 + number)
        for name, number in IRQS.items()
    ),
)  # fmt: skip
