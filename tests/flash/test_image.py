"""The flash image: what the three files hold, and that a bad image is refused."""

from __future__ import annotations

import re
import shutil
import struct
import subprocess
import sys
import zlib
from pathlib import Path

import pytest

from plumb.errors import UsageError
from plumb.flash.image import load_own_image
from support.linked_images import with_flash_limit

ROOT = Path(__file__).parents[2]
BUILD = ROOT / "build/stm32f103"
FINISH = ROOT / "tools/finish_image.py"
HEADER_OFFSET = 0x130
PARAMETER_SLOTS = 0x0800F000

pytestmark = pytest.mark.skipif(
    not (BUILD / "firmware.bin").exists(), reason="the flash image is not built: run make image"
)


@pytest.fixture(scope="module")
def image() -> bytes:
    return (BUILD / "firmware.bin").read_bytes()


def _header(image: bytes) -> tuple[int, ...]:
    return struct.unpack_from("<6I", image, HEADER_OFFSET)


def test_vectors_lead_into_the_image(image: bytes) -> None:
    stack, *vectors = struct.unpack_from("<76I", image)
    assert 0x20000000 < stack <= 0x20000000 + 20 * 1024 and stack % 8 == 0
    for vector in vectors:
        assert vector & 1 and 0x08000000 + HEADER_OFFSET < vector < 0x08000000 + len(image)


def test_header_and_checksum(image: bytes) -> None:
    magic, family, size, _, _, dirty = _header(image)
    assert image[HEADER_OFFSET : HEADER_OFFSET + 4] == b"plmb" and magic == 0x626D6C70
    assert family == 0x103
    assert size == len(image)
    assert dirty in (0, 1)
    assert struct.unpack("<I", image[-4:])[0] == zlib.crc32(image[:-4])


def test_the_image_ends_before_the_parameters(image: bytes) -> None:
    assert 0x08000000 + len(image) <= PARAMETER_SLOTS


def test_hex_holds_the_same_bytes(image: bytes) -> None:
    flat = bytearray()
    upper = 0
    for line in (BUILD / "firmware.hex").read_text(encoding="ascii").splitlines():
        record = bytes.fromhex(line[1:])
        assert sum(record) & 0xFF == 0
        count, address, kind = struct.unpack_from(">BHB", record)
        data = record[4 : 4 + count]
        if kind == 4:
            upper = int.from_bytes(data, "big") << 16
        elif kind == 0:
            assert upper + address == 0x08000000 + len(flat)
            flat += data
    assert bytes(flat) == image


def test_elf_holds_the_same_bytes(image: bytes, tmp_path: Path) -> None:
    """It is finished already: what comes of finishing it again is the same three files."""
    elf = tmp_path / "firmware.elf"
    shutil.copy(BUILD / "firmware.elf", elf)
    assert _run_finish(elf).returncode == 0
    for kind in ("elf", "bin", "hex"):
        assert elf.with_suffix(f".{kind}").read_bytes() == (BUILD / f"firmware.{kind}").read_bytes()


def test_an_image_over_its_budget_is_linked_and_no_tool_takes_it(tmp_path: Path, image: bytes) -> None:
    """It stays for a look at what takes the bytes; tests/flash/test_named_images.py has the sentence."""
    budget_bytes = len(image) - 1000
    asked = ["ninja", "-t", "commands", "firmware.bin"]  # an output of the link: without it, it is linked again
    link = subprocess.run(asked, cwd=BUILD, capture_output=True, text=True, check=True).stdout.splitlines()[-1]
    over = tmp_path / "firmware.elf"
    link = re.sub(r"(--defsym=flash_budget=)\d+", rf"\g<1>{budget_bytes}", link.split("&&")[1])
    link = link.replace("-o firmware.elf", f"-o {over}").replace(
        str(BUILD / "firmware.map"), str(tmp_path / "over.map")
    )
    subprocess.run(link, shell=True, cwd=BUILD, capture_output=True, text=True, check=True)
    check = [sys.executable, str(ROOT / "tools/check_elf.py"), str(over)]
    checked = subprocess.run(check, capture_output=True, text=True, check=False)
    assert checked.returncode == 1 and f"{budget_bytes} that it may take; leave out one of " in checked.stderr
    with pytest.raises(UsageError, match="damaged"):
        load_own_image(over)
    assert _run_finish(over).returncode == 1
    assert not over.with_suffix(".bin").exists()


def _run_finish(elf: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, str(FINISH), str(elf)], capture_output=True, text=True)


def test_over_budget_and_foreign_files_are_refused(tmp_path: Path) -> None:
    elf = tmp_path / "firmware.elf"
    shutil.copy(BUILD / "firmware.elf", elf)
    assert _run_finish(elf).returncode == 0
    shutil.copy(elf, tmp_path / "small.elf")
    small = _run_finish(with_flash_limit(tmp_path / "small.elf", 1000))
    assert small.returncode == 1 and "over its budget" in small.stderr
    broken = bytearray(elf.read_bytes())
    broken[18:20] = b"\x3e\x00"  # x86-64
    elf.write_bytes(broken)
    refused = _run_finish(elf)
    assert refused.returncode == 2 and "ELF file for Arm" in refused.stderr
    broken[18:20] = b"\x28\x00"
    elf.write_bytes(broken[:1000])
    cut = _run_finish(elf)
    assert cut.returncode in (1, 2) and "Traceback" not in cut.stderr
    elf.write_bytes(broken.replace(struct.pack("<I", 0x626D6C70), b"\0\0\0\0"))
    headless = _run_finish(elf)
    assert headless.returncode == 1 and "header" in headless.stderr
