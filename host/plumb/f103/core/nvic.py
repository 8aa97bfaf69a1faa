"""Interrupt controller: pending, enable and active bits, priorities, and selection of the next exception (Armv7-M
B3.4).

Exceptions carry their Armv7-M number: 2 NMI, 3 HardFault, 4 to 6 the other faults, 11 SVCall, 14 PendSV, 15 SysTick,
16 + n interrupt n. The part implements the upper four bits of a priority.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from plumb.f103.core.bus import Peripheral, Register

if TYPE_CHECKING:
    from plumb.f103.core.mcu import Mcu

NMI, HARD_FAULT, MEMORY_FAULT, BUS_FAULT, USAGE_FAULT, SVCALL, PENDSV, SYSTICK, IRQ0 = 2, 3, 4, 5, 6, 11, 14, 15, 16
THREAD_PRIORITY = 256
"""A priority lower than that of every exception."""
INTERRUPTS = 60
ALWAYS_ENABLED = 1 << NMI | 1 << HARD_FAULT | 1 << SVCALL | 1 << PENDSV | 1 << SYSTICK


def _bank_registers() -> tuple[Register, ...]:
    banks = [("iser", 0x000), ("icer", 0x080), ("ispr", 0x100), ("icpr", 0x180), ("iabr", 0x200)]
    rows = [Register(f"{name}{i}", base + 4 * i) for name, base in banks for i in range(2)]
    return tuple(rows + [Register(f"ipr{i}", 0x300 + 4 * i) for i in range(INTERRUPTS // 4)])


def _bank_and_index(register: Register) -> tuple[str, int]:
    bank = register.name.rstrip("0123456789")
    return bank, int(register.name[len(bank) :])


class Nvic(Peripheral):
    REGISTERS = _bank_registers()
    NARROW = "merge"

    def __init__(self, machine: Mcu) -> None:
        super().__init__(machine, "NVIC", 0xE000E100)
        self.reset()

    def reset(self) -> None:
        self.pending = 0
        self.enabled = ALWAYS_ENABLED
        self.level = 0
        self.active: list[int] = []
        self.priority = [0] * (IRQ0 + INTERRUPTS)
        self.priority[NMI], self.priority[HARD_FAULT] = -2, -1
        self.group_mask = 0xFF

    def plain_reader(self, register: Register) -> Callable[[], int]:
        bank, index = _bank_and_index(register)
        shift = IRQ0 + 32 * index
        if bank == "ipr":
            first = IRQ0 + 4 * index
            return lambda: sum(self.priority[first + i] << (8 * i) for i in range(4))
        if bank in ("iser", "icer"):
            return lambda: (self.enabled >> shift) & 0xFFFFFFFF
        if bank in ("ispr", "icpr"):
            return lambda: (self.pending >> shift) & 0xFFFFFFFF
        return lambda: (sum(1 << number for number in self.active) >> shift) & 0xFFFFFFFF

    def plain_writer(self, register: Register) -> Callable[[int], None]:
        bank, index = _bank_and_index(register)
        shift = IRQ0 + 32 * index
        exists = (1 << (IRQ0 + INTERRUPTS)) - 1

        def write(value: int) -> None:
            bits = (value << shift) & exists
            if bank == "iser":
                self.enabled |= bits
            elif bank == "icer":
                self.enabled &= ~bits
            elif bank == "ispr":
                self.pending |= bits
            elif bank == "icpr":
                self.pending &= ~bits | self.level
            elif bank == "ipr":
                for i in range(4):
                    self.priority[IRQ0 + 4 * index + i] = (value >> (8 * i)) & 0xF0
            self.changed()

        return write

    def set_line(self, interrupt: int, high: bool) -> None:
        """Set a peripheral's request line. A rising edge pends the interrupt; a line still high when the handler
        returns pends it again."""
        bit = 1 << (IRQ0 + interrupt)
        if not high:
            self.level &= ~bit
        elif not self.level & bit:
            self.level |= bit
            self.pending |= bit
            self.changed()

    def pend(self, number: int) -> None:
        self.pending |= 1 << number
        self.changed()

    def changed(self) -> None:
        if self.pending & self.enabled:
            self.machine.cpu.end_slice()

    def group_priority(self, number: int) -> int:
        value = self.priority[number]
        return value if value < 0 else value & self.group_mask

    def execution_priority(self) -> int:
        """Priority of the running code, without the mask registers."""
        return min([self.group_priority(number) for number in self.active], default=THREAD_PRIORITY)

    def candidate(self) -> int:
        """The pending, enabled exception of the highest priority if it may preempt the running code, else 0. Ignores
        the mask registers."""
        waiting = self.pending & self.enabled
        if not waiting:
            return 0
        best, best_priority = 0, THREAD_PRIORITY
        while waiting:
            number = (waiting & -waiting).bit_length() - 1
            waiting &= waiting - 1
            if self.priority[number] < best_priority:
                best, best_priority = number, self.priority[number]
        return best if self.group_priority(best) < self.execution_priority() else 0

    def enter(self, number: int) -> None:
        self.pending &= ~(1 << number)
        self.active.append(number)

    def leave(self) -> int:
        number = self.active.pop()
        self.pending |= self.level & (1 << number)
        return number
