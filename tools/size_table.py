#!/usr/bin/env python3
"""Table of flash, RAM and stack of the image by module and function, with its budget, and the difference to a commit.

    tools/size_table.py build/stm32f103/firmware.elf                       the modules, and firmware.size.json in its
    folder tools/size_table.py build/stm32f103/firmware.elf --functions           every function too
    tools/size_table.py build/stm32f103/firmware.elf --against HEAD~1      what differs from that commit

Addresses come from the linker map (firmware.map in the folder of the ELF file) and, for code optimised at link time,
from the debug information; the stack comes from the call graph of the machine code. The other commit is checked out of
git and built with the same compiler, so that no table that could be stale is kept in the tree.
`--against previous` is the last commit where this one is as committed, else HEAD.

Exit code 0: done. 1: a limit is exceeded. 2: it cannot be read, or the other commit cannot be built.
"""

from __future__ import annotations

import argparse
import io
import json
import re
import subprocess
import sys
import zipfile
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "host"))

from plumb.bench.dwarf import written_in  # noqa: E402
from plumb.errors import PlumbError, UsageError  # noqa: E402
from plumb.flash.call_graph import CallGraph  # noqa: E402
from plumb.flash.elf import Elf  # noqa: E402

RAM_START = 0x20000000
FIRMWARE = ("firmware", "CMakeLists.txt", "CMakePresets.json", "tools", "host/plumb")
"""Paths that an image depends on."""
_PIECE = re.compile(r"^ (\.[\w.$]+|COMMON)\s+0x([0-9a-f]+)\s+0x([0-9a-f]+) (\S+)$", re.MULTILINE)
_SUFFIX = re.compile(r"\.(isra|constprop|part|cold|lto_priv|\d+)(\.\d+)?$")
_LINK_TIME = re.compile(r"\.ltrans\d*\.(ltrans\.)?o$")
"""Object files that the linker's plugin compiled from several source files."""
_NO_FILE = "(link and port)"
"""Module of code that link-time optimisation merged from several files, and of the compiler's tables."""

Sizes = dict[str, Any]
"""totals, limits, and modules: name -> flash, ram, and items: name -> flash, ram, stack, deepest. Totals and limits are
the flash of the image; .data, .bss and the stack that is reserved; the worst-case stack in that reserve."""


def module_of(place: str) -> str:
    """'stm32f103/adc.c' of where the linker took a piece from."""
    own = re.search(r"firmware\.dir/firmware/(.+)\.obj$", place)
    if own:
        return own[1]
    library = re.search(r"libplumb_(\w+)\.a\((.+)\.obj\)$", place)
    if library:
        return f"{library[1]}/{library[2]}"
    return "compiler's library"


def item_of(section: str, place: str) -> str:
    """The function or variable a section was made for; its file where the section has no name of its own."""
    name = re.sub(r"^\.(text|rodata|data|bss)\.?|^COMMON", "", section).removeprefix("startup.")
    inside = re.search(r"\(([^)]+)\)$", place)
    return _SUFFIX.sub("", name) or (inside[1] if inside else section)


def files_of(elf: Path) -> dict[int, str]:
    """Module of each address at which a function or variable of link-time optimisation begins: the debug information
    leads from there to the file that it was written in."""
    return {at: name.removeprefix("./").removeprefix("firmware/") for at, name in written_in(elf).items()}


def parts_of(section: str, place: str, address: int, size: int, elf: Elf) -> list[tuple[str, int]]:
    """Names and sizes of what a piece holds: the variables of a file lie in one, with padding between them."""
    objects = [symbol for symbol in elf.symbols_between(address, address + size) if not symbol.is_function]
    if address < RAM_START or not objects:
        return [(item_of(section, place), size)]
    rest = size - sum(symbol.size for symbol in objects)
    return [(_SUFFIX.sub("", symbol.name), symbol.size) for symbol in objects] + [("(padding)", rest)] * bool(rest)


def sizes_of(elf: Path) -> Sizes:
    """Raises UsageError for an image without its map, or one that cannot be examined."""
    graph = CallGraph(elf)
    try:
        text = elf.with_suffix(".map").read_text(encoding="utf-8")
    except OSError:
        raise UsageError(f"there is no {elf.with_suffix('.map')}; build the image with: make image") from None
    _, found, placed = text.partition("Linker script and memory map")
    if not found:
        raise UsageError(f"{elf.with_suffix('.map')} is no map of a linked image")
    placed = re.sub(r"^ (\S+)\n\s+0x", r" \1 0x", placed, flags=re.MULTILINE)
    stacks = {function.name: function for function in graph.functions.values()}
    modules: dict[str, Any] = {}
    files = files_of(elf)
    for section, address_hex, size_hex, place in _PIECE.findall(placed):
        address, size = int(address_hex, 16), int(size_hex, 16)
        if not address or not size or section.startswith((".debug", ".ARM.attr", ".comment")):
            continue
        in_ram, in_flash = address >= RAM_START, address < RAM_START or section.startswith(".data")
        if _LINK_TIME.search(place):
            placed_here = graph.elf.symbols_between(address, address + size)
            symbols = list({each.address: each for each in reversed(placed_here)}.values())  # equal functions are one
            held = [(files.get(each.address, _NO_FILE), _SUFFIX.sub("", each.name), each.size) for each in symbols]
            held.append((_NO_FILE, "(padding)", size - sum(each.size for each in symbols)))
        else:
            held = [(module_of(place), *part) for part in parts_of(section, place, address, size, graph.elf)]
        for name_of_module, name, part in held:
            module = modules.setdefault(name_of_module, {"flash": 0, "ram": 0, "items": {}})
            module["ram"] += part * in_ram
            module["flash"] += part * in_flash
            item = module["items"].setdefault(name, {"flash": 0, "ram": 0})
            item["ram"] += part * in_ram
            item["flash"] += part * in_flash
            if name in stacks and section.startswith(".text"):
                item["stack"], item["deepest"] = stacks[name].depth_bytes, graph.stack_bytes(stacks[name].address)
    reserved = sum(section.size for section in graph.elf.sections if "stack" in section.name)
    totals = {"flash": graph.elf.flash_bytes, "ram": graph.elf.ram_bytes + reserved, "stack": graph.worst_stack_bytes()}
    return {"totals": totals, "limits": graph.elf.limits, "modules": modules}


def module_table(sizes: Sizes, functions: bool) -> list[str]:
    """A line a module, and where asked one a function, by folder; the totals with their limits."""
    lines = [f"{'module':<34} {'flash':>6} {'ram':>6} {'stack':>6}"]
    for name in sorted(sizes["modules"]):
        module = sizes["modules"][name]
        deepest = max((item.get("deepest", 0) for item in module["items"].values()), default=0)
        lines.append(f"{name:<34} {module['flash']:>6} {module['ram']:>6} {deepest or '':>6}")
        if functions:
            for item, of in sorted(module["items"].items(), key=lambda pair: -pair[1]["flash"] - pair[1]["ram"]):
                lines.append(f"    {item:<30} {of['flash'] or '':>6} {of['ram'] or '':>6} {of.get('deepest', ''):>6}")
    totals = sizes["totals"]
    rest = totals["flash"] - sum(module["flash"] for module in sizes["modules"].values())
    reserved = totals["ram"] - sum(module["ram"] for module in sizes["modules"].values())
    lines.append(f"{'(alignment; stack and its guard)':<34} {rest:>6} {reserved:>6}")
    for label, of in (("image", totals), ("limit", sizes["limits"])):
        lines.append(f"{label:<34} {of['flash']:>6} {of['ram']:>6} {of['stack']:>6}")
    return lines


def differences(old: Sizes, new: Sizes) -> list[str]:
    """Lines for modules and items that became larger or smaller, largest change first."""
    changed: list[tuple[int, str]] = []
    for name in old["modules"].keys() | new["modules"].keys():
        empty: Sizes = {"flash": 0, "ram": 0, "items": {}}
        before, after = old["modules"].get(name, empty), new["modules"].get(name, empty)
        for item in before["items"].keys() | after["items"].keys():
            was = before["items"].get(item, {"flash": 0, "ram": 0})
            is_ = after["items"].get(item, {"flash": 0, "ram": 0})
            parts = [f"{kind} {is_[kind] - was[kind]:+d}" for kind in ("flash", "ram") if is_[kind] != was[kind]]
            if is_.get("deepest") != was.get("deepest") and "deepest" in is_ and "deepest" in was:
                parts.append(f"stack {is_['deepest'] - was['deepest']:+d}")
            if parts:
                weight = abs(is_["flash"] - was["flash"]) + abs(is_["ram"] - was["ram"])
                changed.append((weight, f"  {name:<26} {item:<30} {', '.join(parts)}"))
    lines = [line for _, line in sorted(changed, key=lambda entry: (-entry[0], entry[1]))]
    was, now = old["totals"], new["totals"]
    totals = [f"{kind} {now[kind]} ({now[kind] - was[kind]:+d})" for kind in now]
    return [*lines, ", ".join(totals)]


def git(*arguments: str) -> bytes:
    done = subprocess.run(["git", "-C", str(ROOT), *arguments], capture_output=True, check=False)
    if done.returncode:
        raise UsageError(f"git {arguments[0]} failed: {done.stderr.decode().strip().splitlines()[-1]}")
    return done.stdout


def previous() -> str | None:
    """The commit to compare with; None if there is none (a shallow clone, the first commit, no git)."""
    try:
        revision = "HEAD" if git("status", "--porcelain", "--", *FIRMWARE).strip() else "HEAD~1"
        git("rev-parse", "--verify", f"{revision}^{{commit}}")
    except UsageError:
        return None
    return revision


def image_of(revision: str) -> tuple[str, Path]:
    """Short name and ELF file of a commit, built in a folder of its own and kept for the next time."""
    commit = git("rev-parse", "--short", f"{revision}^{{commit}}").decode().strip()
    folder = ROOT / "build" / "size" / commit
    elf = folder / "image" / "firmware.elf"
    if not elf.exists():
        held = [name for name in FIRMWARE if git("ls-tree", "--name-only", commit, "--", name).strip()]
        with zipfile.ZipFile(io.BytesIO(git("archive", "--format=zip", commit, *held))) as archive:
            archive.extractall(folder / "source")
        toolchain = next(
            (folder / "source").rglob("toolchain.cmake"), Path("toolchain.cmake")
        )  # wherever that commit has it
        configure = ["cmake", "-S", str(folder / "source"), "-B", str(folder / "image"), "-G", "Ninja",
                     f"-DCMAKE_TOOLCHAIN_FILE={toolchain}", "-DCMAKE_BUILD_TYPE=Image",
                     f"-DPython3_EXECUTABLE={sys.executable}"]  # fmt: skip
        for command in (configure, ["cmake", "--build", str(folder / "image"), "--target", "firmware"]):
            done = subprocess.run(command, capture_output=True, text=True, check=False)
            if done.returncode:
                elf.unlink(missing_ok=True)
                last = (done.stdout + done.stderr).strip().splitlines()[-1:]
                raise UsageError(f"{commit} does not build here: {''.join(last)}")
    return commit, elf


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("image", type=Path, help="firmware.elf, with firmware.map in its folder")
    parser.add_argument("--functions", action="store_true", help="a line for every function and variable too")
    parser.add_argument("--against", metavar="REV", help="compare with this commit; `previous`: the one before")
    options = parser.parse_args()
    try:
        sizes = sizes_of(options.image)
        revision = previous() if options.against == "previous" else options.against
        if options.against and revision is None:
            print("there is no commit before this one to compare sizes with")
        elif revision is not None:
            try:
                commit, elf = image_of(revision)
            except PlumbError as error:
                if options.against != "previous":
                    raise
                print(f"nothing to compare sizes with: {error}")  # what was wrong with that commit is not this one's
            else:
                print(f"since {commit}:")
                print("\n".join(differences(sizes_of(elf), sizes)))
        else:
            print("\n".join(module_table(sizes, options.functions)))
            options.image.with_suffix(".size.json").write_text(json.dumps(sizes, indent=1, sort_keys=True) + "\n")
    except PlumbError as error:
        print(f"size_table: {error}", file=sys.stderr)
        return error.exit_code
    totals, limits = sizes["totals"], sizes["limits"]
    over = [kind for kind in limits if totals[kind] > limits[kind]]
    for kind in over:
        print(f"size_table: {kind} {totals[kind]} is over its limit of {limits[kind]}", file=sys.stderr)
    return 1 if over else 0


if __name__ == "__main__":
    sys.exit(main())
