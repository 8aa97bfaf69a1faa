"""A fault of the program that the chip runs, as an event: which exception, why in words, where, and what was stacked.

Sources: Armv7-M B3.2.15 to B3.2.18 (CFSR, HFSR, BFAR), B1.5.6 (the frame).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from plumb.f103.core.timeline import TICKS_PER_US

NAMES = {3: "HardFault", 4: "MemManage fault", 5: "BusFault", 6: "UsageFault"}
LOCKUP = 0
"""In place of an exception's number: the core has locked up."""
CAUSES = (
    (0, "IACCVIOL", "an instruction was fetched from where none may be"),
    (1, "DACCVIOL", "an access that the memory protection forbids"),
    (3, "MUNSTKERR", "the memory protection forbids the frame of an exception return"),
    (4, "MSTKERR", "the memory protection forbids the frame of an exception"),
    (8, "IBUSERR", "an instruction was fetched from an address without memory"),
    (9, "PRECISERR", "a load or store that its address does not take"),
    (10, "IMPRECISERR", "an earlier store that its address did not take"),
    (11, "UNSTKERR", "the frame of an exception return is outside memory"),
    (12, "STKERR", "the frame of an exception does not fit: the stack pointer is outside RAM"),
    (16, "UNDEFINSTR", "an instruction that the core does not have"),
    (17, "INVSTATE", "a jump to an even address, which asks for Arm instructions"),
    (18, "INVPC", "an exception return that contradicts the active exceptions"),
    (19, "NOCP", "an instruction of a coprocessor; the Cortex-M3 has none, and no floating point"),
    (24, "UNALIGNED", "an access at an address that is no multiple of its width"),
    (25, "DIVBYZERO", "a division by zero"),
)
"""Bits of CFSR: number, name, meaning."""
BFARVALID, VECTTBL, DEBUGEVT = 1 << 15, 1 << 1, 1 << 31
"""Of CFSR; of HFSR."""
STACK_WORDS = 16


@dataclass(frozen=True)
class ProgramFault:
    """number: of the exception, LOCKUP for a core that has locked up. time: in ticks. pc: of the instruction. stack:
    the words from the program's stack pointer on. place: function and line, '' where the image says none."""

    number: int
    time: int
    pc: int
    lr: int
    sp: int
    cfsr: int
    hfsr: int
    bfar: int
    stack: tuple[int, ...]
    place: str
    lockup: str = ""

    @property
    def name(self) -> str:
        return NAMES.get(self.number, "lock-up")

    @property
    def causes(self) -> tuple[str, ...]:
        """In words, from CFSR and HFSR."""
        words = [f"{text} ({name})" for bit, name, text in CAUSES if self.cfsr >> bit & 1]
        if self.hfsr & VECTTBL:
            words.append("the vector table has no memory there (VECTTBL)")
        if self.hfsr & DEBUGEVT:
            words.append("a breakpoint instruction without a debugger (DEBUGEVT)")
        if self.lockup:
            words.append(self.lockup)
        return tuple(words)

    def __str__(self) -> str:
        """One sentence: what, when, where and why."""
        at = f"at 0x{self.bfar:08X} " if self.cfsr & BFARVALID else ""
        why = " and ".join(self.causes) or "asked for by the program"
        place = f" in {self.place}" if self.place else ""
        when = f"{self.time / TICKS_PER_US:.1f} us"
        registers = f"lr 0x{self.lr:08X}, sp 0x{self.sp:08X}, CFSR 0x{self.cfsr:08X}, HFSR 0x{self.hfsr:08X}"
        return f"{self.name} {at}after {when}: {why}, pc 0x{self.pc:08X}{place} ({registers})"


Places = Callable[[int], str]
"""Address in flash -> 'function (file.c:12)', '' where nothing is known."""
