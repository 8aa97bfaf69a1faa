"""Which values of the table an armed board takes: those that keep the numbered promises (docs/explanation/security.md).

A row has a range of its own (`armed`), or is a word of a condition that joins several. The firmware has the same ranges
and conditions from the same declarations (tools/gen_params.py), and evaluates them by itself: params_unsafe().
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache

from plumb.errors import UsageError
from plumb.spec import declarations, parameters
from plumb.spec.parameters import Parameter
from plumb.spec.system import TomlTable
from plumb.spec.units import meaning

REACH, PRODUCT, MOST, LEAST = "reach", "product", "most", "least"
WORDS = {REACH: 4, PRODUCT: 2, MOST: 1, LEAST: 1}
"""Number of words that a condition of each kind joins."""
LIMIT = {REACH: "least", PRODUCT: "most", MOST: "most", LEAST: "least"}
CALIBRATION = ("raw_min", "raw_max", "gain", "offset")


@dataclass(frozen=True)
class Condition:
    """reach: of the words raw_min, raw_max, gain and offset of a group, gain * count + offset is at most -limit at one
    end of the counts and at least limit at the other. product: of two words of at least 0, their product is less than
    (limit + 1) * 2^32. most, least: of one word, signed. system: while this one is in use; "": with every one."""

    kind: str
    words: tuple[str, ...]
    limit: int
    system: str = ""

    @property
    def group(self) -> str:
        return self.words[0].rpartition(".")[0]


@dataclass(frozen=True)
class Unsafe:
    """Why a table is not armed: the first word, and the sentence about it."""

    row: Parameter
    text: str


def _condition(given: TomlTable, system: str) -> Condition:
    kind, words = given.get("kind"), given.get("words")
    if kind not in WORDS or given.keys() != {"kind", "words", LIMIT[kind]}:
        raise UsageError("condition: reach and least have words and least, product and most have words and most")
    limit, known = given[LIMIT[kind]], {row.name: row for row in parameters.table()}
    if not isinstance(words, list) or len(words) != WORDS[kind] or not all(name in known for name in words):
        raise UsageError(f"condition {kind}: words names {WORDS[kind]} parameters, not {words!r:.60}")
    group = known[words[0]].group
    if kind == REACH and words != [f"{group}.{row}" for row in CALIBRATION]:
        raise UsageError(f"condition reach: words are {', '.join(CALIBRATION)} of one group, not {words!r:.60}")
    if kind == PRODUCT and any(known[name].min < 0 for name in words):
        raise UsageError(f"condition product: {words[0]} and {words[1]} are at least 0")
    if type(limit) is not int or not 0 <= limit < 1 << 31:
        raise UsageError(f"condition {kind} of {words[0]}: {LIMIT[kind]} is an integer from 0 to 2^31 - 1")
    return Condition(kind, tuple(words), limit, system)


@lru_cache(maxsize=1)
def conditions() -> tuple[Condition, ...]:
    """Those of the shared rows, then those of the systems in the order of their names. Raises UsageError for one that
    cannot be evaluated, and for a row that weakens a promise and has no limit."""
    shared = [_condition(one, "") for one in declarations.shared()["condition"]]
    own = [
        _condition(one, name) for name, system in sorted(declarations.systems().items()) for one in system.conditions
    ]
    found = (*shared, *own)
    joined = {name for one in found for name in one.words}
    for row in parameters.table():
        if bool(row.weakens) != bool(row.armed or row.name in joined):
            raise UsageError(f"parameter {row.name}: a row that weakens a promise, and no other, has a limit")
        if row.armed and not row.min <= row.armed[0] <= row.default <= row.armed[1] <= row.max:
            raise UsageError(f"parameter {row.name}: armed lies within min and max, and has the default in it")
        if unknown := set(row.weakens) - promises().keys():
            raise UsageError(f"parameter {row.name}: there is no promise {min(unknown)} in parameters.toml")
    return found


@lru_cache(maxsize=1)
def promises() -> Mapping[int, str]:
    """Number -> what is promised, of those that a parameter can weaken."""
    return {int(number): text for number, text in declarations.shared()["promises"].items()}


def unsafe(values: Mapping[str, int]) -> Unsafe | None:
    """The first word of a whole table with which the board is not armed; None without one. A system that drives nothing
    is never armed, and has none."""
    if not declarations.system(declarations.name_of(values["system"])).output:
        return None
    return next(_found(values), None)


def reason(index: int, values: Mapping[str, int] | None = None) -> str:
    """The sentence for a word that the board named. values: the table in use, where it is known."""
    table = parameters.table()
    if not 0 <= index < len(table):
        return f"parameter {index} would break a promise"
    found = next((one for one in _found(values) if one.row is table[index]), None) if values else None
    return found.text if found else _sentence(table[index], "its value")


def _sentence(row: Parameter, what: str) -> str:
    kept = "; ".join(f"{number}, {promises()[number]}" for number in row.weakens)
    return f"{row.name}: {what} would break promise {kept}"


def _found(values: Mapping[str, int]) -> Iterator[Unsafe]:
    rows = {row.name: row for row in parameters.table()}
    for row in rows.values():
        value = values[row.name]
        if row.armed and not row.armed[0] <= value <= row.armed[1]:
            low, high = (f"{end}{_means(row, values, end)}" for end in row.armed)
            yield Unsafe(row, f"{_sentence(row, str(value) + _means(row, values, value))}: set {low} to {high}")
    in_use = declarations.name_of(values["system"])
    for one in conditions():
        if one.system not in ("", in_use):
            continue
        if one.kind == REACH:
            yield from _unreached(one, values, rows)
        elif one.kind in (MOST, LEAST):
            yield from _beyond(one, values, rows)
        elif values[one.words[0]] * values[one.words[1]] >> 32 > one.limit:
            row = rows[one.words[0]]
            yield Unsafe(row, _sentence(row, f"its product with {one.words[1]}") + ": make one of them smaller")


def _beyond(one: Condition, values: Mapping[str, int], rows: Mapping[str, Parameter]) -> Iterator[Unsafe]:
    row = rows[one.words[0]]
    value = values[row.name]
    if value > one.limit if one.kind == MOST else value < one.limit:
        limit = f"{one.limit}{_means(row, values, one.limit)}"
        what = f"{value}{_means(row, values, value)}, with the system {one.system},"
        yield Unsafe(row, f"{_sentence(row, what)}: set at {one.kind} {limit}")


def _means(row: Parameter, values: Mapping[str, int], value: int) -> str:
    text = str(meaning(row, {**values, row.name: value}))
    return f" ({text})" if text and text != str(value) else ""


def _unreached(one: Condition, values: Mapping[str, int], rows: Mapping[str, Parameter]) -> Iterator[Unsafe]:
    low, high, gain, offset = (values[name] for name in one.words)
    ends = {0: -(gain * low + offset), 1: gain * high + offset}  # of a positive gain, each as far as it reaches
    for place, reached in ends.items():
        if gain == 0 or (reached if gain > 0 else -reached) < one.limit:
            row, what = rows[one.words[2 if gain == 0 else place]], f"the calibrated range of {one.group}"
            where = f"{one.group}.raw_min to {one.group}.raw_max has to reach beyond {reach_text(one)}"
            yield Unsafe(row, f"{_sentence(row, what)}: {where} on both sides of 0")
            return


def reach_text(one: Condition) -> str:
    """The least of a condition `reach` in engineering units."""
    gain = next(row for row in parameters.table() if row.name == one.words[3])
    unit, scale = ("deg/s", 360.0) if gain.unit == "turn/s" else (gain.unit, 1.0)
    return f"{scale * one.limit / 2.0 ** int(gain.format[1:]):.4g} {unit}"
