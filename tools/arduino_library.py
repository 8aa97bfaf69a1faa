"""Write the C library as a library of the Arduino IDE, for boards of 32 bits: a folder, and its ZIP.

    tools/arduino_library.py FOLDER     FOLDER/plumb and FOLDER/plumb-VERSION.zip

It has the sources of the library that CMake installs, under the names that they include each other by.
"""

from __future__ import annotations

import argparse
import re
import shutil
import sys
import zipfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
FIRMWARE, SKETCHES = ROOT / "firmware", ROOT / "examples/arduino"
NOT_THE_LIBRARYS = {"commutation.c", "digest.c"}
"""Kernels of the flash image alone (firmware/library/library.cmake)."""
ARCHITECTURES = (
    "esp32,esp8266,imxrt,mbed,mbed_giga,mbed_nano,mbed_nicla,mbed_opta,mbed_portenta,mbed_rp2040,nrf52,renesas,"
    "renesas_portenta,renesas_uno,rp2040,sam,samd,silabs,stm32,STM32F1,teensy,zephyr"
)
"""Of 32 bits, by the names of their board packages."""
HEADER = """\
/* The library of plumb for the Arduino IDE. docs: plumb/plumb.h. */
#ifndef PLUMB_ARDUINO_H
#define PLUMB_ARDUINO_H

#include <limits.h>
#if INT_MAX < 2147483647
#error "plumb needs a board of 32 bits"
#endif

#include "plumb/plumb.h"

#endif
"""


def version() -> str:
    """Of the C library."""
    text = (FIRMWARE / "include/plumb/version.h").read_text(encoding="utf-8")
    return text.partition('PLUMB_VERSION       "')[2].partition('"')[0]


def properties() -> str:
    """library.properties."""
    entries = {
        "name": "plumb",
        "version": version(),
        "author": "The plumb developers",
        "maintainer": "The plumb developers",
        "sentence": "Attitude, tilt and control in integers, the same bits on every board of 32 bits.",
        "paragraph": "Roll, pitch and heading of anything that moves from a gyro and an accelerometer, with the "
        "standard deviation of the tilt; no floating point in a step, no allocation.",
        "category": "Sensors",
        "architectures": ARCHITECTURES,
        "includes": "plumb.h",
    }
    return "".join(f"{key}={value}\n" for key, value in entries.items())


def sources() -> list[Path]:
    """The C files of the library."""
    found = [path for folder in ("core", "systems", "design", "library") for path in (FIRMWARE / folder).rglob("*.c")]
    return sorted(path for path in found if path.name not in NOT_THE_LIBRARYS)


def included(path: Path) -> set[Path]:
    """Headers of this repository that a file includes."""
    names = re.findall(r'(?m)^#include "(.*)"', path.read_text(encoding="utf-8"))
    found = set()
    for name in names:
        places = [folder / name for folder in (path.parent, FIRMWARE, FIRMWARE / "include")]
        found.add(next(place.resolve() for place in places if place.exists()))
    return found


def unit(path: Path) -> list[Path]:
    """A step and its parts: one unit, as systems.cmake compiles them (firmware/systems/parts.h), so that what the parts
    call of each other is no name of the library. Empty for a part."""
    others = path.parent.glob("*.c") if path.parent == FIRMWARE / "systems" else []
    stems = [other.stem for other in others]
    if any(path.stem.startswith(f"{stem}_") for stem in stems):
        return []
    return [path, *sorted(path.parent / f"{stem}.c" for stem in stems if stem.startswith(f"{path.stem}_"))]


def text_of(path: Path) -> str:
    """The text of a file; that of a step with its parts behind it."""
    files = unit(path) if path.suffix == ".c" else [path]
    text = "\n".join(file.read_text(encoding="utf-8") for file in files)
    return f"#define PLUMB_ONE_UNIT\n{text}" if len(files) > 1 else text


def placed(path: Path) -> str:
    """Where a file lies in src. Builds that pack objects by their names alone need another name for a design than for
    the step of the same system."""
    name = path.relative_to(FIRMWARE).as_posix().removeprefix("include/")
    design = path.parent == FIRMWARE / "design/systems" and not path.stem.endswith("_tunings")
    return name.replace(".c", "_design.c") if design else name


def files() -> dict[str, str]:
    """Path in the library -> text."""
    headers, seen = set((FIRMWARE / "include/plumb").glob("*.h")), set[Path]()
    left = {*sources(), *headers}
    while left:
        seen |= left
        left = set().union(*(included(path) for path in left)) - seen
    texts = {"library.properties": properties(), "src/plumb.h": HEADER, "LICENSE": (ROOT / "LICENSE").read_text()}
    for path in seen:
        if text := text_of(path):
            texts[f"src/{placed(path)}"] = text
    for path in SKETCHES.rglob("*.ino"):
        texts[f"examples/{path.relative_to(SKETCHES).as_posix()}"] = path.read_text(encoding="utf-8")
    return dict(sorted(texts.items()))


def write(folder: Path) -> Path:
    """The library and its ZIP in a folder; returns the ZIP."""
    library = folder / "plumb"
    shutil.rmtree(library, ignore_errors=True)
    archive = folder / f"plumb-{version()}.zip"
    folder.mkdir(parents=True, exist_ok=True)
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as out:
        for name, text in files().items():
            path = library / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8")
            out.writestr(zipfile.ZipInfo(f"plumb/{name}"), text, zipfile.ZIP_DEFLATED)  # of no time: the same bytes
    return archive


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, metavar="FOLDER")
    print(write(parser.parse_args().folder))
    return 0


if __name__ == "__main__":
    sys.exit(main())
