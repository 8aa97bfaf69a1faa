"""Flashing over a debug probe with OpenOCD or pyOCD: separate programs, run by their command lines.

Both do the same three things: identify the chip, write an image erasing only the pages that it covers, and read the
flash back. The written bytes are compared here, whatever the tool reports.

Tested with programs that imitate OpenOCD and pyOCD (tests/flash/test_probe.py), not with silicon.
"""

from __future__ import annotations

import re
import shutil
import subprocess
from abc import ABC, abstractmethod
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from plumb.errors import LinkError, UsageError
from plumb.flash.image import FLASH_BASE
from plumb.flash.rom_loader import FLASH_SIZE_ADDRESS, Flashed, Part, part_of

DEVICE_ID_ADDRESS = 0xE0042000
CLONE_IDCODE = 0x2BA01477
"""IDCODE of the debug port of clones; ST's STM32F103 has 0x1BA01477."""
TIMEOUT_S = 120.0


@dataclass(frozen=True)
class Chip:
    """The chip at the probe. part: as the bootloader would report it. idcode: of the debug port, None when the tool did
    not show it."""

    part: Part
    idcode: int | None

    @property
    def clone(self) -> bool:
        return self.idcode == CLONE_IDCODE


class ToolError(LinkError):
    """The tool failed. said: its whole output."""

    def __init__(self, text: str, said: str) -> None:
        super().__init__(text)
        self.said = said


class Probe(ABC):
    """One of the tools. Raises UsageError when it is not installed, LinkError when it fails."""

    name: str
    advice: str

    def __init__(self) -> None:
        program = shutil.which(self.name)
        if program is None:
            raise UsageError(f"{self.name} is not installed; {self.advice}")
        self._program = program

    def _run(self, arguments: list[str]) -> str:
        """Run the tool; its whole output."""
        try:
            done = subprocess.run(
                [self._program, *arguments], capture_output=True, text=True, timeout=TIMEOUT_S, check=False
            )
        except subprocess.TimeoutExpired:
            raise LinkError(f"{self.name} did not come to an end: unplug the probe, plug it in and try again") from None
        said = done.stdout + done.stderr
        if done.returncode:
            lines = [line.strip() for line in said.splitlines() if line.strip()] or ["it does not say why"]
            why = next((line for line in lines if "error" in line.lower()), lines[-1])
            raise ToolError(f"{self.name} failed ({why}): check the probe, its wires and the board's power", said)
        return said

    @abstractmethod
    def identify(self) -> Chip:
        """Halt the chip and identify it."""

    @abstractmethod
    def write(self, image: Path) -> None:
        """Write a .bin to the start of flash, erasing the pages that it covers and no others."""

    @abstractmethod
    def read_to(self, file: Path, count: int) -> None:
        """Read the first `count` bytes of flash into a file."""

    @abstractmethod
    def start(self) -> None:
        """Reset and run."""

    def _chip(self, idcode: str | None, device_id: str | None, size: str | None) -> Chip:
        """The chip, from hexadecimal numbers found in the output of the tool; None where there was none."""
        if device_id is None:
            raise LinkError(f"{self.name} shows no chip: check the probe, its wires and the board's power")
        flash_kib = int(size, 16) if size is not None else None
        part = part_of(int(device_id, 16) & 0xFFF, flash_kib, 0)
        return Chip(part, int(idcode, 16) if idcode is not None else None)


def _found(pattern: str, text: str) -> str | None:
    match = re.search(pattern, text, re.IGNORECASE)
    return match[1] if match else None


class OpenOcd(Probe):
    """OpenOCD. interface: name of one of its interface files, `stlink` or `cmsis-dap`."""

    name = "openocd"
    advice = "apt install openocd, or use --probe pyocd"

    def __init__(self, interface: str = "stlink") -> None:
        super().__init__()
        self._interface = f"interface/{interface}.cfg"
        self._any_id: list[str] = []

    def _commands(self, *commands: str) -> str:
        script = ["init", "reset halt", *commands, "shutdown"]
        begin = ["-f", self._interface, *self._any_id, "-f", "target/stm32f1x.cfg"]
        return self._run([*begin, *(part for command in script for part in ("-c", command))])

    def identify(self) -> Chip:
        reads = f"mdw 0x{DEVICE_ID_ADDRESS:08x}", f"mdh 0x{FLASH_SIZE_ADDRESS:08x}"
        try:
            said = self._commands(*reads)
        except ToolError as error:
            # With an ST-Link, OpenOCD prints the debug port's id only when it is not ST's, and then stops.
            if "UNEXPECTED idcode" not in error.said:
                raise
            self._any_id = ["-c", "set CPUTAPID 0"]
            said = error.said + self._commands(*reads)
        return self._chip(
            _found(r"(?:DPIDR|idcode:?)\s+0x([0-9a-f]{8})", said),
            _found(rf"0x{DEVICE_ID_ADDRESS:08x}:\s*([0-9a-f]{{8}})", said),
            _found(rf"0x{FLASH_SIZE_ADDRESS:08x}:\s*([0-9a-f]{{4}})\b", said),
        )

    def write(self, image: Path) -> None:
        self._commands(f"flash write_image erase {{{image}}} 0x{FLASH_BASE:08x} bin")

    def read_to(self, file: Path, count: int) -> None:
        self._commands(f"dump_image {{{file}}} 0x{FLASH_BASE:08x} {count}")

    def start(self) -> None:
        self._commands("reset run")


class PyOcd(Probe):
    """pyOCD. It has built-in support for the high-density part; others need its pack: pyocd pack install
    stm32f103c8."""

    name = "pyocd"
    advice = "pip install pyocd, or use --probe openocd"
    _TARGETS: dict[int, str] = {0x410: "stm32f103c8", 0x414: "stm32f103rc", 0x430: "stm32f103rg"}  # noqa: RUF012

    def __init__(self) -> None:
        super().__init__()
        self._target = "cortex_m"

    def _commander(self, *commands: str) -> str:
        script = [part for command in ("halt", *commands) for part in ("-c", command)]
        return self._run(["commander", "-W", "--color", "never", "-L", "*.dap=info", "-t", self._target, *script])

    def identify(self) -> Chip:
        said = self._commander(f"read32 0x{DEVICE_ID_ADDRESS:08x}", f"read16 0x{FLASH_SIZE_ADDRESS:08x}")
        chip = self._chip(
            _found(r"DP IDR\s*=\s*0x([0-9a-f]{8})", said),
            _found(rf"{DEVICE_ID_ADDRESS:08x}:\s*([0-9a-f]{{8}})", said),
            _found(rf"{FLASH_SIZE_ADDRESS:08x}:\s*([0-9a-f]{{4}})\b", said),
        )
        self._target = self._TARGETS[chip.part.device_id]
        return chip

    def write(self, image: Path) -> None:
        base = f"0x{FLASH_BASE:08x}"
        self._run(["load", "-W", "--color", "never", "-t", self._target, "-e", "sector", "--no-reset", "-a", base,
                   "--format", "bin", str(image)])  # fmt: skip

    def read_to(self, file: Path, count: int) -> None:
        self._commander(f"savemem 0x{FLASH_BASE:08x} {count} {file}")

    def start(self) -> None:
        self._run(["reset", "-W", "--color", "never", "-t", self._target])


def open_probe(spec: str) -> Probe:
    """`openocd`, `openocd:INTERFACE` or `pyocd`; raises UsageError for another name."""
    tool, _, interface = spec.partition(":")
    if tool == "openocd" and re.fullmatch(r"[\w./-]*", interface):
        return OpenOcd(interface or "stlink")
    if spec == "pyocd":
        return PyOcd()
    raise UsageError(f"'{spec}' is no probe; write openocd, openocd:cmsis-dap or pyocd")


def program(probe: Probe, part: Part, image: bytes) -> Flashed:
    """Writes the image and reads it back. Raises UsageError, before anything is written, when it does not fit."""
    if len(image) > part.flash_kib * 1024:
        raise UsageError(
            f"the image has {len(image)} bytes, the chip {part.flash_kib} KiB of flash; nothing was written"
        )
    with TemporaryDirectory() as folder:
        source, back = Path(folder, "image.bin"), Path(folder, "back.bin")
        source.write_bytes(image)
        probe.write(source)
        probe.read_to(back, len(image))
        found = back.read_bytes() if back.exists() else b""
    if len(found) != len(image):
        raise LinkError(f"{probe.name} gave {len(found)} of {len(image)} bytes back: what was written is not verified")
    wrong = [i for i, (is_, should_be) in enumerate(zip(found, image, strict=True)) if is_ != should_be]
    pages = range((len(image) + part.page_bytes - 1) // part.page_bytes)
    return Flashed(part, pages, wrong, found == b"\xff" * len(image))
