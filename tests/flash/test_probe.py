"""`plumb flash --probe`: what OpenOCD and pyOCD are asked, by programs that stand in for them and write it down.

Neither a probe nor a chip takes part; the real pyOCD, where it is installed, at least understands the commands.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from plumb.__main__ import main
from support.made_image import made_image

FAKE = """\
#!{python}
import json, os, re, sys
folder = os.environ["PLUMB_FAKE"]
state = json.load(open(folder + "/state.json"))
said = " ".join(sys.argv[1:])
with open(folder + "/asked", "a") as asked:
    asked.write(json.dumps(sys.argv[1:]) + "\\n")
if state["fails"]:
    print("Error: open failed")
    sys.exit(1)
if "UNEXPECTED" not in state["idcode"]:
    print(state["idcode"])
elif "set CPUTAPID 0" not in said:
    print(state["idcode"])
    print("Error: expected 1 of 1: 0x1ba01477")
    sys.exit(1)
if "e0042000" in said.lower():
    print(state["device"])
    print(state["size"])
flash = folder + "/flash.bin"
if write := re.search(r"write_image erase {{(.*?)}}", said) or re.search(r"^load .* (\\S+)$", said):
    data = open(write[1], "rb").read()
    open(flash, "wb").write(data[:-4] + bytes(4) if state["spoils"] else data)
if read := re.search(r"dump_image {{(?P<file>.*?)}} \\S+ (?P<count>\\d+)", said):
    pass
else:
    read = re.search(r"savemem \\S+ (?P<count>\\d+) (?P<file>\\S+)", said)
if read:
    open(read["file"], "wb").write(open(flash, "rb").read()[: int(read["count"])])
"""
OPENOCD = {
    "idcode": "Info : SWD DPIDR 0x1ba01477",
    "device": "0xe0042000: 20036410",
    "size": "0x1ffff7e0: 0040",
    "fails": False,
    "spoils": False,
}
PYOCD = {
    "idcode": "0000123 I DP IDR = 0x1ba01477 (v1 rev1) [dap]",
    "device": "e0042000:  10036414    |...d|",
    "size": "1ffff7e0:  0200    |..|",
    "fails": False,
    "spoils": False,
}


class Fake:
    def __init__(self, folder: Path, tool: str, **changes: object) -> None:
        self.folder, self.tool = folder, tool
        program = folder / tool
        program.write_text(FAKE.format(python=sys.executable))
        program.chmod(0o755)
        state = {**(OPENOCD if tool == "openocd" else PYOCD), **changes}
        (folder / "state.json").write_text(json.dumps(state))
        self.image = folder / "image.bin"
        self.image.write_bytes(made_image(2100))

    def flash(self, *more: str) -> int:
        return main(["flash", "--probe", self.tool, "--image", str(self.image), *more])

    @property
    def asked(self) -> list[list[str]]:
        return [json.loads(line) for line in (self.folder / "asked").read_text().splitlines()]


NewFake = Callable[..., Fake]


@pytest.fixture
def fake(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> NewFake:
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setenv("PLUMB_FAKE", str(tmp_path))
    return lambda tool, **changes: Fake(tmp_path, tool, **changes)


def test_openocd_is_asked_to_identify_write_read_back_and_run(
    fake: NewFake, capsys: pytest.CaptureFixture[str]
) -> None:
    f = fake("openocd")
    assert f.flash("--json") == 0
    report = json.loads(capsys.readouterr().out)
    assert report["verdict"] == "pass" and report["clone"] is False and report["pages_erased"] == 3
    assert report["part"]["flash_kib"] == 64 and report["part"]["page_bytes"] == 1024
    assert (f.folder / "flash.bin").read_bytes() == f.image.read_bytes()
    begin = ["-f", "interface/stlink.cfg", "-f", "target/stm32f1x.cfg"]
    commands = []
    for asked in f.asked:
        assert asked[:4] == begin and set(asked[4::2]) == {"-c"}
        first, second, *middle, last = asked[5::2]
        assert (first, second, last) == ("init", "reset halt", "shutdown")
        commands.append(middle)
    assert commands[0] == ["mdw 0xe0042000", "mdh 0x1ffff7e0"]
    assert commands[1][0].startswith("flash write_image erase {") and commands[1][0].endswith("} 0x08000000 bin")
    assert commands[2][0].startswith("dump_image {") and commands[2][0].endswith("} 0x08000000 2100")
    assert commands[3] == ["reset run"]
    assert not any("mass" in word or "chip" in word for asked in f.asked for word in asked)


def test_another_interface(fake: NewFake) -> None:
    f = fake("openocd")
    assert main(["flash", "--probe", "openocd:cmsis-dap", "--image", str(f.image)]) == 0
    assert all(asked[1] == "interface/cmsis-dap.cfg" for asked in f.asked)


def test_pyocd_is_asked_the_same(fake: NewFake, capsys: pytest.CaptureFixture[str]) -> None:
    f = fake("pyocd")
    assert f.flash("--json") == 0
    report = json.loads(capsys.readouterr().out)
    assert report["part"] | {"bootloader": 0} == report["part"] and report["part"]["flash_kib"] == 512
    assert report["pages_erased"] == 2
    identify, write, read, start = f.asked
    assert identify[:2] == ["commander", "-W"] and identify[identify.index("-t") + 1] == "cortex_m"
    assert write[0] == "load" and write[write.index("-e") + 1] == "sector" and "--no-reset" in write
    assert write[write.index("-t") + 1] == "stm32f103rc" and write[write.index("-a") + 1] == "0x08000000"
    assert "savemem 0x08000000 2100" in " ".join(read)
    assert start[0] == "reset"


@pytest.mark.parametrize(
    ("tool", "idcode"),
    [
        ("openocd", "Warn : UNEXPECTED idcode: 0x2ba01477"),  # an ST-Link, after which OpenOCD stops
        ("openocd", "Info : SWD DPIDR 0x2ba01477"),  # any other probe
        ("pyocd", "I DP IDR = 0x2ba01477 (v1)"),
    ],
)
def test_a_clone_is_warned_of_and_written(
    fake: NewFake, tool: str, idcode: str, capsys: pytest.CaptureFixture[str]
) -> None:
    f = fake(tool, idcode=idcode)
    assert f.flash("--json") == 0
    output = capsys.readouterr()
    assert "the chip is a clone" in output.err and json.loads(output.out)["clone"] is True
    assert (f.folder / "flash.bin").exists()


def test_what_reads_back_wrong_is_exit_1_and_not_started(fake: NewFake, capsys: pytest.CaptureFixture[str]) -> None:
    f = fake("openocd", spoils=True)
    assert f.flash() == 1
    assert "4 of 2100 bytes read back wrong" in capsys.readouterr().err
    assert not any("reset run" in asked for asked in f.asked)


@pytest.mark.parametrize(
    ("changes", "code", "words"),
    [
        ({"device": "0xe0042000: 10006413"}, 2, "no STM32F103"),
        ({"size": "0x1ffff7e0: 0001", "device": "nothing"}, 3, "shows no chip"),
        ({"fails": True}, 3, "openocd failed (Error: open failed)"),
    ],
)
def test_another_part_and_no_part_are_left_alone(
    fake: NewFake, changes: dict[str, object], code: int, words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    f = fake("openocd", **changes)
    assert f.flash() == code
    assert words in capsys.readouterr().err
    assert not (f.folder / "flash.bin").exists()


def test_an_image_too_long_for_the_chip(fake: NewFake, capsys: pytest.CaptureFixture[str]) -> None:
    f = fake("openocd", size="0x1ffff7e0: 0010")
    f.image.write_bytes(made_image(16 * 1024 + 4))
    assert f.flash() == 2
    assert "nothing was written" in capsys.readouterr().err and not (f.folder / "flash.bin").exists()


def test_a_missing_tool_and_a_wrong_name(fake: NewFake, capsys: pytest.CaptureFixture[str]) -> None:
    f = fake("pyocd")
    assert main(["flash", "--probe", "openocd", "--image", str(f.image)]) == 2
    assert "openocd is not installed" in capsys.readouterr().err
    assert main(["flash", "--probe", "jtagice", "--image", str(f.image)]) == 2
    assert "openocd, openocd:cmsis-dap or pyocd" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("pyocd", path=str(Path(sys.executable).parent)) is None, reason="no pyocd")
def test_the_real_pyocd_understands_the_commands(fake: NewFake) -> None:
    """It finds no probe, and says that rather than that it was asked wrongly."""
    f = fake("pyocd")
    assert f.flash() == 0
    program = str(Path(sys.executable).parent / "pyocd")
    for asked in f.asked:
        done = subprocess.run([program, *asked], capture_output=True, text=True, timeout=240, check=False)
        assert done.returncode in (1, 3) and "usage:" not in done.stderr
        assert "No connected debug probes" in done.stdout + done.stderr


@pytest.mark.skipif(shutil.which("openocd", path="/usr/bin") is None, reason="openocd is not installed")
@pytest.mark.parametrize("interface", ["stlink", "cmsis-dap"])
def test_the_real_openocd_finds_its_files_and_no_probe(fake: NewFake, interface: str) -> None:
    f = fake("openocd", idcode="Warn : UNEXPECTED idcode: 0x2ba01477")
    assert main(["flash", "--probe", f"openocd:{interface}", "--image", str(f.image)]) == 0
    for asked in f.asked:
        done = subprocess.run(["/usr/bin/openocd", *asked], capture_output=True, text=True, timeout=240, check=False)
        assert done.returncode == 1
        wrongly_asked = (
            "invalid command",
            "wrong # args",
            "Can't find",
            "invalid subcommand",
            "Unexpected command line",
        )
        assert not any(words in done.stderr for words in wrongly_asked), done.stderr
