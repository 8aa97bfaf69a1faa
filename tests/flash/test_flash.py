"""`plumb flash` end to end against a simulated ROM bootloader: it writes what it should, no more, and says when not."""

from __future__ import annotations

import itertools
import json
import shutil
import struct
import subprocess
import sys
import zlib
from dataclasses import fields
from pathlib import Path
from types import SimpleNamespace

import pytest

from plumb.__main__ import main
from plumb.errors import UsageError
from plumb.flash import rom_loader
from plumb.flash.image import own_header
from plumb.spec import declarations

pytest.importorskip("pty", reason="the simulated bootloader needs a pseudo-terminal")
pytest.importorskip("stm32loader", reason="stm32loader is not installed: the extra flash")

from plumb.flash.rom_model import EXTENDED_ERASE, FLASH, GET, GET_ID, READ, WRITE, Faults
from support.bootloader import Bootloader
from support.made_image import made_image

ROOT = Path(__file__).parents[2]
BUILD = ROOT / "build/stm32f103/firmware.bin"
SLOTS = 0xF000
ERASE = 0x43
needs_image = pytest.mark.skipif(not BUILD.exists(), reason="the flash image is not built: run make image")


@pytest.fixture
def small(tmp_path: Path) -> Path:
    """Two pages and a bit, so that trouble comes quickly."""
    path = tmp_path / "small.bin"
    path.write_bytes(made_image(2100))
    return path


@pytest.fixture(autouse=True)
def less_patience(monkeypatch: pytest.MonkeyPatch) -> None:
    """The simulated chip answers at once; what it does not answer at once it never does."""
    monkeypatch.setattr(rom_loader, "REPLY_S", 0.5)
    monkeypatch.setattr(rom_loader, "SYNC_S", 0.15)


def described(value: object) -> str | None:
    """A row of Faults by what is unusual about it."""
    if not isinstance(value, Faults):
        return None
    return "-".join(f"{f.name}={getattr(value, f.name)}" for f in fields(value) if getattr(value, f.name))


def flash(chip: Bootloader, image: Path, *more: str) -> int:
    return main(["flash", "--port", chip.port, "--image", str(image), "--wait", "2", *more])


def sentence(capsys: pytest.CaptureFixture[str]) -> str:
    """The complaint: one line, behind what was announced."""
    lines = [line for line in capsys.readouterr().err.splitlines() if line.startswith("plumb: ")]
    assert len(lines) == 1
    return lines[0]


@needs_image
@pytest.mark.parametrize(
    ("device_id", "flash_kib", "extended", "page_bytes"),
    [(0x410, 64, False, 1024), (0x410, 128, True, 1024), (0x414, 512, False, 2048), (0x430, 1024, True, 2048)],
)
def test_the_real_image_and_nothing_else(
    device_id: int, flash_kib: int, extended: bool, page_bytes: int, capsys: pytest.CaptureFixture[str]
) -> None:
    image = BUILD.read_bytes()
    pages = -(-len(image) // page_bytes)
    with Bootloader(device_id=device_id, flash_kib=flash_kib, extended=extended) as chip:
        assert flash(chip, BUILD, "--json") == 0
    assert bytes(chip.flash[: len(image)]) == image
    assert chip.erased == list(range(pages))
    assert set(chip.flash[pages * page_bytes :]) == {0xA5}
    assert (EXTENDED_ERASE in chip.commands) == extended
    assert chip.commands.count(READ) >= len(image) // 256
    assert chip.started_at == FLASH
    output = capsys.readouterr()
    report = json.loads(output.out)
    assert report["verdict"] == "pass" and report["bytes"] == len(image) and report["pages_erased"] == pages
    assert report["part"]["device_id"] == device_id and report["part"]["flash_kib"] == flash_kib
    assert report["git_hash"] == own_header(image, "").git_hash
    assert "Extended" not in output.err and report["asked"] is False


def test_without_json_one_line(small: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with Bootloader() as chip:
        assert flash(chip, small) == 0
    (line,) = capsys.readouterr().out.splitlines()
    assert "2,100 bytes in 3 pages" in line and "BOOT0 back to 0" in line


# Bytes after the sync: GET 0-1, GET ID 2-3, READ of the size 4-12, ERASE of three pages 13-27, then WRITE: command
# 28-29, address 30-34, length 35, data 36-291, checksum 292.
@pytest.mark.slow
@pytest.mark.parametrize(
    "faults",
    [
        Faults(deaf_syncs=1),
        Faults(deaf_syncs=3),
        *(Faults(nack={command: 1}) for command in (GET, GET_ID, READ, ERASE, WRITE)),
        Faults(nack={WRITE: 2}),
        *(Faults(lose_received=frozenset({number})) for number in (1, 2, 7, 12, 28, 31, 34, 100, 292)),
        *(Faults(lose_sent=frozenset({number})) for number in (5, 18, 20, 24)),
        Faults(lose_sent=frozenset({33}), deaf_syncs=1),
    ],
    ids=described,
)
def test_it_gets_over_trouble_once(faults: Faults, small: Path) -> None:
    with Bootloader(faults) as chip:
        assert flash(chip, small) == 0
    assert bytes(chip.flash[:2100]) == small.read_bytes()
    assert set(chip.erased) == {0, 1, 2}
    assert chip.started_at == FLASH


def test_a_host_that_was_busy_looks_at_what_arrived(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its clock is an hour on at every look."""

    class Port:
        pieces: tuple[bytes, ...] = (b"", b"\x79", b"", b"")

        def read(self, _count: int) -> bytes:
            piece, *rest = self.pieces
            self.pieces = tuple(rest)
            return piece

    line = object.__new__(rom_loader.Line)
    line.timeout, line._port, hours = 0.5, Port(), itertools.count()
    monkeypatch.setattr(rom_loader, "time", SimpleNamespace(monotonic=lambda: 3600.0 * next(hours)))
    assert line.read() == b"\x79"
    with pytest.raises(rom_loader.SilenceError, match="0 bytes of 1 came"):
        line.read()


@pytest.mark.slow
def test_the_steps_are_printed_when_no_bootloader_answers(small: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A user may take its time with jumper and button."""
    with Bootloader(Faults(deaf_syncs=5)) as chip:
        assert flash(chip, small) == 0
    steps = capsys.readouterr().err
    assert "set BOOT0 to 1" in steps and "press RESET" in steps and "TX to PA10" in steps


def harmful(block: bytes) -> bool:
    """Whether a chip that misses the length of this block does something."""
    with Bootloader() as chip:
        chip.receive(b"\x7f\x31\xce\x08\x00\x00\x00\x08")
        chip.flash[:] = b"\xff" * len(chip.flash)
        chip.receive(block + b"\x00" + b"\x7f" * 8)
    return bool(chip.erased or chip.written or chip.started_at is not None)


def test_no_block_becomes_a_command_when_its_length_is_lost() -> None:
    """The first byte of data is then the length, and what follows a command: here one that erases page 60."""
    erases = bytes([1, 2, 3, 2]) + bytes([ERASE, ERASE ^ 0xFF, 0, 60, 60]) + bytes(247)
    assert harmful(erases)
    count = rom_loader.block_bytes(erases)
    assert 0 < count < len(erases) and count % 4 == 0 and not harmful(erases[:count])
    writes = bytes([3, 1, 2, 3, 4, 3 ^ 1 ^ 2 ^ 3 ^ 4]) + bytes(250)
    assert harmful(writes) and not harmful(writes[: rom_loader.block_bytes(writes)])
    assert rom_loader.block_bytes(bytes(range(256))) == 256


def test_a_block_that_could_be_a_command_is_written_in_parts(tmp_path: Path) -> None:
    image = bytearray(made_image(2100)[:-4])
    image[1024:1280] = bytes([1, 2, 3, 2]) + bytes([ERASE, ERASE ^ 0xFF, 0, 60, 60]) + bytes(247)
    path = tmp_path / "image.bin"
    path.write_bytes(bytes(image) + struct.pack("<I", zlib.crc32(image)))
    # Byte 28 begins the first WRITE, each 266 bytes long; the fifth begins the page.
    with Bootloader(Faults(lose_received=frozenset({28 + 4 * 265 + 7}))) as chip:
        assert flash(chip, path) == 0
    assert bytes(chip.flash[:2100]) == path.read_bytes() and set(chip.erased) == {0, 1, 2}


def test_a_bootloader_that_is_awake_already(small: Path) -> None:
    import serial

    with Bootloader() as chip:
        with serial.Serial(chip.port, 115200, timeout=5) as port:
            port.write(b"\x7f")
            assert port.read() == b"\x79"
        assert flash(chip, small) == 0
    assert bytes(chip.flash[:2100]) == small.read_bytes()


def test_a_chip_that_hides_its_size_gets_the_least_of_its_kind(small: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with Bootloader(Faults(hides_size=True), flash_kib=128) as chip:
        assert flash(chip, small, "--json") == 0
    part = json.loads(capsys.readouterr().out)["part"]
    assert part["flash_kib"] == 64 and part["size_known"] is False


@pytest.mark.parametrize(
    ("faults", "words", "wrong", "first"),
    [
        (Faults(stores_nothing=True), "holds nothing", None, None),
        (
            Faults(stuck={FLASH + 0x404: 0}),
            "1 of 2100 bytes read back wrong, the first at 0x08000404",
            1,
            FLASH + 0x404,
        ),
        (Faults(stuck={FLASH + 2099: 0, FLASH: 1}), "2 of 2100", 2, FLASH),
    ],
    ids=["clone", "one byte", "first and last"],
)
def test_what_reads_back_wrong_is_exit_1_and_not_started(
    faults: Faults, words: str, wrong: int | None, first: int | None, small: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with Bootloader(faults) as chip:
        assert flash(chip, small, "--json") == 1
    output = capsys.readouterr()
    assert words in output.err and "Traceback" not in output.err
    report = json.loads(output.out)
    assert report["verdict"] == "fail" and report["started"] is False
    if wrong:
        assert (report["wrong_bytes"], report["first_wrong_address"]) == (wrong, first)
    assert chip.started_at is None


@pytest.mark.slow
@pytest.mark.parametrize(
    ("faults", "words"),
    [
        (Faults(deaf_syncs=10**6), "no bootloader answers: set BOOT0 to 1"),
        (Faults(nack={ERASE: 99}), "refused to erase page 0"),
        (Faults(nack={WRITE: 99}), "refused to be written at 0x08000000"),
        (Faults(nack={GET: 99}), "refused to report its version"),
        (Faults(protected=True), "read protection"),
        (Faults(dies_after=1), "stopped answering"),
        (Faults(dies_after=100), "stopped answering"),
        (Faults(lose_received=frozenset({15})), "stopped answering"),
        (Faults(lose_sent=frozenset({26})), "stopped answering"),
    ],
    ids=described,
)
def test_link_trouble_is_exit_3_and_one_sentence(
    faults: Faults, words: str, small: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with Bootloader(faults) as chip:
        assert flash(chip, small) == 3
    assert words in sentence(capsys)
    assert chip.started_at is None
    assert set(chip.erased) <= {0, 1, 2}


@pytest.mark.parametrize(
    ("device_id", "flash_kib", "words"),
    [(0x413, 1024, "no STM32F103"), (0x412, 32, "no STM32F103"), (0x420, 128, "no STM32F103"), (0x410, 16, "16 KiB")],
)
def test_a_chip_that_the_image_is_not_for_is_left_alone(
    device_id: int, flash_kib: int, words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    image = tmp_path / "image.bin"
    image.write_bytes(made_image(16 * 1024 + 4))
    with Bootloader(device_id=device_id, flash_kib=flash_kib) as chip:
        assert flash(chip, image) == 2
    assert words in sentence(capsys)
    assert set(chip.flash) == {0xA5} and chip.started_at is None


@pytest.mark.parametrize(
    ("image", "words"),
    [
        (made_image(2100, magic=b"plum"), "not a plumb image"),
        (made_image(2100, family=0x407), "another part"),
        (made_image(2100)[:-1], "damaged"),
        (made_image(2100, claims=2104), "damaged"),
        (made_image(2100)[:700] + b"!" + made_image(2100)[701:], "damaged"),
        (made_image(SLOTS + 4), "parameters"),
        (bytes(2100), "vector table"),
        (made_image(2100)[:0x148], "not a plumb image"),
    ],
    ids=["no header", "other family", "cut", "other length", "changed", "too long", "zeros", "header cut"],
)
def test_a_wrong_image_is_refused_before_the_port_is_touched(
    image: bytes, words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "image.bin"
    path.write_bytes(image)
    assert main(["flash", "--port", "/dev/no-such-port", "--image", str(path)]) == 2
    assert words in sentence(capsys)


def test_the_longest_image_ends_where_the_parameters_begin() -> None:
    assert own_header(made_image(SLOTS), "it").size == SLOTS
    with pytest.raises(UsageError, match="parameters"):
        own_header(made_image(SLOTS + 4), "it")


def test_a_missing_stm32loader_says_what_to_install(
    small: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "stm32loader", None)
    assert main(["flash", "--port", "/dev/no-such-port", "--image", str(small)]) == 2
    assert "pip install -e '.[flash]'" in sentence(capsys)


def test_wrong_baud_and_missing_port(small: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["flash", "--port", "/dev/no-such-port", "--image", str(small), "--baud", "921600"]) == 2
    assert "1200 to 115200" in sentence(capsys)
    assert main(["flash", "--port", "/dev/no-such-port", "--image", str(small)]) == 3
    assert "there is no port /dev/no-such-port" in sentence(capsys)


@needs_image
@pytest.mark.skipif(shutil.which("stm32flash") is None, reason="stm32flash is not installed")
def test_the_simulated_bootloader_satisfies_stm32flash(tmp_path: Path) -> None:
    """A second, independent tool: the simulation is not merely what plumb expects."""
    image = BUILD.read_bytes()
    with Bootloader() as chip:
        arguments = ["stm32flash", "-m", "8n1", "-b", "115200", "-w", str(BUILD), "-v", "-g", "0x08000000", chip.port]
        answer = subprocess.run(arguments, capture_output=True, text=True, check=False, timeout=240)
    assert answer.returncode == 0, answer.stdout + answer.stderr
    assert bytes(chip.flash[: len(image)]) == image
    assert chip.started_at == FLASH


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("arm-none-eabi-gcc") is None, reason="arm-none-eabi-gcc is not installed")
@pytest.mark.skipif(not (ROOT / ".venv/bin/plumb").exists(), reason="plumb is not installed in .venv: run make test")
def test_the_target_flash_builds_and_writes(tmp_path: Path) -> None:
    """From the sources to the chip in one command, which fails when the chip does not hold what was built."""
    toolchain = ROOT / "firmware/ports/stm32f103/toolchain.cmake"
    configure = ["cmake", "-S", str(ROOT), "-B", str(tmp_path), "-G", "Ninja", f"-DCMAKE_TOOLCHAIN_FILE={toolchain}"]
    flash_it, one_system = ["cmake", "--build", str(tmp_path), "--target", "flash"], declarations.names()[0]
    for faults in (Faults(), Faults(stores_nothing=True)):
        with Bootloader(faults) as chip:
            more = ["-DCMAKE_BUILD_TYPE=Image", f"-DPLUMB_SYSTEMS={one_system}", f"-DPLUMB_PORT={chip.port}"]
            subprocess.run([*configure, *more], check=True, capture_output=True, timeout=240)
            done = subprocess.run(flash_it, capture_output=True, text=True, check=False, timeout=240)
        assert (done.returncode != 0) == faults.stores_nothing, done.stdout + done.stderr
        if not faults.stores_nothing:
            image = (tmp_path / "firmware.bin").read_bytes()
            assert bytes(chip.flash[: len(image)]) == image and chip.started_at == FLASH
