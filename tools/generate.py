"""Write all files that are generated from the declarations of the systems, the parameters and the DBC.

tools/generate.py                          firmware/generated/, firmware/include/ and messages.dbc, as committed
tools/generate.py --check                  list the stale files; exit code 1
tools/generate.py --out DIR [--systems A;B]    for a build: all C files, into DIR, for these systems or this image
tools/generate.py --out DIR --flash [...]      for that of a flash image: it holds only the parameters that they read

Committed is what C users need without Python, and what people read; the tables of link and board are made in the build.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT / "host"), str(ROOT / "tools")]

import gen_chips  # type: ignore[import-not-found]  # noqa: E402
import gen_messages  # type: ignore[import-not-found]  # noqa: E402
import gen_params  # type: ignore[import-not-found]  # noqa: E402
import gen_parts  # type: ignore[import-not-found]  # noqa: E402
import gen_pin_sets  # type: ignore[import-not-found]  # noqa: E402
import gen_reference  # type: ignore[import-not-found]  # noqa: E402
import gen_settings  # type: ignore[import-not-found]  # noqa: E402
import gen_systems  # type: ignore[import-not-found]  # noqa: E402
import wrap_prose  # type: ignore[import-not-found]  # noqa: E402
from plumb.errors import UsageError  # noqa: E402
from plumb.spec import declarations, images, imu_chips, tool_dbc  # noqa: E402

BUILT = {
    "chips.c", "messages.c", "messages.h", "outputs.h", "params.c", "params.h", "pin_modes.h", "pin_sets.h",
    "record_names.h", "record_places.c", "sensor_kinds.h", "used_parts.h",
}  # fmt: skip
"""Of firmware/generated: made in each build, and not committed."""


def c_files(built: tuple[str, ...] = (), flash: bool = False) -> dict[str, str]:
    """Path below firmware/ -> text of the C files. built: the systems of the image, all by default. flash: it holds
    only the parameters that they read."""
    first = min(declarations.system(name).number for name in built or declarations.names())
    groups = images.held_groups(built if flash and built else declarations.names())
    ways = images.of_systems(built).ways if flash and built else len(imu_chips.ways())
    files = {
        **gen_systems.generate(built, groups),
        **gen_params.generate(first, groups, ways),
        **gen_messages.generate(),
    }
    files["chips.c"] = gen_chips.chips_c(ways)
    files["ranges.h"] = gen_settings.ranges_h(declarations.systems().values())
    files["pin_sets.h"] = gen_pin_sets.pin_sets_h()
    files["pin_modes.h"] = gen_pin_sets.pin_modes_h(gen_parts.used_parts(built))
    return {name if "/" in name else f"generated/{name}": text for name, text in files.items()}


def committed() -> dict[Path, str]:
    """Path -> text of the committed files, which cover the systems of this package."""
    files = {
        ROOT / "firmware" / name: text
        for name, text in c_files().items()
        if name.removeprefix("generated/") not in BUILT
    }
    files |= {ROOT / "docs" / "reference" / name: text for name, text in gen_reference.generate().items()}
    files[ROOT / "docs" / "reference" / "sensor-chips.md"] = wrap_prose.wrapped(gen_chips.page())
    files[ROOT / "docs" / "reference" / "pins.md"] = gen_pin_sets.page()
    files |= gen_settings.settings_files(declarations.systems())
    return {**files, ROOT / "host" / "plumb" / "spec" / "messages.dbc": tool_dbc.text()}


def write(files: dict[Path, str]) -> None:
    """Write the files that differ, so that a build only compiles those."""
    for path, text in files.items():
        if not path.is_file() or path.read_text(encoding="utf-8") != text:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8")


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--check", action="store_true")
    parser.add_argument("--out", type=Path)
    parser.add_argument("--systems", default="", help="names, separated by ;, or the name of an image")
    parser.add_argument("--flash", action="store_true", help="of a flash image, which holds only what they read")
    arguments = parser.parse_args()
    try:
        if arguments.out:
            asked = [name for name in arguments.systems.split(";") if name]
            built = images.asked(asked).systems if asked or arguments.flash else declarations.names()
            write({arguments.out / name: text for name, text in c_files(built, arguments.flash).items()})
            return 0
        if any(not system.shipped for system in declarations.systems().values()):
            raise UsageError(f"{declarations.SEARCH_PATH} is set: what is committed is of the systems of this package")
        files = committed()
    except UsageError as error:
        print(f"generate.py: {error}", file=sys.stderr)
        return 2
    if not arguments.check:
        write(files)
        return 0
    stale = [path for path, text in files.items() if not path.is_file() or path.read_text(encoding="utf-8") != text]
    for path in stale:
        print(f"{path.relative_to(ROOT)} is stale: run tools/generate.py")
    return 1 if stale else 0


if __name__ == "__main__":
    sys.exit(main())
