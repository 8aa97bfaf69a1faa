"""Faults of memory: flipped bits in RAM, wild pointers, a stack that overflows, flash that was damaged."""

from __future__ import annotations

from plumb.flash.image import FLASH_BASE, PARAMETER_SLOTS
from plumb.proof.faults import core
from plumb.proof.faults.fault import Action, Fault
from plumb.proof.faults.outputs import PROGRAM
from plumb.proof.faults.reports import Told
from plumb.proof.faults.scene import Scene

UPSET, CRASH, PARAMETERS = 1 << 14, 1 << 2, 1 << 7
BY_UPSET = (Told("STATUS", "faults", UPSET), Told("EVENTS", "disarm_cause", 1 << 3))
BY_CRASH = (Told("IDENTITY", "FAULTS", CRASH), Told("IDENTITY", "RESET_CAUSE", 1 << 4))
BY_PROCESSOR_FAULT = (*BY_CRASH, Told("IDENTITY", "CRASH_EXCEPTION", value=3))
BY_STACK_GUARD = (*BY_CRASH, Told("IDENTITY", "CRASH_EXCEPTION", value=0))
BY_CRASH_AND_WATCHDOG = (Told("IDENTITY", "FAULTS", CRASH), Told("IDENTITY", "RESET_CAUSE", 1 << 6))
FLIPS = 16
SLOTS, SLOT_BYTES, DAMAGED_AT = 2, 2048, 40


def flipped(symbol: str) -> Action:
    """Flip one bit of a variable while the loop sleeps; the bits of all variants are evenly spread over it."""

    def inject(scene: Scene) -> None:
        core.reach_sleep(scene)
        found = scene.symbol(symbol)
        core.flip(scene, found.address, (2 * scene.variant + 1) * 8 * found.size // (2 * FLIPS))

    return inject


def flipped_in_stack(scene: Scene) -> None:
    """Flip one bit of a word at the end of the stack while the loop sleeps: another word for every variant."""
    core.reach_sleep(scene)
    word = scene.symbol("stack_top").address - 4 * (scene.variant + 1)
    core.flip(scene, word, (5 * scene.variant + 4) % 32)


def clock_set_back(scene: Scene) -> None:
    """Clear the highest set bit in the count of milliseconds, which no check word covers."""
    ticks = scene.symbol("ticks_ms").address
    count = int.from_bytes(scene.machine.cpu.read(ticks, 4), "little")
    core.flip(scene, ticks, count.bit_length() - 1)


def guard_overwritten(scene: Scene) -> None:
    core.flip(scene, scene.symbol("stack_guard").address, 0)


def undefined_instruction(scene: Scene) -> None:
    core.patch_the_loop(scene, core.UNDEFINED)


def crash_without_reset(scene: Scene) -> None:
    """The crash handler requests a reset, which fails."""
    core.hold_off(scene, "software")
    undefined_instruction(scene)


def wild_jump(scene: Scene) -> None:
    """The core branches to an address without memory."""
    core.reach_the_loop(scene)
    scene.machine.cpu.pc = 0x60000000


def saved(scene: Scene) -> None:
    """The run is over, and the parameters in use are saved."""
    scene.session.execute_idle("SAVE")


def slots_damaged(scene: Scene) -> None:
    """Clear one byte of every saved table, then reset."""
    for slot in range(SLOTS):
        scene.machine.flash.store(PARAMETER_SLOTS - FLASH_BASE + slot * SLOT_BYTES + DAMAGED_AT, b"\0")
    scene.machine.reset()


FAULTS = (
    Fault("flip-in-control-state", "memory", f"one bit of the control state, {FLIPS} of them", flipped("control"),
          "asleep", BY_UPSET, variants=FLIPS, by=PROGRAM),
    Fault("flip-in-parameters", "memory", f"one bit of the parameters in use, {FLIPS} of them", flipped("params"),
          "asleep", BY_UPSET, variants=FLIPS, by=PROGRAM),
    Fault("flip-in-session", "memory", f"one bit of the session, {FLIPS} of them", flipped("session"),
          "asleep", BY_UPSET, variants=FLIPS, by=PROGRAM),
    Fault("flip-in-stack", "memory", f"one bit in each of the first {FLIPS} words of the stack", flipped_in_stack,
          "held", holds=True, variants=FLIPS),
    Fault("clock-set-back", "memory", "one bit of the clock, which is then behind", clock_set_back, "memory",
          BY_UPSET, by=PROGRAM),
    Fault("stack-overflow", "memory", "the guard below the stack is overwritten", guard_overwritten, "memory",
          BY_STACK_GUARD),
    Fault("undefined-instruction", "memory", "the main loop meets an undefined instruction", undefined_instruction,
          "memory", BY_PROCESSOR_FAULT),
    Fault("crash-without-reset", "memory", "the main loop meets an undefined instruction, and the reset does not come",
          crash_without_reset, "crash", BY_CRASH_AND_WATCHDOG, by=PROGRAM),
    Fault("wild-jump", "memory", "the main loop jumps to where nothing is", wild_jump, "memory", BY_PROCESSOR_FAULT),
    Fault("saved-table-damaged", "memory", "a byte of both slots of saved parameters is 0, and a reset",
          slots_damaged, "power", (Told("STATUS", "faults", PARAMETERS),), prepare=saved),
)  # fmt: skip
