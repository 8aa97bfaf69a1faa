"""Write params.[ch], the table of parameters: integer limits and defaults, no names.

The table is plumb_params_t word for word, then the words of the link and the board. Every place is asserted at
compile time, so that a number on the wire means the same member on both sides.

A flash image holds only the groups that its systems read (`plumb.spec.images`). The numbers on the wire stay: a
parameter that the image does not hold is a constant there, its factory value.
"""

from __future__ import annotations

import sys
from collections.abc import Collection, Sequence
from dataclasses import replace
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT / "host"), str(ROOT / "tools")]

from gen_params_text import (  # type: ignore[import-not-found]  # noqa: E402
    HEADER,
    LINE_1,
    LIVE,
    NO_LIVE,
    PARTLY,
    SOURCE,
    UNREACHED,
    WHOLE,
)
from plumb.spec import declarations  # noqa: E402
from plumb.spec.armed_values import LEAST, MOST, PRODUCT, REACH, Condition, conditions  # noqa: E402
from plumb.spec.parameters import Parameter, table  # noqa: E402


def generate(system: int, groups: Collection[str], ways: int) -> dict[str, str]:
    """File name -> text. system: the number of the system in use with factory values; groups: those that are held;
    ways: how many ways of wiring the sensors the image knows."""
    rows = [replace(row, default=system) if row.name == "system" else row for row in table()]
    rows = [replace(row, max=ways - 1) if row.name == "accel_bus" else row for row in rows]
    held = [row for row in rows if not row.group or row.group in groups]
    own = [row for row in held if row.owner == "link"]
    live = [place for place, row in enumerate(held) if row.live]
    assert not rows[-1].group, "params_crc32() needs a last row that every image holds"
    wide = [row.name for row in rows if row.live and not (row.min > -(2**31) and row.max < 2**31)]
    assert not wide, f"is_near() takes signed words and doubles their amounts: {wide}"
    places = [
        f"PLACE({row.name if row.owner == 'link' else f'control.{row.name}'}, {place});"
        for place, row in enumerate(held)
    ]
    ranges = list(dict.fromkeys((row.min, row.max) for row in held))
    limits = {word(number) for row in held for number in (row.min, row.max, *row.armed)}
    numbers = sorted(limits | {word(row.default) for row in rows})
    at = {number: place for place, number in enumerate(numbers)}
    index_type = smallest_type(len(rows))
    reach, conditions = condition_code([row.name for row in rows], [row.name for row in held])
    return {
        "params.h": LINE_1
        + HEADER.format(
            count=len(rows),
            held_count=len(held),
            live_count=len(live),
            live_room="PARAMS_LIVE" if live else "1 /* none is live */",
            members="\n".join(f"    {row.type}_t {row.name};" for row in own),
        ),
        "params.c": LINE_1
        + SOURCE.format(
            place_type=smallest_type(len(numbers)),
            index_type=index_type,
            numbers="\n".join(f"    {number}," for number in numbers),
            ranges="\n".join(
                f"    {{{at[word(low)]}U, {at[word(high)]}U}}, /* {low} to {high} */" for low, high in ranges
            ),
            range_type=smallest_type(len(ranges)),
            range_of="\n".join(f"    {ranges.index((row.min, row.max))}U, /* {row.name} */" for row in held),
            defaults="\n".join(
                f"    {at[word(row.default)]}U, /* {index}: {row.name} = {row.default} */"
                for index, row in enumerate(rows)
            ),
            ids="\n".join(f"    0x{row.id:04X}U, /* {row.name} */" for row in held),
            places="\n".join(places),
            table=WHOLE if len(held) == len(rows) else PARTLY.format(index_type=index_type, runs=run_rows(rows, held)),
            live=LIVE.format(
                index_type=index_type, rows="\n".join(f"    {place}U, /* {held[place].name} */" for place in live)
            )
            if live
            else NO_LIVE,
            armed="\n".join(
                f"    {{{place}U, {{{at[word(row.armed[0])]}U, {at[word(row.armed[1])]}U}}}}, "
                f"/* {row.name}: {row.armed[0]} to {row.armed[1]} */"
                for place, row in enumerate(held)
                if row.armed
            ),
            reach=reach,
            conditions=conditions,
        ),
    }


def run_rows(rows: Sequence[Parameter], held: Sequence[Parameter]) -> str:
    """The held rows as runs of neighbours: index of the first, number of them."""
    names = {row.name for row in held}
    firsts = [i for i, row in enumerate(rows) if row.name in names and (i == 0 or rows[i - 1].name not in names)]
    ends = [i for i, row in enumerate(rows, 1) if row.name in names and (i == len(rows) or rows[i].name not in names)]
    return "\n".join(
        f"    {{{first}U, {end - first}U}}, /* {rows[first].name} to {rows[end - 1].name} */"
        for first, end in zip(firsts, ends, strict=True)
    )


def condition_code(names: Sequence[str], held: Sequence[str]) -> tuple[str, str]:
    """For conditions of several words: a function, and the statements of params_unsafe(). names: all, by index; held:
    by place. A condition without a held word is left out, because factory values keep it; so is one of a system whose
    own words are not held."""

    def is_held(one: Condition) -> bool:
        own = declarations.system(one.system).parameters if one.system else ()
        return bool(set(one.words) & set(held)) and {row["name"] for row in own} <= set(held)

    lines = []
    those = [one for one in conditions() if is_held(one)]
    reaches = [(held.index(one.words[0]), one) for one in those if one.kind == REACH]
    for first, one in reaches:
        assert [held.index(name) for name in one.words] == list(range(first, first + 4)), one.words
    if reaches:
        entries = ", ".join(f"{{{first}U, {one.limit}}}" for first, one in reaches)
        lines += [
            "    static const struct {\n        uint16_t raw_min;\n        int32_t least;",
            f"    }} reach[] = {{{entries}}};",
            "",
            "    for (size_t i = 0; i < sizeof reach / sizeof reach[0]; i++) {",
            "        const uint16_t place = unreached(p, reach[i].raw_min, reach[i].least);",
            "",
            "        if (place != PARAMS_HELD) {",
            "            return params_held(place);",
            "        }",
            "    }",
        ]
    for one in those:
        if one.kind in (MOST, LEAST):
            place, sign = names.index(one.words[0]), ">" if one.kind == MOST else "<"
            number = declarations.system(one.system).number
            lines += [
                f"    if (p->control.system == {number}U && (int32_t)params_word(p, {place}U) {sign} {one.limit}) {{",
                f"        return {place}U;",
                "    }",
            ]
        if one.kind == PRODUCT:
            first, second = (names.index(name) for name in one.words)
            lines += [
                f"    if (mulhi_u32(params_word(p, {first}U), params_word(p, {second}U)) > {one.limit}U) {{",
                f"        return {first}U;",
                "    }",
            ]
    return UNREACHED if reaches else "", "\n".join(lines)


def smallest_type(count: int) -> str:
    """Of a place in a table of so many entries."""
    return "uint8_t" if count <= 256 else "uint16_t"


def word(value: int) -> str:
    """As the firmware has it."""
    return f"0x{value & 0xFFFFFFFF:08X}U"
