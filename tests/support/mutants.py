"""Mutants of the core's C: one small change each, as a person could make it, built as the library that Python loads.

    an operator for its neighbour      + -   << >>   & |   && ||   < <=   > >=   == !=
    a number, or a named constant      one more, one less
    a function for its neighbour       min max, mulhi_near mulhi_i32
    a statement that assigns or adds   left out

`mutants` finds the places in the code that a step runs; `Workshop` builds the library, with a change or without.
"""

from __future__ import annotations

import re
import subprocess
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

FIRMWARE = Path(__file__).resolve().parents[2] / "firmware"
BUILT = FIRMWARE.parent / "build" / "native" / "systems"
"""What the build generates."""
APART = {
    "commutation.c", "commutation.h", "digest.c", "digest.h", "esc.c", "esc.h", "plausibility.c", "watch.h",
    "control.h",
}  # fmt: skip
"""Not run by a step: the port's motor, the digest that judges it, what runs behind it and before it, declarations."""
NOT_OF_A_STEP = re.compile(r"(_valid|_retune|^in_range|^minor_q28|^direct_part)$")
"""Functions that are called when parameters change."""
_SWAPS = {
    "+": "-", "-": "+", "<<": ">>", ">>": "<<", "&": "|", "|": "&", "&&": "||", "||": "&&", "<": "<=", "<=": "<",
    ">": ">=", ">=": ">", "==": "!=", "!=": "==", "+=": "-=", "-=": "+=", "|=": "=", "^": "|",
}  # fmt: skip
_NAMES = {
    "min_i32": "max_i32", "max_i32": "min_i32", "min_u32": "max_u32", "max_u32": "min_u32", "mulhi_near": "mulhi_i32",
    "true": "false", "false": "true",
}  # fmt: skip
_TOKEN = re.compile(
    r"(?P<name>[A-Za-z_]\w*)|(?P<number>0[xX][0-9a-fA-F]+|\d+)(?P<suffix>[uUlL]*)"
    r"|(?P<operator><<=|>>=|<<|>>|<=|>=|==|!=|&&|\|\||\+\+|--|->|[-+|&^*/%]=|[-+<>&|^])|\S"
)
_STATEMENT = re.compile(r"^\s+[\w\[\].>()*+ -]+ (=|\+=|-=|\|=) .*;$|^\s+(\+\+)?[\w\[\].>-]+(\+\+)?;$|^\s+\w+\(.*\);$")
_DECLARATION = re.compile(
    r"^\s*(const|u?int\d+_t|bool|unsigned|static|return|axis_\w+|plumb_\w+_t|fusion_\w+|extern)\b"
)
_COMMENT = re.compile(r"/\*.*?\*/", re.DOTALL)


@dataclass(frozen=True)
class Mutant:
    """file: below firmware. line: from 1; column: from 0."""

    file: str
    line: int
    column: int
    old: str
    new: str

    def __str__(self) -> str:
        return f"{self.file}:{self.line}:{self.column + 1}: {self.old.strip()} -> {self.new or 'nothing'}"

    def text(self) -> str:
        """The whole file with the change."""
        lines = (FIRMWARE / self.file).read_text(encoding="utf-8").split("\n")
        line = lines[self.line - 1]
        assert line[self.column :].startswith(self.old), self
        lines[self.line - 1] = line[: self.column] + self.new + line[self.column + len(self.old) :]
        return "\n".join(lines)


def sources() -> list[Path]:
    """The files whose code a step runs."""
    files = [*FIRMWARE.glob("core/*.[ch]"), *FIRMWARE.glob("systems/*.[ch]")]
    return sorted(path for path in files if path.name not in APART)


def mutants() -> list[Mutant]:
    """Every mutant of the code that a step runs."""
    return [one for path in sources() for one in _of_file(path)]


def _of_file(path: Path) -> Iterator[Mutant]:
    name = path.relative_to(FIRMWARE).as_posix()
    lines = list(_code(path.read_text(encoding="utf-8")))
    for one in lines:
        if one.kind == "define":
            defined = one.text.split()[1]
            if re.search(rf"\b{defined}\b", _text_of_steps(lines)):
                yield from _in_line(name, one.number, one.text, one.text.index(defined) + len(defined))
        elif one.kind == "table":
            yield from _in_line(name, one.number, one.text, one.text.find("{") + 1)
        elif one.kind == "step":
            if _STATEMENT.match(one.text) and not _DECLARATION.match(one.text):
                begin = len(one.text) - len(one.text.lstrip())
                yield Mutant(name, one.number, begin, one.text.strip(), ";")
            yield from _in_line(name, one.number, one.text, 0)


def _text_of_steps(lines: Sequence[_Line]) -> str:
    return "\n".join(one.text for one in lines if one.kind in ("step", "macro"))


@dataclass(frozen=True)
class _Line:
    """kind: define, table or step; or of another kind, which stays as it is."""

    number: int
    text: str
    kind: str


def _code(text: str) -> Iterator[_Line]:
    """The lines of a file, without comments and without what this compiler does not see."""
    code = _COMMENT.sub(lambda found: re.sub(r"[^\n]", " ", found[0]), text)
    function, table, seen = "", False, [True]
    for number, line in enumerate(code.split("\n"), 1):
        if line.startswith("#"):
            seen = _seen(seen, line)
            value = re.match(r"#define \w+ +\S", line)
            yield _Line(number, line, "define" if value and seen[-1] else "macro")
            continue
        if line[:1].isalpha():
            head = line.partition("(")[0].split()
            function = head[-1].lstrip("*") if "(" in line and head else ""
            table = "const" in head and "=" in line and "plausibility" not in line
        whole = not line.startswith(" ") and (line.startswith("typedef") or (line.endswith(";") and not table))
        if whole or not seen[-1] or "LOADED" in line:
            yield _Line(number, line, "other")
        elif table:
            yield _Line(number, line, "table")
        else:
            of_a_step = line.startswith(" ") and bool(function) and not NOT_OF_A_STEP.search(function)
            yield _Line(number, line, "step" if of_a_step else "other")


def _seen(seen: list[bool], line: str) -> list[bool]:
    """Whether gcc on this machine compiles what follows, for each condition around it."""
    if line.startswith("#if"):
        return [*seen, seen[-1] and "__thumb2__" not in line and "__arm__" not in line and "_WIN32" not in line]
    if line.startswith("#else"):
        return [*seen[:-1], seen[-2] and not seen[-1]]
    return seen[:-1] if line.startswith("#endif") else seen


def _in_line(name: str, number: int, line: str, begin: int) -> Iterator[Mutant]:
    for found in _TOKEN.finditer(line, begin):
        at, token = found.start(), found[0]
        if found["number"]:
            value = int(found["number"], 0)
            for other in (value + 1, value - 1):
                if other >= 0:
                    yield Mutant(name, number, at, token, f"{other}{found['suffix']}")
        elif found["name"]:
            if token in _NAMES:
                yield Mutant(name, number, at, token, _NAMES[token])
            elif re.fullmatch(r"[A-Z][A-Z0-9_]{3,}", token) and line[found.end() :][:1] != "(":
                yield Mutant(name, number, at, token, f"({token} + 1)")
                yield Mutant(name, number, at, token, f"({token} - 1)")
        elif found["operator"] and token in _SWAPS:
            around = line[at - 1 : at] + line[found.end() : found.end() + 1]
            if around == "  " or token in ("<<", ">>"):
                yield Mutant(name, number, at, token, _SWAPS[token])


class Workshop:
    """Builds the library of the core in a folder: what does not depend on the changed file is compiled once."""

    def __init__(self, folder: Path, options: Sequence[str] = ("-O1",), compiler: str = "gcc") -> None:
        self._folder = folder
        self._compiler = [compiler, "-std=c99", "-w", "-fPIC", *options]
        units = [*FIRMWARE.glob("core/*.c"), *FIRMWARE.glob("systems/*.c")]
        units += [FIRMWARE / "generated/systems.c"]
        units += [FIRMWARE / f"ports/batch/{name}.c" for name in ("batch", "blocks", "checks")]
        self._units = sorted(path.relative_to(FIRMWARE).as_posix() for path in units)
        self._needs = {unit: self._included(unit) for unit in self._units}
        self._objects = {unit: folder / (unit.replace("/", "_") + ".o") for unit in self._units}
        for unit, built in self._objects.items():
            self._compile(FIRMWARE, unit, built)

    def library(self, mutant: Mutant | None = None, name: str = "baseline") -> Path | None:
        """The library with this change; None when it does not compile."""
        objects, built = dict(self._objects), self._folder / f"{name}.so"
        if mutant is not None:
            tree = self._tree(name, mutant)
            for unit in self._units:
                if mutant.file in self._needs[unit]:
                    objects[unit] = tree / (unit.replace("/", "_") + ".o")
                    try:
                        self._compile(tree, unit, objects[unit])
                    except subprocess.CalledProcessError:
                        return None
        subprocess.run([*self._compiler, "-shared", "-o", built, *objects.values()], check=True, capture_output=True)
        return built

    def _tree(self, name: str, mutant: Mutant) -> Path:
        """The sources as links, but for the changed one."""
        tree = self._folder / f"{name}.tree"
        for path in FIRMWARE.rglob("*.[ch]"):
            place = tree / path.relative_to(FIRMWARE)
            if place.parts[len(tree.parts)] in ("core", "systems", "generated", "include", "ports"):
                place.parent.mkdir(parents=True, exist_ok=True)
                place.symlink_to(path)
        place = tree / mutant.file
        place.unlink()
        place.write_text(mutant.text(), encoding="utf-8")
        return tree

    def _compile(self, tree: Path, unit: str, built: Path) -> None:
        command = [*self._compiler, f"-I{tree}", f"-I{tree}/include", f"-I{BUILT}", "-c", f"{tree}/{unit}"]
        command += ["-o", str(built)]
        subprocess.run(command, check=True, capture_output=True)

    def _included(self, unit: str) -> set[str]:
        command = [*self._compiler, f"-I{FIRMWARE}", f"-I{FIRMWARE}/include", f"-I{BUILT}"]
        command += ["-MM", f"{FIRMWARE}/{unit}"]
        said = subprocess.run(command, check=True, capture_output=True, text=True).stdout
        names = said.partition(":")[2].replace("\\\n", " ").split()
        paths = [Path(name).resolve() for name in names]
        return {path.relative_to(FIRMWARE).as_posix() for path in paths if path.is_relative_to(FIRMWARE)}
