"""Thumb-2 machine code, disassembled by capstone, and what an instruction does to the stack pointer."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from plumb.errors import UsageError
from plumb.extras import required

REGISTER_BYTES = 4


class Thumb:
    """A disassembler for the Cortex-M3. `arm` has capstone's names of registers and kinds of operands. Raises
    UsageError where capstone is not installed; purpose: the feature that needs it, as the beginning of that message."""

    def __init__(self, purpose: str) -> None:
        capstone = required("capstone", "capstone", purpose, "bench")
        self.arm = required("capstone.arm", "capstone", purpose, "bench")
        self._capstone = capstone.Cs(capstone.CS_ARCH_ARM, capstone.CS_MODE_THUMB | capstone.CS_MODE_MCLASS)
        self._capstone.detail = True

    def name(self, instruction: Any) -> str:  # Any: capstone has no types
        """The mnemonic without condition and width."""
        return str(self._capstone.insn_name(instruction.id))

    def instructions(self, code: bytes, address: int) -> Iterator[Any]:  # Any: capstone has no types
        """Every instruction of `code`, which lies at `address`. Raises UsageError for bytes that are not an
        instruction."""
        at = address
        for found in self._capstone.disasm(code, address):
            at = found.address + found.size
            yield found
        if at < address + len(code):
            raise _foreign(at)

    def first(self, code: bytes, address: int) -> Any:  # Any: capstone has no types
        """The first instruction in `code`; the condition of an IT block before it is unknown."""
        found = next(self._capstone.disasm(code, address, 1), None)
        if found is None:
            raise _foreign(address)
        return found

    def is_conditional(self, instruction: Any) -> bool:  # Any: capstone has no types
        return instruction.cc not in (self.arm.ARM_CC_AL, self.arm.ARM_CC_INVALID)

    def registers(self, instruction: Any) -> list[int]:  # Any: capstone has no types
        """The registers among the operands, in order; of PUSH and POP those of the list."""
        return [operand.reg for operand in instruction.operands if operand.type == self.arm.ARM_OP_REG]

    def stack_change(self, instruction: Any) -> int | None:  # Any: capstone has no types
        """Bytes by which an instruction moves the stack pointer, negative where the stack grows; None when that is
        unknown. MSR MSP, by which a fault handler returns to the top of the stack for good, counts as no move."""
        arm, name, operands = self.arm, self.name(instruction), instruction.operands
        registers = self.registers(instruction)
        if name in ("push", "pop"):
            return REGISTER_BYTES * len(registers) * (1 if name == "pop" else -1)
        if name == "msr" or arm.ARM_REG_SP not in instruction.regs_access()[1]:
            return 0
        on_sp, last = registers[:1] == [arm.ARM_REG_SP], operands[-1]
        if on_sp and name in ("stmdb", "ldm"):
            return REGISTER_BYTES * (len(registers) - 1) * (1 if name == "ldm" else -1)
        from_sp = registers[1:2] in ([], [arm.ARM_REG_SP])
        if on_sp and from_sp and name in ("sub", "subw", "add", "addw") and last.type == arm.ARM_OP_IMM:
            return int(last.imm) * (1 if name.startswith("add") else -1)
        memory = [o for o in operands if o.type == arm.ARM_OP_MEM and o.mem.base == arm.ARM_REG_SP]
        if memory and not on_sp:  # str lr, [sp, #-4]! and ldr pc, [sp], #4
            moved = memory[0].mem.disp or (last.imm if last.type == arm.ARM_OP_IMM else 0)
            return int(-moved if memory[0].subtracted and moved > 0 else moved)
        return None


def _foreign(address: int) -> UsageError:
    return UsageError(f"what lies at 0x{address:08x} is not a Thumb instruction")
