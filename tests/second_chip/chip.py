"""Memory map and processor: Unicorn runs the instructions, the model takes exceptions, sleeps and keeps time.

An instruction counts as one cycle, and time passes in slices of instructions, so no figure of this model is a claim
about the speed of code. Registers that are read within a slice see time pass by ACCESS_CYCLES for every access.
"""

from __future__ import annotations

import ctypes
import heapq
import itertools
import math
import random
import struct
from collections.abc import Callable
from typing import Any

import unicorn
from unicorn import arm_const as arm

from second_chip.adc import Adc, Adc2
from second_chip.block import Block
from second_chip.bxcan import BxCan
from second_chip.clocks import PIN_RESET, SOFTWARE_RESET, UNITS_HZ, Backup, Pwr, Rcc
from second_chip.crc import CrcUnit
from second_chip.flash import FlashController
from second_chip.i2c import I2c
from second_chip.interrupts import Nvic
from second_chip.pins import Afio, Port
from second_chip.serial import Dma, Usart, Usart3
from second_chip.spi import Spi
from second_chip.timers import AdvancedTimer, Timer
from second_chip.watchdogs import Iwdg, Wwdg

FLASH, RAM, RAM_BYTES = 0x08000000, 0x20000000, 20 * 1024
SYSTEM_MEMORY = 0x1FFFF000
"""ROM bootloader, and from 0x1FFFF7E0 on the size of the flash and the unique id (RM0008 30)."""
PERIPHERALS, CRC_UNIT = 0x40000000, 0x40023000
"""The CRC unit is the last of the peripherals."""
SYSTEM_SPACE = 0xE000E000
EXCEPTION_RETURN = 0xFFFFFFF0
"""From here on an address in LR means: return from an exception (Armv7-M B1.5.8)."""
WFI = b"\x30\xbf"
SLICE_CYCLES = 500
ACCESS_CYCLES = 4
FRAME = (arm.UC_ARM_REG_R0, arm.UC_ARM_REG_R1, arm.UC_ARM_REG_R2, arm.UC_ARM_REG_R3, arm.UC_ARM_REG_R12,
         arm.UC_ARM_REG_LR, arm.UC_ARM_REG_PC, arm.UC_ARM_REG_XPSR)  # fmt: skip
"""What the processor stores on exception entry, from the lowest address up (Armv7-M B1.5.6)."""


class Chip:
    """An STM32F103C8 with an image in its flash, powered up.

    crystal: whether there is one. memory_seed: what the cells of the RAM fall into. unit: one cycle in units of time.
    """

    def __init__(self, image: bytes, *, crystal: bool = True, memory_seed: int = 1, flash_kib: int = 64) -> None:
        self.crystal = crystal
        self.now = 0
        self.events: list[tuple[int, int, Callable[[], None]]] = []
        self._sequence = itertools.count()
        self._trouble: BaseException | None = None
        self._reset_flags = 0
        self._slice_end = 0
        self.asleep = False
        self.resets = 0

        self.flash = (ctypes.c_ubyte * (flash_kib * 1024))(*image.ljust(flash_kib * 1024, b"\xff"))
        self.ram = (ctypes.c_ubyte * RAM_BYTES)(*random.Random(memory_seed).randbytes(RAM_BYTES))
        signature = bytearray(b"\xff" * 4096)
        struct.pack_into("<H", signature, 0x7E0, flash_kib)
        struct.pack_into("<3I", signature, 0x7E8, 0x0BADC0DE, 0x5EC0, 0x103)
        self._system = (ctypes.c_ubyte * 4096)(*signature)

        self.nvic = Nvic(self)
        self.rcc = Rcc(self)
        self.pwr, self.backup = Pwr(self), Backup(self)
        self.ports = {name: Port(self, name, bit) for name, bit in (("A", 2), ("B", 3), ("C", 4))}
        self.ports["B"].outside = {8: 1, 9: 1}  # the pull-ups of I2C
        self.afio = Afio(self)
        self.crc = CrcUnit(self)
        self.flash_controller = FlashController(self)
        self.dma = Dma(self)
        self.uart = Usart(self)
        self.usart3 = Usart3(self)
        self.can = BxCan(self)
        self.adc = Adc(self)
        self.adc2 = Adc2(self, self.adc)
        self.i2c = I2c(self)
        self.spi = Spi(self)
        self.tim1 = AdvancedTimer(self)
        self.tim2, self.tim3, self.tim4 = Timer(self, 2), Timer(self, 3), Timer(self, 4)
        self.wwdg, self.iwdg = Wwdg(self), Iwdg(self)
        self.blocks: dict[int, Block] = {
            0x40000000: self.tim2,
            0x40000400: self.tim3,
            0x40000800: self.tim4,
            0x40002C00: self.wwdg,
            0x40003000: self.iwdg,
            0x40004800: self.usart3,
            0x40005400: self.i2c,
            0x40006400: self.can,
            0x40006C00: self.backup,
            0x40007000: self.pwr,
            0x40010000: self.afio,
            0x40010800: self.ports["A"],
            0x40010C00: self.ports["B"],
            0x40011000: self.ports["C"],
            0x40012400: self.adc,
            0x40012800: self.adc2,
            0x40012C00: self.tim1,
            0x40013000: self.spi,
            0x40013800: self.uart,
            0x40020000: self.dma,
            0x40021000: self.rcc,
            0x40022000: self.flash_controller,
            CRC_UNIT: self.crc,
        }

        self._cpu = unicorn.Uc(unicorn.UC_ARCH_ARM, unicorn.UC_MODE_THUMB | unicorn.UC_MODE_MCLASS)
        self._cpu.ctl_set_cpu_model(arm.UC_CPU_ARM_CORTEX_M3)
        read_run = unicorn.UC_PROT_READ | unicorn.UC_PROT_EXEC
        self._cpu.mem_map_ptr(FLASH, len(self.flash), read_run, ctypes.addressof(self.flash))
        self._cpu.mem_map_ptr(SYSTEM_MEMORY, 4096, read_run, ctypes.addressof(self._system))
        self._cpu.mem_map_ptr(RAM, RAM_BYTES, unicorn.UC_PROT_ALL, ctypes.addressof(self.ram))
        for base, size in ((PERIPHERALS, CRC_UNIT - PERIPHERALS), (CRC_UNIT, 0x1000), (SYSTEM_SPACE, 0x1000)):
            write = self._crc_write if base == CRC_UNIT else self._cpu_write
            self._cpu.mmio_map(base, size, self._cpu_read, base, write, base)
        self._cpu.hook_add(unicorn.UC_HOOK_INTR, lambda cpu, number, _: cpu.emu_stop())
        self._cpu.hook_add(unicorn.UC_HOOK_MEM_WRITE_PROT, self._flash_store)
        self._start()

    # ---- time ----

    def after(self, units: int, action: Callable[[], None]) -> None:
        heapq.heappush(self.events, (self.now + units, next(self._sequence), action))

    def after_us(self, microseconds: float, action: Callable[[], None]) -> None:
        self.after(round(microseconds * UNITS_HZ / 1e6), action)

    def seconds(self) -> float:
        return self.now / UNITS_HZ

    def _pass_time(self, until: int) -> None:
        """Whatever happens outside the processor up to a time."""
        while self.events and self.events[0][0] <= until:
            when, _, action = heapq.heappop(self.events)
            self.now = max(self.now, when)
            action()
            if self._reset_flags:
                return
        self.now = max(self.now, until)

    def stall_us(self, microseconds: float) -> None:
        """The processor stands still in the middle of an instruction: its flash is busy."""
        self._pass_time(self.now + round(microseconds * UNITS_HZ / 1e6))
        self._slice_end = max(self._slice_end, self.now)

    def run(self, seconds: float) -> None:
        self.run_until(lambda: False, seconds)

    def run_until(self, done: Callable[[], bool], seconds: float) -> bool:
        """Runs until done() holds, for `seconds` at most; looked at after every slice."""
        end = self.now + math.ceil(seconds * UNITS_HZ)  # who waits for any time at all gets some
        while not (reached := done()) and self.now < end:
            self._turn(end)
        return reached

    # ---- processor ----

    def ask_reset(self, *, software: bool = False, flags: int = 0) -> None:
        """Without arguments, by the reset pin; every other reset pulls it, too (RM0008 7.1.1)."""
        self._reset_flags |= flags | PIN_RESET | (SOFTWARE_RESET if software else 0)
        self._cpu.emu_stop()

    def _reset(self) -> None:
        """System reset: backup registers and memory keep what they hold."""
        flags, self._reset_flags = self._reset_flags, 0
        self.events.clear()
        self.nvic.reset()
        for block in self.blocks.values():
            block.reset()
        self.uart.listen_again()
        self.usart3.listen_again()
        self.can.listen_again()
        self.rcc.value["CSR"] |= flags
        self.resets += 1
        self._start()

    def _start(self) -> None:
        self.asleep = False
        self._slice_end = self.now
        self._cpu.reg_write(arm.UC_ARM_REG_XPSR, 1 << 24)
        self._cpu.reg_write(arm.UC_ARM_REG_PRIMASK, 0)
        stack, entry = struct.unpack("<2I", bytes(self.flash[:8]))
        self._cpu.reg_write(arm.UC_ARM_REG_SP, stack)
        self._cpu.reg_write(arm.UC_ARM_REG_LR, 0xFFFFFFFF)
        self._pc = entry & ~1

    def _turn(self, end: int) -> None:
        if self._reset_flags:
            self._reset()
        waiting = self.nvic.next(masked=False)
        if self.asleep:
            if waiting is None:
                self._pass_time(min(end, self.events[0][0]) if self.events else end)
                return
            self.asleep = False  # also with interrupts masked (Armv7-M B1.5.17)
        masked = waiting is not None and bool(self._cpu.reg_read(arm.UC_ARM_REG_PRIMASK))
        if waiting is not None and (number := self.nvic.next(masked)) is not None:
            self._enter(number)
        elif waiting is not None:
            self._slice(1)  # to the instruction that lets the interrupt in
        else:
            limit = min(end, self.events[0][0]) if self.events else end
            self._slice(max(1, min(SLICE_CYCLES, (limit - self.now) // self.rcc.cycle)))

    def _slice(self, cycles: int) -> None:
        begin, self._slice_end = self.now, self.now + cycles * self.rcc.cycle
        self._cpu.emu_start(self._pc | 1, EXCEPTION_RETURN, count=cycles)
        if self._trouble is not None:
            raise self._trouble
        self.flash_controller.settle()
        self._pc = self._cpu.reg_read(arm.UC_ARM_REG_PC)
        if self._reset_flags:
            return
        if self._pc >= EXCEPTION_RETURN:
            self._leave()
        elif self._ran_wfi():
            self.asleep = True
            self._pass_time(max(self.now, begin))
            return
        self._pass_time(self._slice_end)

    def _ran_wfi(self) -> bool:
        at = self._pc - 2 - FLASH
        return 0 <= at < len(self.flash) and bytes(self.flash[at : at + 2]) == WFI

    def _enter(self, number: int) -> None:
        frame = [self._cpu.reg_read(register) for register in FRAME]
        frame[6] = self._pc
        stack = self._cpu.reg_read(arm.UC_ARM_REG_SP) - 32
        self._cpu.mem_write(stack, struct.pack("<8I", *frame))
        self._cpu.reg_write(arm.UC_ARM_REG_SP, stack)
        self._cpu.reg_write(arm.UC_ARM_REG_LR, 0xFFFFFFF1 if self.nvic.active else 0xFFFFFFF9)
        self.nvic.enter(number)
        self._cpu.reg_write(arm.UC_ARM_REG_XPSR, 1 << 24 | number)
        self._pc = self.word(self.nvic.vtor + 4 * number) & ~1

    def _leave(self) -> None:
        self.nvic.leave()
        stack = self._cpu.reg_read(arm.UC_ARM_REG_SP)
        frame = struct.unpack("<8I", self._cpu.mem_read(stack, 32))
        self._cpu.reg_write(arm.UC_ARM_REG_SP, stack + 32)
        for register, value in zip(FRAME, frame, strict=True):
            if register != arm.UC_ARM_REG_PC:
                self._cpu.reg_write(register, value)
        self._pc = frame[6] & ~1

    # ---- buses ----

    def word(self, address: int) -> int:
        address = FLASH + address if address < len(self.flash) else address  # booted from flash: it is at 0, too
        return int.from_bytes(self._cpu.mem_read(address, 4), "little")

    def load(self, address: int, size: int) -> int:
        """As DMA reads memory or a register."""
        if RAM <= address < RAM + RAM_BYTES:
            return int.from_bytes(bytes(self.ram[address - RAM : address - RAM + size]), "little")
        return self.block_at(address).read(address & 0x3FF)

    def store(self, address: int, size: int, value: int) -> None:
        """As DMA writes memory or a register."""
        if RAM <= address < RAM + RAM_BYTES:
            at = address - RAM
            for i in range(size):
                self.ram[at + i] = value >> 8 * i & 0xFF
        else:
            self.block_at(address).write(address & 0x3FF, value)

    def block_at(self, address: int) -> Block:
        return self.blocks[address & ~0x3FF]

    def _accessed(self, size: int) -> None:
        self.flash_controller.settle()
        if size != 4:
            raise ValueError("the firmware accesses registers as whole words")
        self.now = max(self.now, min(self.now + ACCESS_CYCLES * self.rcc.cycle, self._slice_end - 1))

    def _cpu_read(self, cpu: Any, offset: int, size: int, base: int) -> int:
        try:
            self._accessed(size)
            if base == SYSTEM_SPACE:
                return self.nvic.read(offset)
            return self.blocks[base + offset & ~0x3FF].read(offset & 0x3FF)
        except Exception as error:
            self._fail(error, f"reading {base + offset:#010x}")
            return 0

    def _cpu_write(self, cpu: Any, offset: int, size: int, value: int, base: int) -> None:
        try:
            self._accessed(size)
            if base == SYSTEM_SPACE:
                self.nvic.write(offset, value)
            else:
                self.blocks[base + offset & ~0x3FF].write(offset & 0x3FF, value)
        except Exception as error:
            self._fail(error, f"writing {value:#x} to {base + offset:#010x}")

    def _crc_write(self, cpu: Any, offset: int, size: int, value: int, base: int) -> None:
        """As _cpu_write, without time: nine of ten accesses are the firmware's checks of its memory."""
        if offset == 0 and size == 4 and self.crc.clocked():
            self.crc.write_DR(value)
        else:
            self._cpu_write(cpu, offset, size, value, base)

    def _flash_store(self, cpu: Any, access: int, address: int, size: int, value: int, _: Any) -> bool:
        try:
            self.flash_controller.store(address - FLASH, size, value)
        except Exception as error:
            self._fail(error, f"storing {value:#x} at {address:#010x}")
        return True

    def _fail(self, error: Exception, what: str) -> None:
        error.add_note(f"{what}, pc {self._cpu.reg_read(arm.UC_ARM_REG_PC):#010x}")
        self._trouble = self._trouble or error
        self._cpu.emu_stop()
