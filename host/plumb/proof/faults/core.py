"""Injections at the core: patch instructions and handlers, flip bits of RAM."""

from __future__ import annotations

from plumb.errors import LinkError
from plumb.f103.core.cpu import BRANCH_TO_ITSELF, FLASH_BASE, RAM_BASE
from plumb.f103.core.nvic import SYSTICK
from plumb.f103.core.timeline import TICKS_PER_S, TICKS_PER_US
from plumb.proof.faults.scene import Scene

FOREVER = BRANCH_TO_ITSELF
MASK_INTERRUPTS = b"\x72\xb6"
"""CPSID I."""
UNDEFINED = b"\x00\xde"
RETURN_TRUE = b"\x01\x20\x70\x47"
THREAD_S = 0.05
HOST_WAITS_S = 0.004
"""The end of a pause without the host, which lets time pass in whole milliseconds."""


def patch(scene: Scene, address: int, code: bytes) -> None:
    """Replace instructions in flash until the next reset, which restores the old ones."""
    cpu, flash = scene.machine.cpu, scene.machine.flash
    offset = address - FLASH_BASE
    before, restart = bytes(cpu.flash[offset : offset + len(code)]), cpu.restart

    def restart_without(*vectors: int) -> None:
        flash.store(offset, before)
        cpu.forget_code()
        restart(*vectors)

    vars(cpu)["restart"] = restart_without
    flash.store(offset, code)
    cpu.forget_code()


def replace_function(scene: Scene, name: str, code: bytes) -> None:
    """Put this code at the entry of a function of the image."""
    patch(scene, scene.symbol(name).address, code)


def pause_at(scene: Scene, address: int, pause_s: float) -> None:
    """Make the core branch to itself at this instruction for a while, then continue there."""
    cpu, flash = scene.machine.cpu, scene.machine.flash
    offset = address - FLASH_BASE
    before = bytes(cpu.flash[offset : offset + len(FOREVER)])
    for code in (FOREVER, before):
        flash.store(offset, code)
        cpu.forget_code()
        if code == FOREVER:
            if not scene.machine.run_until(lambda: cpu.pc == address, THREAD_S * 1e6):
                raise LinkError("the core never reaches this instruction: the fault cannot be injected")
            end = scene.machine.now + round(pause_s * TICKS_PER_S)
            scene.run(max(pause_s - HOST_WAITS_S, 0.0))
            scene.machine.advance_us(max(end - scene.machine.now, 0) / TICKS_PER_US)


def poke(scene: Scene, address: int, value: int) -> None:
    """Write a word of RAM."""
    scene.machine.cpu.ram[address - RAM_BASE : address - RAM_BASE + 4] = (value & 0xFFFFFFFF).to_bytes(4, "little")


def reach_the_loop(scene: Scene) -> None:
    """Let time pass until the core runs the main loop: awake, in no handler, and with interrupts enabled."""
    machine, cpu = scene.machine, scene.machine.cpu
    if not machine.run_until(
        lambda: not machine.nvic.active and not cpu.sleeping and cpu.takes(SYSTICK), THREAD_S * 1e6
    ):
        raise LinkError("the main loop never runs: the fault cannot be injected")


def patch_the_loop(scene: Scene, code: bytes) -> None:
    """Make the main loop execute this code next."""
    reach_the_loop(scene)
    patch(scene, scene.machine.cpu.pc, code)


def patch_handler(scene: Scene, number: int, code: bytes) -> None:
    """Put this code at the entry of the handler of exception `number`."""
    entry = int.from_bytes(scene.machine.cpu.read(FLASH_BASE + 4 * number, 4), "little") & ~1
    patch(scene, entry, code)


def handles(scene: Scene, number: int) -> bool:
    """Whether this exception is enabled, so that its handler runs."""
    return bool(scene.machine.nvic.enabled >> number & 1)


def flip(scene: Scene, address: int, bit: int) -> None:
    """Flip one bit of RAM, `bit` counted from `address`."""
    scene.machine.cpu.ram[address - RAM_BASE + bit // 8] ^= 1 << bit % 8


def hold_off(scene: Scene, *causes: str) -> None:
    """Suppress these resets from inside the chip (software, iwdg, wwdg), so that the next layer of protection must
    act."""
    request_reset = scene.machine.request_reset

    def request_other(cause: str) -> None:
        if cause not in causes:
            request_reset(cause)

    vars(scene.machine)["request_reset"] = request_other


def reach_sleep(scene: Scene) -> None:
    """Let time pass until the main loop sleeps."""
    if not scene.machine.run_until(lambda: scene.machine.cpu.sleeping, THREAD_S * 1e6):
        raise LinkError("the main loop never sleeps: the fault cannot be injected")
