"""Write the table of formats in docs/how-to/check.md from what the readers of recordings declare.

.venv/bin/python tools/gen_formats.py             write it
.venv/bin/python tools/gen_formats.py --check     exit code 1 when it differs
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "host"))

from plumb.readers import recording_files  # noqa: E402
from plumb.readers.imu_files import serial_dumps, table_sets, text_tables, ulog  # noqa: E402
from plumb.readers.imu_files.conventions import Convention, conventions  # noqa: E402
from plumb.readers.imu_files.formats import Format, Header  # noqa: E402
from plumb.readers.recording_files import NOTHING  # noqa: E402

PAGE = ROOT / "docs" / "how-to" / "check.md"
BEGIN, END = "<!-- formats: tools/gen_formats.py writes them from what the readers declare -->\n\n", "\n<!-- end -->\n"


def of_header(one: Header) -> Format:
    """With the columns of the first axis, and the units that the reader takes from the line."""
    layout = text_tables.layout_of(one.line, NOTHING)
    if layout is None:
        raise SystemExit(f"{one.written}: its header is not read: {one.line}")
    shown = [at for at, said in sorted(layout.meanings.items()) if said.axis == 0]
    units = {said.quantity: said.unit for said in layout.meanings.values()}
    taken = ", ".join(units[quantity] for quantity in ("time", "gyr", "acc"))
    return Format(
        one.written,
        ", ".join(f"`{layout.header[at]}`" for at in shown) + ", ...",
        taken + (f"; {one.more}" if one.more else ""),
    )


def of_convention(one: Convention) -> Format:
    shown = [names[0] for names in one.columns.values()]
    units = ", ".join(one.units[quantity] or "as `Update Rate` says" for quantity in ("time", "gyr", "acc"))
    more = [units]
    more += ["the quaternion as the reference"] if "ref" in one.columns else []
    more += ["counts that begin again at 0"] if one.wrap else []
    more += [text for text in (one.note, one.assumed) if text]
    return Format(f"{one.name}, a table", ", ".join(f"`{name}`" for name in shown) + ", ...", "; ".join(more))


def table() -> str:
    known = [of_convention(one) for before in ([], ["DeviceTag"]) for one in conventions(before)]
    rows = [
        *map(of_header, text_tables.HEADERS[:-1]),
        *table_sets.FORMATS,
        *ulog.FORMATS,
        *{one.written: one for one in known}.values(),
        *serial_dumps.FORMATS,
        of_header(text_tables.HEADERS[-1]),
        *recording_files.FORMATS,
    ]
    lines = ["| written by | looks so | taken |", "|---|---|---|"]
    return "\n".join(lines + [f"| {one.written} | {one.looks} | {one.taken} |" for one in rows]) + "\n"


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--check", action="store_true")
    check = parser.parse_args().check
    old = PAGE.read_text(encoding="utf-8")
    before, mark, rest = old.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not mark or not end:
        raise SystemExit(f"{PAGE.name} has no place for the table of formats")
    new = before + BEGIN + table() + END + after
    if check and new != old:
        print(f"{PAGE.relative_to(ROOT)} is stale: run tools/gen_formats.py")
        return 1
    if not check:
        PAGE.write_text(new, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
