"""`cmake --install` into a folder, and programs built against it: by CMake and by pkg-config, in C and in C++."""

from __future__ import annotations

import os
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import pytest

from plumb.contract.parameters import quantise
from plumb.contract.run_fixed import Controller
from plumb.kernels.fixed.trig import atan2
from plumb.systems.quad import scenarios
from support.c_library import EXAMPLES, HEADERS, ROOT, build, run

BARE = EXAMPLES / "cortex-m"
VERSION = (HEADERS / "version.h").read_text().split('"')[1]
"""Of the C library."""

CPP = """#include <plumb/plumb.h>
#include <cstdio>
int main() {
    plumb_params_t params;
    const plumb_design_t made = plumb_quad_design(&PLUMB_QUAD_TUNING_DEFAULT, &params);
    plumb_quad_t axis;
    plumb_quad_init(&axis, &params);
    const int16_t raw[PLUMB_RAW_MAX] = {1676, 2388, 2981};
    plumb_quad_step(&axis, &params, raw, 0);
    std::printf("%d %d %s\\n", made.error, plumb_angle_atan2(1, 1), PLUMB_VERSION);
    return axis.words.step == 1U ? 0 : 1;
}
"""


@pytest.fixture(scope="module")
def prefix(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The library of this machine, installed."""
    folder = tmp_path_factory.mktemp("installed")
    run("cmake", "--install", ROOT / "build" / "native", "--prefix", folder / "first")
    shutil.move(folder / "first", folder / "moved")  # an installed tree may be moved
    return folder / "moved"


def samples() -> list[list[int]]:
    """Those of examples/c/samples.h."""
    text = (EXAMPLES / "samples.h").read_text()
    rows = text[text.index("= {") :].split("{")[2:]
    return [[int(word) for word in row.split("}")[0].split(",")] for row in rows]


def expected() -> list[str]:
    """What the examples print, by the integers of Python."""
    asked = scenarios.TUNINGS[scenarios.DEFAULT_TUNING]
    tuning = replace(asked, period_us=20000, start=replace(asked.start, p00_deg2=100.0))
    controller = Controller(quantise(tuning))
    lines = []
    for number, raw in enumerate(samples(), 1):
        tilt_turn_q32 = controller.step(raw, 0)["tilt_turn_q32"]
        tilt_mdeg = abs(tilt_turn_q32) * 360000 >> 32
        sign = "-" if tilt_turn_q32 < 0 and tilt_mdeg else ""
        lines.append(f"step {number}  tilt {sign}{tilt_mdeg} mdeg")
    return lines


def test_the_example_finds_the_package_and_prints_what_python_works_out(prefix: Path, tmp_path: Path) -> None:
    build(EXAMPLES, tmp_path / "tilt", f"-DCMAKE_PREFIX_PATH={prefix}", "-DCMAKE_C_FLAGS=-Wall -Wextra -Werror")
    assert run(tmp_path / "tilt" / "tilt").splitlines() == expected()


def flags(prefix: Path) -> list[str]:
    environment = {**os.environ, "PKG_CONFIG_PATH": str(next(prefix.rglob("pkgconfig")))}
    ask = ["pkg-config", "--cflags", "--libs", "plumb"]
    said = subprocess.run(ask, env=environment, capture_output=True, text=True, check=True).stdout
    version = subprocess.run(["pkg-config", "--modversion", "plumb"], env=environment, capture_output=True, text=True)
    assert version.stdout.strip() == VERSION
    return said.split()


def test_the_example_builds_by_pkg_config(prefix: Path, tmp_path: Path) -> None:
    run("gcc", "-std=c99", EXAMPLES / "tilt.c", *flags(prefix), "-o", tmp_path / "tilt")
    assert run(tmp_path / "tilt").splitlines() == expected()


def test_a_file_of_cpp17_links_both_ways(prefix: Path, tmp_path: Path) -> None:
    (tmp_path / "user.cpp").write_text(CPP)
    run("g++", "-std=c++17", "-Wall", "-Wextra", "-Wconversion", "-Werror", tmp_path / "user.cpp", *flags(prefix),
        "-o", tmp_path / "by_pkg_config")  # fmt: skip
    (tmp_path / "CMakeLists.txt").write_text(
        f"cmake_minimum_required(VERSION 3.20)\nproject(user LANGUAGES CXX)\nset(CMAKE_CXX_STANDARD 17)\n"
        f"find_package(plumb {VERSION} REQUIRED)\nadd_executable(user user.cpp)\n"
        f"target_link_libraries(user plumb::plumb)\n"
    )
    build(tmp_path, tmp_path / "out", f"-DCMAKE_PREFIX_PATH={prefix}")
    for program in (tmp_path / "by_pkg_config", tmp_path / "out" / "user"):
        assert run(program) == f"0 {atan2(1, 1)} {VERSION}\n"


def test_the_library_is_a_subfolder_of_another_project(tmp_path: Path) -> None:
    shutil.copy(EXAMPLES / "tilt.c", tmp_path)
    shutil.copy(EXAMPLES / "samples.h", tmp_path)
    (tmp_path / "CMakeLists.txt").write_text(
        f"cmake_minimum_required(VERSION 3.20)\nproject(user LANGUAGES C)\nset(PLUMB_LIBRARY_ONLY ON)\n"
        f"add_subdirectory({ROOT} plumb)\nadd_executable(tilt tilt.c)\ntarget_link_libraries(tilt plumb::plumb)\n"
    )
    build(tmp_path, tmp_path / "out")
    assert run(tmp_path / "out" / "tilt").splitlines() == expected()


def test_a_bare_cortex_m_prints_the_same(tmp_path: Path) -> None:
    toolchain = f"-DCMAKE_TOOLCHAIN_FILE={BARE / 'toolchain.cmake'}"
    build(ROOT, tmp_path / "library", toolchain, "-DPLUMB_LIBRARY_ONLY=ON", "-DCMAKE_BUILD_TYPE=Release")
    run("cmake", "--install", tmp_path / "library", "--prefix", tmp_path / "prefix")
    said = build(BARE, tmp_path / "tilt", toolchain, f"-DCMAKE_PREFIX_PATH={tmp_path / 'prefix'}")
    assert "text\t   data\t    bss" in said
    machine = ("qemu-system-arm", "-M", "mps2-an385", "-display", "none", "-monitor", "none", "-serial", "none")
    output = ("-chardev", "stdio,id=out", "-semihosting-config", "enable=on,chardev=out")
    assert run(*machine, *output, "-kernel", tmp_path / "tilt" / "tilt.elf").splitlines() == expected()
