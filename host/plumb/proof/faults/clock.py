"""Faults of clocks: the crystal, the timer that paces the steps, and a stopped core."""

from __future__ import annotations

from plumb.f103.peripherals.tim import CEN, UG
from plumb.link import parameter_table
from plumb.proof.faults.fault import Fault
from plumb.proof.faults.reports import Told
from plumb.proof.faults.scene import ESTIMATE, Scene
from plumb.spec.parameter_file import by_name

CRYSTAL, FALLBACK, LATE = 1 << 12, 1 << 8, 1 << 1
BY_FAULT = Told("EVENTS", "disarm_cause", 1 << 3)
BY_WATCHDOG = Told("IDENTITY", "RESET_CAUSE", 1 << 6)
NO_STEP = Told("STATUS", "faults", LATE)
CHIPS = frozenset({"chips"})
ESTIMATES = frozenset({"chips", ESTIMATE})
STALL_S = 0.1
LONG_PERIOD_US, LOOK_US = 20_000, 100
SETTLED_S = 0.2
"""Time after disarming in which the board sends the reports about it."""


def crystal_fails(scene: Scene) -> None:
    scene.machine.rcc.kill_crystal()


def steps_stop(scene: Scene) -> None:
    """TIM3, which triggers conversions and steps, stands still."""
    timer = scene.machine.tim3
    timer.settle(scene.machine.now)
    timer.cr1 &= ~CEN
    scene.machine.timeline.cancel("TIM3")


def disarmed(scene: Scene) -> None:
    scene.session.disarm()
    scene.run(SETTLED_S)


def begun_anew(scene: Scene) -> None:
    """Another run, before its first step."""
    scene.session.begin("REALTIME_LIVE", frames=scene.live.FRAMES)


def steps_too_fast(scene: Scene) -> None:
    """TIM3 ticks every 50 us, faster than any step is: its prescaler and period are wrong."""
    timer = scene.machine.tim3
    timer.psc, timer.arr = 71, 49
    timer.write_egr(UG)


def core_stands_still(scene: Scene) -> None:
    """The core is stopped for 100 ms, as by a debugger or an unplanned flash erase."""
    scene.machine.flash.stall(STALL_S)


def begun_with_a_long_period(scene: Scene) -> None:
    """Another run, with a step every 20 ms, until one has just begun."""
    scene.session.end()
    table = by_name(parameter_table.read_table(scene.session))
    parameter_table.commit(scene.session, {**table, "period_us": LONG_PERIOD_US})
    scene.session.begin("REALTIME_LIVE", frames=scene.live.FRAMES)
    scene.run(SETTLED_S)
    timer = scene.machine.tim3
    before = timer.count(scene.machine.now)
    while (now := timer.count(scene.machine.now)) >= before:
        before = now
        scene.machine.advance_us(LOOK_US)


FAULTS = (
    Fault("crystal-fails", "clock", "the crystal stops", crystal_fails, "clock",
          (Told("IDENTITY", "FAULTS", CRYSTAL), Told("IDENTITY", "FAULTS", FALLBACK))),
    Fault("steps-stop", "clock", "the timer that paces the steps stands still", steps_stop, "steps",
          (NO_STEP, BY_FAULT)),
    Fault("steps-stop-disarmed", "clock", "the timer that paces the steps stands still, and nothing is armed",
          steps_stop, "steps", (NO_STEP,), prepare=disarmed),
    Fault("steps-stop-before-arming", "clock", "the timer that paces the steps stands still from the begin of a run on",
          steps_stop, "steps", (NO_STEP,), prepare=begun_anew),
    Fault("steps-stop-after-a-long-period", "clock", "the timer that paces the steps stands still behind a step, with a"
          " step every 20 ms, and nothing is armed", steps_stop, "overdue", (NO_STEP,),
          prepare=begun_with_a_long_period),
    Fault("estimate-steps-stop", "clock", "the timer that paces the steps stands still, and nothing is armed",
          steps_stop, "steps", (NO_STEP,), ESTIMATES),
    Fault("steps-too-fast", "clock", "the timer that paces the steps ticks every 50 us", steps_too_fast, "late",
          ((Told("STATUS", "faults", LATE), BY_WATCHDOG),), CHIPS),
    Fault("core-held-up", "clock", "the core stands still for 100 ms", core_stands_still, "hang", (BY_WATCHDOG,)),
)  # fmt: skip
