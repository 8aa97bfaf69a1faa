"""The public headers in every language and with every compiler they are for, and the names that they bring along."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest

from plumb.version import FALLBACK
from support.c_library import ARCHIVE, HEADERS, WARNINGS, run

NAMES = sorted(path.name for path in HEADERS.glob("*.h"))
STANDARDS = {"c": ("gnu99", "gnu11", "gnu17", "c99"), "c++": ("c++17",)}
PREFIX = re.compile(r"^_?(plumb|PLUMB)_|^PLUMB_")
LIBC = "#include <stdlib.h>\n#include <sys/types.h>\n"
NEWLIB = (
    "--target=thumbv7m-none-eabi", "-isystem", "/usr/lib/arm-none-eabi/include", "-isystem", "/usr/include/newlib"
)  # fmt: skip
COMPILERS = {
    "gcc": ("gcc", "g++"),
    "clang": ("clang", "clang++"),
    "arm-none-eabi-gcc": ("arm-none-eabi-gcc", "arm-none-eabi-g++"),
    "clang with newlib": ("clang", "clang++"),
}


def source(folder: Path, text: str, suffix: str) -> Path:
    path = folder / f"user{suffix}"
    path.write_text(text)
    return path


@pytest.mark.parametrize("name", COMPILERS)
@pytest.mark.parametrize("language", STANDARDS)
def test_all_headers_compile_behind_those_of_the_c_library(name: str, language: str, tmp_path: Path) -> None:
    everything = LIBC + "".join(f'#include "plumb/{header}"\n' for header in ["plumb.h", *NAMES])
    user = source(tmp_path, everything, ".c" if language == "c" else ".cpp")
    extra = NEWLIB if name == "clang with newlib" else ()
    for standard in STANDARDS[language]:
        compiler = COMPILERS[name][language == "c++"]
        flags = ("-fsyntax-only", f"-std={standard}", "-pedantic", *WARNINGS, *extra)
        run(compiler, *flags, f"-I{HEADERS.parent}", user)


@pytest.mark.parametrize("header", NAMES)
def test_each_header_stands_alone(header: str, tmp_path: Path) -> None:
    user = source(tmp_path, 2 * f'#include "plumb/{header}"\n' + "extern int used;\n", ".c")
    run("gcc", "-fsyntax-only", "-std=c99", "-pedantic", *WARNINGS, f"-I{HEADERS.parent}", user)


def test_public_headers_include_public_headers_alone() -> None:
    for path in HEADERS.glob("*.h"):
        includes = re.findall(r'#include ["<](.*)[">]', path.read_text())
        assert all(name.startswith("plumb/") or name in ("stdbool.h", "stddef.h", "stdint.h") for name in includes), (
            path
        )


def declared(tree: dict[str, Any]) -> set[str]:
    """The names at file scope: types, functions, variables, tags and enumerators."""
    names = set()
    for node in tree["inner"]:
        names.add(node.get("name", ""))
        if node["kind"] == "EnumDecl":
            names |= {constant["name"] for constant in node["inner"]}
    return names - {""}


def test_every_name_in_a_users_file_has_the_prefix(tmp_path: Path) -> None:
    standard = "#include <stdbool.h>\n#include <stddef.h>\n#include <stdint.h>\n"
    names, macros = [], []
    for text in (standard, standard + '#include "plumb/plumb.h"\n'):
        user = source(tmp_path, text, ".c")
        tree = run("clang", "-std=c99", "-fsyntax-only", "-Xclang", "-ast-dump=json", f"-I{HEADERS.parent}", user)
        names.append(declared(json.loads(tree)))
        dump = run("gcc", "-std=c99", "-E", "-dM", f"-I{HEADERS.parent}", user)
        macros.append(set(re.findall(r"^#define (\w+)", dump, re.MULTILINE)))
    added = (names[1] - names[0]) | (macros[1] - macros[0])
    assert {"plumb_quad_t", "plumb_quad_step", "PLUMB_RAW_MAX", "PLUMB_DESIGN_OK"} <= added
    assert {name for name in added if not PREFIX.match(name)} == set()


def test_every_symbol_of_the_archive_has_the_prefix_and_none_is_missing() -> None:
    defined: set[str] = set()
    wanted: set[str] = set()
    for line in run("nm", "-g", ARCHIVE).splitlines():
        if match := re.match(r"^[0-9a-f]*\s+([A-Za-z]) (\w+)$", line):
            (wanted if match[1] == "U" else defined).add(match[2])
    assert {"plumb_quad_step", "plumb_kalman_step", "plumb_angle_atan2", "plumb_quad_design"} <= defined
    assert {name for name in defined if not PREFIX.match(name)} == set()
    assert wanted - defined <= {"memcpy", "memmove", "memset", "_GLOBAL_OFFSET_TABLE_", "__stack_chk_fail"}


def test_every_declared_function_is_in_the_archive(tmp_path: Path) -> None:
    user = source(tmp_path, '#include "plumb/plumb.h"\n#include "plumb/prefilter.h"\n', ".c")
    tree = json.loads(run("clang", "-fsyntax-only", "-Xclang", "-ast-dump=json", f"-I{HEADERS.parent}", user))
    functions = {node["name"] for node in tree["inner"] if node["kind"] == "FunctionDecl"}
    defined = set(re.findall(r" T (\w+)$", run("nm", "-g", ARCHIVE), re.MULTILINE))
    assert {name for name in functions if name.startswith("plumb_")} - defined == set()


def test_version_is_that_of_the_package() -> None:
    header = (HEADERS / "version.h").read_text()
    assert f'"{FALLBACK}"' in header
    parts = re.findall(r"PLUMB_VERSION_(?:MAJOR|MINOR|PATCH) (\d+)", header)
    assert ".".join(parts) == FALLBACK
