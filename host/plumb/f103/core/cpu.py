"""The Cortex-M3: Unicorn executes the instructions; this module models exception entry and return, sleep and time.

Time. Every instruction takes QUARTER_CYCLES / 4 cycles of HCLK, by the wait states of the flash (flat estimates: the
means of this firmware in flight, by the timing table of `plumb bench`); exception entry takes 12 cycles, return 10, a
tail-chained entry 6 (Armv7-M, zero wait states). Unicorn counts instructions in its own memory: reading that counter
inside a register access gives the exact present time, and lowering the limit beside it ends the slice after the current
instruction (stopping from inside a register access would repeat the access). So a slice always ends exactly at the next
event, and results do not depend on how time was sliced.
"""

from __future__ import annotations

import ctypes
import struct
from collections.abc import Callable
from types import FrameType
from typing import TYPE_CHECKING

from plumb.errors import UsageError
from plumb.extras import install_hint
from plumb.f103.core import bit_band
from plumb.f103.core import scb as core
from plumb.f103.core.bus import Bus, SimulationError
from plumb.f103.core.crc_loop import AHEAD_BYTES, BEFORE, CODE_BYTES, INSTRUCTIONS, TURN_BYTES, CrcLoop, crc_loop
from plumb.f103.core.nvic import BUS_FAULT, HARD_FAULT, NMI, SVCALL, USAGE_FAULT
from plumb.f103.core.program_fault import LOCKUP, NAMES, STACK_WORDS, ProgramFault
from plumb.f103.peripherals.crc import DR_OFFSET, Crc
from plumb.process_signals import ending_of

try:
    from unicorn import (
        UC_ARCH_ARM,
        UC_HOOK_INTR,
        UC_HOOK_MEM_INVALID,
        UC_MEM_WRITE_PROT,
        UC_MODE_MCLASS,
        UC_MODE_THUMB,
        UC_PROT_EXEC,
        UC_PROT_READ,
        UC_PROT_WRITE,
        Uc,
    )
    from unicorn.arm_const import (
        UC_ARM_REG_BASEPRI,
        UC_ARM_REG_CONTROL,
        UC_ARM_REG_FAULTMASK,
        UC_ARM_REG_LR,
        UC_ARM_REG_PC,
        UC_ARM_REG_PRIMASK,
        UC_ARM_REG_PSP,
        UC_ARM_REG_R0,
        UC_ARM_REG_R1,
        UC_ARM_REG_R2,
        UC_ARM_REG_R3,
        UC_ARM_REG_R12,
        UC_ARM_REG_SP,
        UC_ARM_REG_XPSR,
        UC_CPU_ARM_CORTEX_M3,
    )
    from unicorn.unicorn_const import (
        UC_ERR_FETCH_PROT,
        UC_ERR_FETCH_UNMAPPED,
        UC_ERR_INSN_INVALID,
        UC_ERR_READ_UNMAPPED,
        UC_ERR_WRITE_PROT,
        UC_ERR_WRITE_UNMAPPED,
    )
    from unicorn.unicorn_py3.unicorn import uclib
except ImportError as error:
    raise UsageError(f"the virtual board needs unicorn; install it {install_hint('virtual')}") from error

if TYPE_CHECKING:
    from plumb.f103.core.mcu import Mcu

QUARTER_CYCLES = (7, 8, 9)
"""Quarters of a cycle of HCLK that an instruction takes at zero, one and two wait states."""
ENTRY_CYCLES, RETURN_CYCLES, TAIL_CHAIN_CYCLES = 12, 10, 6
FLASH_BASE, RAM_BASE, SYSTEM_BASE = 0x08000000, 0x20000000, 0x1FFFF000
_READ_CALLBACK = ctypes.CFUNCTYPE(ctypes.c_uint64, ctypes.c_void_p, ctypes.c_uint64, ctypes.c_uint, ctypes.c_void_p)
_OnRead = Callable[[int, int, int, int], int]
_OnWrite = Callable[[int, int, int, int, int], None]
_WRITE_CALLBACK = ctypes.CFUNCTYPE(
    None, ctypes.c_void_p, ctypes.c_uint64, ctypes.c_uint, ctypes.c_uint64, ctypes.c_void_p
)
CPSIE_I = b"\x62\xb6"
BRANCH_TO_ITSELF = b"\xfe\xe7"
NOWHERE = 0xFFFFFFFE
"""End address of every run: never reached."""
STACKED = (
    UC_ARM_REG_R0,
    UC_ARM_REG_R1,
    UC_ARM_REG_R2,
    UC_ARM_REG_R3,
    UC_ARM_REG_R12,
    UC_ARM_REG_LR,
    UC_ARM_REG_PC,
    UC_ARM_REG_XPSR,
)
FRAME = struct.Struct("<8I")
_EXCEPTION_SVC, _EXCEPTION_RETURN = 2, 8
_USAGE_FAULTS = {17: core.CFSR_NOCP, 18: core.CFSR_INVSTATE, 22: core.CFSR_UNALIGNED}
"""Reasons for which Unicorn stops -> the bit of CFSR."""
TO_HANDLER, TO_THREAD, TO_THREAD_OF_PROCESS = 0xFFFFFFF1, 0xFFFFFFF9, 0xFFFFFFFD
"""EXC_RETURN: where an exception returns to; the last one pops its frame from the process stack (Armv7-M B1.5.8)."""
EXC_RETURNS = TO_HANDLER, TO_THREAD, TO_THREAD_OF_PROCESS
THUMB = 1 << 24
"""XPSR: a Cortex-M3 executes Thumb instructions only."""
NOT_PRIVILEGED, ON_PROCESS_STACK = 1, 2
"""CONTROL, in thread mode."""
_DATA_FAULTS = (UC_ERR_READ_UNMAPPED, UC_ERR_WRITE_UNMAPPED, UC_ERR_WRITE_PROT)
_FETCH_FAULTS = (UC_ERR_FETCH_UNMAPPED, UC_ERR_FETCH_PROT)


class Registers:
    """A fixed group of core registers, read or written in one call (one at a time costs several times as much)."""

    def __init__(self, uc: Uc, *registers: int) -> None:
        count = len(registers)
        self._handle, self._count = uc._uch, count
        self._ids = (ctypes.c_int * count)(*registers)
        self._values = (ctypes.c_uint32 * count)()
        places = [ctypes.addressof(self._values) + 4 * i for i in range(count)]
        self._places = (ctypes.c_void_p * count)(*places)

    def read(self) -> list[int]:
        uclib.uc_reg_read_batch(self._handle, self._ids, self._places, self._count)
        return self._values[:]

    def write(self, *values: int) -> None:
        self._values[:] = list(values)
        uclib.uc_reg_write_batch(self._handle, self._ids, self._places, self._count)


class Cpu:
    """Registers, memory, and one slice of execution at a time."""

    WIRING = frozenset(
        {
            "uc",
            "_counter",
            "_limit",
            "_state",
            "_before",
            "_handler",
            "_after",
            "_handle",
            "_callbacks",
            "_low",
            "_turned",
        }
    )

    def __init__(self, machine: Mcu, flash_bytes: int, ram_bytes: int) -> None:
        self.machine = machine
        self.uc = uc = Uc(UC_ARCH_ARM, UC_MODE_THUMB | UC_MODE_MCLASS)
        uc.ctl_set_cpu_model(UC_CPU_ARM_CORTEX_M3)
        read_only = UC_PROT_READ | UC_PROT_EXEC
        self.flash = self._map(flash_bytes, (FLASH_BASE, 0), read_only)
        self.system = self._map(0x1000, (SYSTEM_BASE,), UC_PROT_READ)
        self.ram = self._map(ram_bytes, (RAM_BASE,), read_only | UC_PROT_WRITE)
        self._counter, self._limit = _find_counter(uc)
        masks = (UC_ARM_REG_PRIMASK, UC_ARM_REG_FAULTMASK, UC_ARM_REG_BASEPRI)
        self._state = Registers(uc, UC_ARM_REG_PC, UC_ARM_REG_SP, *masks)
        self._before = Registers(uc, *STACKED, UC_ARM_REG_CONTROL)
        self._handler = Registers(uc, UC_ARM_REG_SP, UC_ARM_REG_LR, UC_ARM_REG_XPSR)
        self._after = Registers(uc, UC_ARM_REG_XPSR, *STACKED[:6], UC_ARM_REG_SP)
        self._low = Registers(uc, UC_ARM_REG_PC, *range(UC_ARM_REG_R0, UC_ARM_REG_R0 + 8))
        self._turned: dict[CrcLoop, Registers] = {}
        self.running = False
        self.loops_at_once = True
        """True: many turns of the loop that feeds the CRC unit, or of a branch to itself, are computed at once
        (crc_loop.py); False: Unicorn executes every instruction, so that a debugger meets each."""
        self.sleeping = False
        self.locked_up = ""
        self.base = 0
        """Ticks at the start of the running slice, or now between slices."""
        self.instruction_ticks = 1
        self.instructions = 0
        self.slept_ticks = 0
        self._handle = uc._uch
        self._callbacks: list[object] = []
        self._raised: BaseException | None = None
        self._stop_reason = 0
        self._fault_address = 0
        self._flash_write: tuple[int, int, bytes] | None = None
        uc.hook_add(UC_HOOK_INTR, self._on_exception)
        uc.hook_add(UC_HOOK_MEM_INVALID, self._on_bad_address)

    def _map(self, size: int, bases: tuple[int, ...], access: int) -> memoryview:
        """Memory shared by Unicorn and Python, mapped at one or more addresses."""
        memory = (ctypes.c_uint8 * size)()
        for base in bases:
            self.uc.mem_map_ptr(base, size, access, ctypes.addressof(memory))
        return memoryview(memory).cast("B")

    def map_registers(self, base: int, size: int, bus: Bus, crc: Crc | None = None) -> None:
        """Pass accesses to a range of addresses to the bus. Calls the library directly, because this is the busiest
        path. An exception raised in an access comes out of `run`. crc: the unit at `base`, whose words bypass
        the bus, because the firmware writes hundreds of them between two steps."""

        def read(_uc: int, offset: int, width: int, _user: int) -> int:
            try:
                return bus.read(base + offset, width)
            except BaseException as error:
                return self._raise_later(error)

        def write(_uc: int, offset: int, width: int, value: int, _user: int) -> None:
            try:
                bus.write(base + offset, width, value)
            except BaseException as error:
                self._raise_later(error)

        def write_word(uc: int, offset: int, width: int, value: int, user: int) -> None:
            assert crc is not None
            if offset == DR_OFFSET and width == 4 and crc.clocked:
                crc.waiting += value.to_bytes(4, "little")
                if not len(crc.waiting) % TURN_BYTES and self.loops_at_once and not crc.by_other_code:
                    self._feed(crc)
            else:
                write(uc, offset, width, value, user)

        self._map_calls(base, size, read, write if crc is None else write_word)

    def map_bit_bands(self, bus: Bus) -> None:
        """The aliases of RAM and of the peripherals."""

        def read_ram(offset: int, width: int) -> int:
            return int.from_bytes(self.ram[offset : offset + width], "little")

        def write_ram(offset: int, width: int, value: int) -> None:
            self.ram[offset : offset + width] = value.to_bytes(width, "little")

        ram_bytes, register_bytes = (
            bit_band.WORDS_PER_BYTE_BYTES * size for size in (len(self.ram), bit_band.PERIPHERAL_BYTES)
        )
        regions: tuple[tuple[int, int, int, bit_band.Read, bit_band.Write], ...] = (
            (bit_band.RAM_ALIAS, ram_bytes, 0, read_ram, write_ram),
            (bit_band.PERIPHERAL_ALIAS, register_bytes, bit_band.PERIPHERALS, bus.read, bus.write),
        )
        for alias, size, base, read, write in regions:
            self._map_alias(alias, size, bit_band.reader(base, read), bit_band.writer(base, read, write))

    def _map_alias(self, alias: int, size: int, read_bit: bit_band.Read, write_bit: bit_band.Write) -> None:
        def read(_uc: int, offset: int, width: int, _user: int) -> int:
            try:
                return read_bit(offset, width)
            except BaseException as error:
                return self._raise_later(error)

        def write(_uc: int, offset: int, width: int, value: int, _user: int) -> None:
            try:
                write_bit(offset, width, value)
            except BaseException as error:
                self._raise_later(error)

        self._map_calls(alias, size, read, write)

    def _map_calls(self, base: int, size: int, read: _OnRead, write: _OnWrite) -> None:
        """Have Unicorn call these for accesses from `base` on."""
        callbacks = _READ_CALLBACK(read), _WRITE_CALLBACK(write)
        self._callbacks += callbacks
        read_at, write_at = (ctypes.cast(callback, ctypes.c_void_p) for callback in callbacks)
        if uclib.uc_mmio_map(self._handle, base, size, read_at, 0, write_at, 0):
            raise SimulationError(f"Unicorn does not map the registers at 0x{base:08X}")

    def _feed(self, crc: Crc) -> None:
        """Called in a store to the unit. When this is the last store in a turn of the loop, compute the coming turns at
        once."""
        pc, *low = self._low.read()
        at = pc - FLASH_BASE - BEFORE
        if at < 0 or at + CODE_BYTES > len(self.flash):
            return
        loop = crc_loop(bytes(self.flash[at : at + CODE_BYTES]))
        if loop is None:
            crc.by_other_code = True
            return
        start, end = low[loop.source] - AHEAD_BYTES, low[loop.end]
        left, rest = divmod(end - start, TURN_BYTES)
        turns = min(left - 1, (self._limit.value - self._counter.value) // INSTRUCTIONS)
        if turns < 1 or rest or not RAM_BASE <= start < end <= RAM_BASE + len(self.ram):
            return
        after = start + turns * TURN_BYTES
        crc.waiting += self.ram[start - RAM_BASE : after - RAM_BASE]
        if loop not in self._turned:
            self._turned[loop] = Registers(self.uc, *(UC_ARM_REG_R0 + number for number in (loop.source, *loop.loaded)))
        last_c, last_d, ahead_a, ahead_b = struct.unpack_from("<4I", self.ram, after - AHEAD_BYTES - RAM_BASE)
        self._turned[loop].write(after + AHEAD_BYTES, ahead_a, ahead_b, last_c, last_d)
        self._counter.value += turns * INSTRUCTIONS

    def _raise_later(self, error: BaseException) -> int:
        self._raised = self._raised or error
        self.end_slice()
        return 0

    def on_interrupt(self, number: int, _frame: FrameType | None) -> None:
        """Handler of SIGINT and SIGTERM: ends the slice and raises afterwards. An exception raised on the way into or
        out of a register access would be lost, together with the access."""
        ending = ending_of(number)
        if not self.running:
            raise ending
        self._raise_later(ending)

    def now(self) -> int:
        """Present time in ticks. Inside a register access: the end of the instruction that makes the access."""
        return self.base + self._counter.value * self.instruction_ticks if self.running else self.base

    def set_clock(self, hclk_ticks: int, wait_states: int) -> None:
        """From the next instruction on: ticks of a cycle of HCLK, and wait states of the flash, 0 to 2."""
        now = self.now()
        self.instruction_ticks = hclk_ticks * QUARTER_CYCLES[wait_states] // 4
        if self.running:
            self.base = now - self._counter.value * self.instruction_ticks
            self.end_slice()

    def end_slice(self) -> None:
        """End the slice after the present instruction."""
        if self.running:
            self._limit.value = min(self._limit.value, self._counter.value)

    def stop_before(self) -> bool:
        """Called by Unicorn before an instruction, with the count already raised for it: end the slice without it.
        False when the slice has ended before it anyway."""
        if self._counter.value > self._limit.value:
            return False
        self._limit.value = self._counter.value - 1
        uclib.uc_emu_stop(self._handle)
        return True

    @property
    def at_first(self) -> bool:
        """Called like `stop_before`: whether the instruction is the first one of its slice."""
        return self._counter.value == 1

    def take_over(self) -> None:
        """Registers inside Unicorn were written from outside, between two slices: the stack pointer or a mask."""
        _pc, self.stack, self._primask, self._faultmask, self._base_priority = self._state.read()

    def end_slice_at(self, time: int) -> None:
        """An event at `time` has become the next one: end the slice with the first instruction that ends at or after
        it."""
        if self.running:
            last = max(-(-(time - self.base) // self.instruction_ticks), self._counter.value)
            self._limit.value = min(self._limit.value, last)

    def forget_code(self) -> None:
        """The program in flash has changed: drop Unicorn's translations of the old one."""
        self.uc.ctl_flush_tb()

    def restart(self, vectors: int = FLASH_BASE) -> None:
        """Load stack pointer and entry point from a vector table in flash, by default that of a reset, and clear the
        mask registers. Memory stays as it is."""
        stack, entry = struct.unpack_from("<II", self.flash, vectors - FLASH_BASE)
        self.sleeping, self.locked_up = False, ""
        uc = self.uc
        uc.reg_write(UC_ARM_REG_XPSR, 1 << 24)
        for register in (UC_ARM_REG_CONTROL, UC_ARM_REG_PRIMASK, UC_ARM_REG_BASEPRI, UC_ARM_REG_FAULTMASK):
            uc.reg_write(register, 0)
        uc.reg_write(UC_ARM_REG_LR, 0xFFFFFFFF)
        uc.reg_write(UC_ARM_REG_SP, stack & ~3)
        self.pc, self.stack = entry & ~1, stack & ~3
        self._primask = self._faultmask = self._base_priority = 0

    def keep(self) -> Callable[[], None]:
        """Keep the registers inside Unicorn for a snapshot, between two slices. The returned function restores them; it
        is called before the memories are restored, and drops the translated code if the flash has changed since."""
        context, flash = self.uc.context_save(), bytes(self.flash)

        def put_back() -> None:
            self.uc.context_restore(context)
            if self.flash != flash:
                self.forget_code()

        return put_back

    def run(self, instructions: int) -> None:
        """Run `instructions` instructions; fewer when the core sleeps, an exception ends, or a limit was lowered."""
        self._stop_reason = 0
        self.running = True
        error = uclib.uc_emu_start(self._handle, self.pc | 1, NOWHERE, 0, instructions)
        self.running = False
        counted, limit = self._counter.value, self._limit.value
        done = counted - 1 if counted > limit else counted
        self.base += done * self.instruction_ticks
        self.instructions += done
        self.pc, self.stack, self._primask, self._faultmask, self._base_priority = self._state.read()
        if self._flash_write is not None:
            address, value, before = self._flash_write
            self._flash_write = None
            self.flash[address - FLASH_BASE : address - FLASH_BASE + 2] = before
            self.machine.flash.program(address, value)
        if self._raised is not None:
            raised, self._raised = self._raised, None
            raise raised
        if error:
            self._fault(error)
        elif self._stop_reason == _EXCEPTION_RETURN:
            self._return()
        elif self._stop_reason == _EXCEPTION_SVC:
            self._synchronous(SVCALL)
        elif self._stop_reason in _USAGE_FAULTS:
            self.machine.scb.cfsr |= _USAGE_FAULTS[self._stop_reason]
            self._synchronous(USAGE_FAULT)
        elif self._stop_reason:  # a breakpoint without a debugger
            self.machine.scb.hfsr |= core.HFSR_DEBUGEVT
            self._synchronous(HARD_FAULT)
        elif counted <= limit:
            self.sleeping = True

    def takes(self, number: int) -> bool:
        """True when the mask registers let exception `number` preempt now; nvic.candidate() checks everything else."""
        nvic = self.machine.nvic
        priority = nvic.group_priority(number)
        if (priority >= 0 and self._primask & 1) or (priority >= -1 and self._faultmask & 1):
            return False
        base_priority = self._base_priority & 0xF0
        return not base_priority or priority < (base_priority & nvic.group_mask)

    def run_masked(self, until: int) -> None:
        """Run one instruction while the mask registers hold an exception back, which is due as soon as they are
        cleared. After WFI that instruction is nearly always CPSIE I, which is cheaper to execute here. A branch to
        itself clears no mask: time passes at once up to `until`."""
        place = self.pc - FLASH_BASE if self.loops_at_once else -1
        if place >= 0 and self.flash[place : place + 2] == BRANCH_TO_ITSELF:
            turns = max(1, -(-(until - self.base) // self.instruction_ticks))
            self.base += turns * self.instruction_ticks
            self.instructions += turns
            return
        if place < 0 or self.flash[place : place + 2] != CPSIE_I:
            self.run(1)
            return
        self.uc.reg_write(UC_ARM_REG_PRIMASK, 0)
        self._primask = 0
        self.pc += 2
        self.base += self.instruction_ticks
        self.instructions += 1

    def enter(self, number: int) -> None:
        """Exception entry (Armv7-M B1.5.6): push eight words, load the vector."""
        machine = self.machine
        *frame, xpsr, control = self._before.read()
        stack = self.stack
        if control & NOT_PRIVILEGED:
            raise SimulationError(f"CONTROL = {control} selects unprivileged mode, which is not modelled")
        odd = stack & 4 if machine.scb.ccr & 1 << 9 else 0
        top = stack - odd - FRAME.size
        if self._in_ram(top):
            FRAME.pack_into(self.ram, top - RAM_BASE, *frame[:6], self.pc, xpsr | odd << 7)
        else:
            # The handler of a fault runs even when its pushes failed (Cortex-M3 TRM 5.12.1). For any other exception a
            # failed push raises a hard fault first.
            machine.scb.cfsr |= core.CFSR_STKERR
            if number not in (NMI, HARD_FAULT):
                machine.scb.hfsr |= core.HFSR_FORCED
                number = HARD_FAULT
        stack, exc_return = top & 0xFFFFFFFC, TO_HANDLER if machine.nvic.active else TO_THREAD
        if control & ON_PROCESS_STACK:
            stack, exc_return = self._to_main_stack(stack), TO_THREAD_OF_PROCESS
        place, before = self.pc, self.stack
        self._vector(number, stack, exc_return, ENTRY_CYCLES)
        if number in NAMES:
            self._report(number, place, frame[5], before)

    def _to_main_stack(self, process_stack: int) -> int:
        """Still in thread mode: keep the process stack's pointer, and return that of the main stack, which is in use
        from now on."""
        self.uc.reg_write(UC_ARM_REG_SP, process_stack)
        self.uc.reg_write(UC_ARM_REG_CONTROL, 0)
        return int(self.uc.reg_read(UC_ARM_REG_SP))

    def _to_process_stack(self, xpsr: int) -> None:
        """Back in thread mode, in which CONTROL selects the stack."""
        self.uc.reg_write(UC_ARM_REG_XPSR, xpsr)
        self.uc.reg_write(UC_ARM_REG_CONTROL, ON_PROCESS_STACK)

    def _vector(self, number: int, stack: int, exc_return: int, cycles: int) -> None:
        machine = self.machine
        machine.nvic.enter(number)
        self.sleeping = False
        self._handler.write(stack, exc_return, 1 << 24 | number)
        self.stack = stack
        table = machine.scb.vtor or FLASH_BASE
        handler = int.from_bytes(self.read(table + 4 * number, 4), "little")
        self.pc = handler & ~1
        self.base += cycles * machine.rcc.hclk_ticks

    def _return(self) -> None:
        """Exception return: into the next pending exception without unstacking, else pop the frame."""
        machine = self.machine
        machine.nvic.leave()
        if self._faultmask:
            self.uc.reg_write(UC_ARM_REG_FAULTMASK, 0)
            self._faultmask = 0
        exc_return = self.pc | 1
        if (exc_return == TO_HANDLER) is not bool(machine.nvic.active) or exc_return not in EXC_RETURNS:
            self._refuse_return(exc_return)
            return
        if machine.timeline.next <= self.base:
            machine.timeline.run_due(self.base)
        number = machine.nvic.candidate()
        stack = self.stack
        if number and self.takes(number):
            self._vector(number, stack, exc_return, TAIL_CHAIN_CYCLES)
            return
        if exc_return == TO_THREAD_OF_PROCESS:
            stack = int(self.uc.reg_read(UC_ARM_REG_PSP))
        if not self._in_ram(stack):
            self._lock_up(f"exception return with the stack pointer at 0x{stack:08X}, outside RAM")
            return
        frame = FRAME.unpack_from(self.ram, stack - RAM_BASE)
        if exc_return == TO_THREAD_OF_PROCESS:
            self._to_process_stack(frame[7] & ~(1 << 9))
        above = stack + FRAME.size + (4 if frame[7] & 1 << 9 else 0)
        self._after.write(frame[7] & ~(1 << 9), *frame[:6], above)
        self.pc, self.stack = frame[6], above
        self.base += RETURN_CYCLES * machine.rcc.hclk_ticks
        if machine.scb.scr & 2 and not machine.nvic.active:
            self.sleeping = True

    def _refuse_return(self, exc_return: int) -> None:
        """EXC_RETURN is none, or contradicts the active exceptions: a usage fault, entered in place of the return
        (Armv7-M B1.5.8)."""
        self.machine.scb.cfsr |= core.CFSR_INVPC
        if self._lets(USAGE_FAULT):
            number = USAGE_FAULT
        else:
            number = HARD_FAULT
            self.machine.scb.hfsr |= core.HFSR_FORCED
        place, before = self.pc, self.stack
        self._vector(number, before, 0xF0000000 | exc_return & 0x0FFFFFFF, TAIL_CHAIN_CYCLES)
        self._report(number, place, exc_return, before)

    def _fault(self, error: int) -> None:
        """A bad address or instruction: the fault the core would take, or lock-up when it cannot."""
        block = self.machine.scb
        if error in _DATA_FAULTS:
            block.cfsr |= core.CFSR_PRECISERR | core.CFSR_BFARVALID
            block.bfar = self._fault_address
            self._synchronous(BUS_FAULT)
        elif error in _FETCH_FAULTS and SYSTEM_BASE <= self.pc < SYSTEM_BASE + len(self.system):
            self.machine.enter_rom()
        elif error in _FETCH_FAULTS:
            block.cfsr |= core.CFSR_IBUSERR
            self._synchronous(BUS_FAULT)
        elif error == UC_ERR_INSN_INVALID:
            thumb = self.uc.reg_read(UC_ARM_REG_XPSR) & THUMB
            block.cfsr |= core.CFSR_UNDEFINSTR if thumb else core.CFSR_INVSTATE
            self._synchronous(USAGE_FAULT)
        else:
            raise SimulationError(f"Unicorn stopped with error {error} at 0x{self.pc:08X}")

    def _synchronous(self, number: int) -> None:
        current = self.machine.nvic.execution_priority()
        if not self._lets(number):
            self.machine.scb.hfsr |= core.HFSR_FORCED
            number = HARD_FAULT
            if current <= -1 or not self.takes(number):
                self._lock_up(f"fault inside the fault handler, pc 0x{self.pc:08X}")
                return
        self.enter(number)

    def _lets(self, number: int) -> bool:
        """True when this fault may preempt the running code; else it becomes a hard fault."""
        nvic = self.machine.nvic
        above = nvic.group_priority(number) < nvic.execution_priority()
        return bool(nvic.enabled >> number & 1 and above and self.takes(number))

    def _lock_up(self, why: str) -> None:
        self.locked_up = why
        self.machine.warn(f"the core has locked up: {why}")
        self._report(LOCKUP, self.pc, int(self.uc.reg_read(UC_ARM_REG_LR)), self.stack, why)

    def _report(self, number: int, pc: int, lr: int, stack: int, lockup: str = "") -> None:
        """Tell the machine of a fault of the program. stack: its pointer at the instruction that failed."""
        block = self.machine.scb
        offset = stack - RAM_BASE
        words = self.ram[offset : offset + 4 * STACK_WORDS] if 0 <= offset < len(self.ram) else b""
        stacked = struct.unpack(f"<{len(words) // 4}I", words[: len(words) // 4 * 4])
        registers = block.cfsr, block.hfsr, block.bfar
        self.machine.program_faulted(ProgramFault(number, self.base, pc, lr, stack, *registers, stacked, "", lockup))

    def _in_ram(self, address: int) -> bool:
        return RAM_BASE <= address <= RAM_BASE + len(self.ram) - FRAME.size

    def read(self, address: int, size: int) -> bytes:
        """Bytes of flash or RAM at an address of the core or the DMA."""
        for base, memory in ((RAM_BASE, self.ram), (FLASH_BASE, self.flash)):
            if base <= address and address + size <= base + len(memory):
                return bytes(memory[address - base : address - base + size])
        raise SimulationError(f"read of {size} bytes at 0x{address:08X}: neither flash nor RAM")

    def _on_exception(self, uc: Uc, number: int, _user: object) -> None:
        self._stop_reason = number
        uc.emu_stop()

    def _on_bad_address(self, _uc: Uc, access: int, address: int, size: int, value: int, _user: object) -> bool:
        """A write to flash may be a command to its controller: Unicorn writes it to the memory and the slice ends after
        it; then the write is undone and the command carried out."""
        offset = address - FLASH_BASE
        if access == UC_MEM_WRITE_PROT and 0 <= offset < len(self.flash) and self.machine.flash.takes(size):
            self._flash_write = address, value & 0xFFFF, bytes(self.flash[offset : offset + 2])
            self.end_slice()
            return True
        self._fault_address = address
        return False


def _find_counter(uc: Uc) -> tuple[ctypes.c_size_t, ctypes.c_size_t]:
    """Unicorn's instruction counter and its limit, two neighbouring words of its state, found by their values after a
    run of known length. Raises UsageError when this version of Unicorn does not have them like this."""
    handle = uc._uch.value
    uc.mem_map(0x60000000, 0x1000)
    uc.mem_write(0x60000000, b"\x00\xbf" * 2048)  # no operation
    candidates: set[int] | None = None
    for length in (611, 1013):
        uc.emu_start(0x60000001, NOWHERE, 0, length)
        words = struct.unpack("<512Q", bytes((ctypes.c_char * 4096).from_address(handle)))
        found = {i for i in range(511) if words[i] == length + 1 and words[i + 1] == length}
        candidates = found if candidates is None else candidates & found
    uc.mem_unmap(0x60000000, 0x1000)
    if not candidates or len(candidates) != 1:
        raise UsageError(f"plumb does not know this version of unicorn; install another {install_hint('virtual')}")
    offset = handle + 8 * candidates.pop()
    return ctypes.c_size_t.from_address(offset), ctypes.c_size_t.from_address(offset + 8)
