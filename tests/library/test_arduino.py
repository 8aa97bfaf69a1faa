"""The library of the Arduino IDE: what it holds, that it compiles for the processors of its boards, and that its sketch
estimates what the integer model estimates."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from plumb.contract.parameters import quantise
from plumb.contract.run_fixed import Controller
from plumb.systems.attitude import scenarios
from support.c_library import ARCHIVE, ROOT, WARNINGS, run

STUBS = ROOT / "tests/library/arduino"
ARM = ("arm-none-eabi-gcc", "-mthumb")
COMPILERS = {
    "cortex-m0": (*ARM, "-mcpu=cortex-m0"),
    "cortex-m3": (*ARM, "-mcpu=cortex-m3"),
    "cortex-m4": (*ARM, "-mcpu=cortex-m4"),
    "cortex-m7": (*ARM, "-mcpu=cortex-m7", "-mfpu=fpv5-d16", "-mfloat-abi=hard"),
    "cortex-m33": (*ARM, "-mcpu=cortex-m33"),
    "rv32": ("clang", "--target=riscv32", "-march=rv32imc", "-mabi=ilp32", "-isystem", "/usr/include/newlib"),
}
MAIN = """
#include "Attitude.ino"
uint32_t now_us = 0;
Printer Serial;
Chip Wire;
int main() {
    setup();
    if (Wire.registers[0x1B] != 0x18 || Wire.registers[0x1C] != 0x18) {
        return 3; /* the ranges of the tuning */
    }
    for (unsigned steps = 0; Wire.next(); now_us += 5000) {
        loop();
        loop(); /* before its time: no step */
        if (body.words.step != ++steps) {
            return 4;
        }
        const plumb_attitude_words_t &w = body.words;
        std::printf("%d %d %d %d %d %d %d %u\\n", w.attitude.w, w.attitude.x, w.attitude.y,
                    w.attitude.z, w.up_q30[0], w.up_q30[1], w.up_q30[2], w.tilt_variance_rad2_q32);
    }
    return Serial.lines == body.words.step / 20 ? 0 : 5;
}
"""
SHOWN = [f"attitude_{name}_q30" for name in "wxyz"] + [f"up_q30_{axis}" for axis in range(3)]


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The library as `make dist-arduino` writes it."""
    folder = tmp_path_factory.mktemp("arduino")
    run(sys.executable, ROOT / "tools/arduino_library.py", folder)
    return folder / "plumb"


def sources(library: Path) -> list[Path]:
    return sorted((library / "src").rglob("*.c"))


def test_it_has_the_sources_of_the_library_that_cmake_installs(library: Path) -> None:
    of_cmake = run("ar", "t", ARCHIVE).split()
    names = [path.name for path in sources(library)]
    assert len(set(names)) == len(names)
    assert sorted(name.replace("_design.c", ".c") for name in names) == sorted(name[:-2] for name in of_cmake)


def test_its_zip_has_the_same_files_and_bytes_every_time(library: Path, tmp_path: Path) -> None:
    run(sys.executable, ROOT / "tools/arduino_library.py", tmp_path)
    (first,), (second,) = list(library.parent.glob("*.zip")), list(tmp_path.glob("*.zip"))
    assert first.read_bytes() == second.read_bytes()
    run(sys.executable, "-m", "zipfile", "-e", first, tmp_path / "unpacked")
    run("diff", "-r", tmp_path / "unpacked/plumb", library)


@pytest.mark.parametrize("processor", COMPILERS)
def test_it_compiles_without_a_warning_or_a_fused_product(processor: str, library: Path, tmp_path: Path) -> None:
    flags = ("-c", "-Os", "-std=gnu11", *WARNINGS, "-I", library / "src")
    run(*COMPILERS[processor], *flags, *sources(library), cwd=tmp_path)
    symbols = re.findall(r" [A-Z] (\w+)$", run("nm", "--defined-only", "-g", *tmp_path.glob("*.o")), re.MULTILINE)
    assert symbols and not [name for name in symbols if not name.lower().startswith("plumb_")]
    if processor == "cortex-m7":  # whose unit has fused products of doubles, which no design can bear
        designs = [tmp_path / path.with_suffix(".o").name for path in sources(library) if "design" in path.parts]
        assert "vfma" not in run("arm-none-eabi-objdump", "-d", *designs)


def counts() -> Sequence[Sequence[int]]:
    """8 s at rest and turned in the hand, with the noise of the chip, and a gap."""
    rng = np.random.default_rng(7)
    t = np.arange(1600) * 0.005
    roll = np.where(t > 2, 0.6 * np.sin(2.0 * (t - 2)), 0.0)
    rate_dps = np.degrees(np.gradient(roll, t))
    zero = np.zeros_like(t)
    gyro = np.stack([rate_dps, zero, zero]) * 16.4 + rng.normal(0, 1, (3, 1600)) + [[12], [-7], [3]]
    accel = np.stack([zero, np.sin(roll), np.cos(roll)]) * 2048 + rng.normal(0, 8, (3, 1600))
    raw = np.rint(np.concatenate([gyro, accel])).astype(int).T
    raw[700:712] = -32768
    return [list(map(int, row)) for row in raw]


def test_the_sketch_estimates_what_the_model_estimates(library: Path, tmp_path: Path) -> None:
    (tmp_path / "main.cpp").write_text(MAIN)
    sketch = ("-I", STUBS, "-I", library / "examples/Attitude", "-include", STUBS / "Arduino.h", tmp_path / "main.cpp")
    objects = tmp_path / "objects"
    objects.mkdir()
    run("gcc", "-c", "-O1", "-std=gnu11", "-I", library / "src", *sources(library), cwd=objects)
    warnings = [warning for warning in WARNINGS if warning != "-Wconversion"]
    program = tmp_path / "sketch"
    run("g++", "-std=gnu++17", *warnings, "-I", library / "src", *sketch, *objects.glob("*.o"), "-o", program)
    rows = counts()
    said = subprocess.run(
        [program], input="".join(" ".join(map(str, row)) + "\n" for row in rows), capture_output=True, text=True
    )
    assert said.returncode == 0, said.stderr
    model = Controller(quantise(scenarios.TUNINGS["mpu6050"]))
    wanted = []
    for row in rows:
        words = model.step(row, 0)
        wanted.append(" ".join(str(words[name]) for name in [*SHOWN, "tilt_variance_rad2_q32"]))
    assert said.stdout.splitlines() == wanted
