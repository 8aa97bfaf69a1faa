"""Which lines and branches of the core a program has run: clang's source-based coverage of the library of the core."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from support.mutants import BUILT, FIRMWARE

RUN = """
import ctypes, sys
from pathlib import Path
sys.path.insert(0, sys.argv[2])
from plumb.boards.native import core as native_core
from plumb.proof import golden
for vector in golden.load(Path(sys.argv[1])):
    if vector.task is not None:
        native_core.run_task(vector.task)
    else:
        native_core.run_control(vector.params, vector.raw, vector.setpoint)
"""


@dataclass(frozen=True)
class Unreached:
    """A branch that always, or never, was taken. outcome: the one that is missing."""

    file: str
    line: int
    condition: str
    outcome: str


def lacking() -> str:
    """What is missing here, '' for nothing."""
    tools = [tool for tool in ("clang", "llvm-cov", "llvm-profdata") if shutil.which(tool) is None]
    if tools:
        return f"{' and '.join(tools)} missing"
    command = ["clang", "-fprofile-instr-generate", "-x", "c", "-", "-o", os.devnull]
    done = subprocess.run(command, input="int main(void) { return 0; }", capture_output=True, text=True, check=False)
    return "clang's profile runtime missing" if done.returncode else ""


def unreached(folder: Path, vectors: Path) -> list[Unreached]:
    """The branches of the core that the vectors leave out."""
    library, raw, merged = folder / "core.so", folder / "core.profraw", folder / "core.profdata"
    units = [*FIRMWARE.glob("core/*.c"), *FIRMWARE.glob("systems/*.c")]
    units += [FIRMWARE / "generated/systems.c"]
    units += [FIRMWARE / f"ports/batch/{name}.c" for name in ("batch", "blocks", "checks")]
    _run(
        "clang", "-std=c99", "-O0", "-fPIC", "-shared", "-w", "-fprofile-instr-generate", "-fcoverage-mapping",
        f"-I{FIRMWARE}", f"-I{FIRMWARE}/include", f"-I{BUILT}", "-o", library, *units,
    )  # fmt: skip
    environment = {**os.environ, "PLUMB_NATIVE_CORE": str(library), "LLVM_PROFILE_FILE": str(raw)}
    _run(sys.executable, "-c", RUN, vectors, Path(__file__).parents[1], environment=environment)
    _run("llvm-profdata", "merge", "-sparse", raw, "-o", merged)
    text = _run("llvm-cov", "export", library, f"-instr-profile={merged}")
    return sorted(_branches(json.loads(text)["data"][0]["files"]), key=lambda one: (one.file, one.line))


def _branches(files: list[dict[str, list[list[int]]]]) -> Iterator[Unreached]:
    for entry in files:
        path = Path(str(entry["filename"]))
        if not path.is_relative_to(FIRMWARE):  # what the build generates
            continue
        lines = path.read_text(encoding="utf-8").split("\n")
        counts: dict[tuple[int, int, int, int], list[int]] = {}
        for first, left, last, right, yes, no, *_ in entry["branches"]:
            count = counts.setdefault((first, left, last, right), [0, 0])
            count[0], count[1] = count[0] + yes, count[1] + no
        for (first, left, last, right), count in counts.items():
            end = right - 1 if first == last else None
            condition = lines[first - 1][left - 1 : end]
            for outcome, times in zip(("true", "false"), count, strict=True):
                if times == 0:
                    yield Unreached(path.relative_to(FIRMWARE).as_posix(), first, condition, outcome)


def _run(*command: object, environment: dict[str, str] | None = None) -> str:
    done = subprocess.run([str(word) for word in command], env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-2000:]
    return done.stdout
