"""Identity of a run: software, board, image and parameters, so that a report can be traced and repeated.

The date is that of SOURCE_DATE_EPOCH (seconds since 1970, UTC) where the environment sets it, so that two runs of one
command line give the same bytes.
"""

from __future__ import annotations

import hashlib
import os
import platform
import re
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from plumb.boards.contract import StepBoard
from plumb.boards.link import LinkBoard
from plumb.boards.native.board import NativeBoard
from plumb.boards.qemu import QemuBoard
from plumb.boards.virtual import VirtualBoard
from plumb.contract.parameters import ControlParams
from plumb.errors import UsageError
from plumb.proof.report import Table
from plumb.spec import parameters
from plumb.spec.protocol import protocol
from plumb.spec.units import meaning
from plumb.version import installed

DATE_VARIABLE = "SOURCE_DATE_EPOCH"
_COMPILER = re.compile(rb"GCC: \([^)\0]*\) [\w.+-]+|clang version [\w.+~-]+")
"""Compiler names in the section .comment of an ELF file."""


def date_utc() -> str:
    """Now, or the date of SOURCE_DATE_EPOCH, ISO 8601; raises UsageError where that is no number of seconds."""
    given = os.environ.get(DATE_VARIABLE)
    try:
        moment = datetime.now(UTC) if not given else datetime.fromtimestamp(int(given), UTC)
    except (ValueError, OverflowError, OSError):
        raise UsageError(f"{DATE_VARIABLE}={given!r} is no number of seconds since 1970; unset it") from None
    return moment.strftime("%Y-%m-%dT%H:%M:%SZ")


def image_of(path: Path, data: bytes | None = None) -> dict[str, object]:
    """Name, SHA-256, size and compiler of a file of code; data: its bytes, where they have been read."""
    data = path.read_bytes() if data is None else data
    found = _COMPILER.search(data)
    elf = path.with_suffix(".elf")
    if found is None and path.suffix == ".bin" and elf.is_file():
        from plumb.flash.image import load_image

        if load_image(elf) == data:  # else it is of another build
            found = _COMPILER.search(elf.read_bytes())
    return {
        "file": path.name,
        "sha256": hashlib.sha256(data).hexdigest(),
        "bytes": len(data),
        "compiler": found[0].decode("ascii", "replace") if found else None,
    }


def part_of(board: StepBoard) -> dict[str, object]:
    """Identity of the board that ran the steps, its image, and its own report; {} where a part is unknown."""
    found: dict[str, object] = {"board": board.name}
    if isinstance(board, NativeBoard):
        from plumb.boards.native.core import core_path

        return {**found, "image": image_of(core_path())}
    if isinstance(board, QemuBoard):
        return {**found, "image": image_of(board.image)}
    if isinstance(board, VirtualBoard):
        found |= {"image": image_of(board.image, board.image_bytes)}
    if isinstance(board, LinkBoard) and (says := board.session.identity) is not None:
        found |= {
            "firmware_git_hash": says.git_hash or None,
            "unique_id": says.unique_id,
            "part_id": f"0x{says['PART_ID']:08x}",
            "flash_kib": says["FLASH_KIB"],
            "ram_kib": says["RAM_KIB"],
            "last_reset": says.reset_cause,
        }
    return found


def parameters_of(params: ControlParams) -> dict[str, object]:
    """Every parameter that the system reads: the word, and its value and unit where its format defines them."""
    rows = {row.name: row for row in parameters.table()}
    values = {name: row.default for name, row in rows.items()} | params.values
    found: dict[str, object] = {}
    for name, word in {"system": params.values["system"], **params.own()}.items():
        means = meaning(rows[name], values)
        found[name] = {
            "word": word,
            "format": rows[name].format,
            "value": means.choice or means.value,
            "unit": means.unit or rows[name].unit,
        }
    return found


def identity(part: Mapping[str, object], params: ControlParams | None, command: str) -> dict[str, object]:
    """The entry `identity` of summary.json. params: of the run, None where its words are not at hand."""
    return {
        "plumb": {"version": installed().version, "git_hash": installed().commit or None},
        "protocol": {"version": protocol().version, "dbc_hash": f"0x{protocol().dbc_hash:08x}"},
        "date_utc": date_utc(),
        "command": command,
        "part": dict(part),
        "host": {
            "platform": platform.platform(),
            "machine": platform.machine(),
            "python": platform.python_version(),
            "numpy": np.__version__,
        },
        **(
            {}
            if params is None
            else {"parameters_crc32": f"0x{params.crc32():08x}", "parameters": parameters_of(params)}
        ),
    }


LABELS = {
    "plumb.version": "plumb",
    "plumb.git_hash": "commit of plumb",
    "protocol.version": "protocol version",
    "protocol.dbc_hash": "hash of the messages",
    "date_utc": "date (UTC)",
    "command": "command",
    "part.board": "board",
    "part.image.file": "image",
    "part.image.sha256": "SHA-256 of the image",
    "part.image.bytes": "bytes of the image",
    "part.image.compiler": "compiler of the image",
    "part.firmware_git_hash": "commit of the image, as the board says",
    "part.unique_id": "unique id of the board",
    "part.part_id": "part id of the board",
    "part.flash_kib": "flash of the board, KiB",
    "part.ram_kib": "RAM of the board, KiB",
    "part.last_reset": "last reset of the board",
    "host.platform": "host",
    "host.machine": "machine of the host",
    "host.python": "Python",
    "host.numpy": "numpy",
    "parameters_crc32": "CRC-32 of the parameters",
}


def _flat(values: Mapping[str, object], before: str = "") -> dict[str, object]:
    found: dict[str, object] = {}
    for name, value in values.items():
        found |= _flat(value, f"{before}{name}.") if isinstance(value, Mapping) else {f"{before}{name}": value}
    return found


def rows(entry: Mapping[str, object]) -> list[tuple[str, str]]:
    """Label and value of everything in an identity but its parameters, as text."""
    flat = _flat({name: value for name, value in entry.items() if name != "parameters"})
    return [(LABELS.get(name, name), "not known" if value is None else str(value)) for name, value in flat.items()]


def tables(entry: Mapping[str, object], heading: Mapping[str, object]) -> list[Table]:
    """The identity as tables of the page. heading: further rows, by name; parameters: folded, words and units."""
    words = entry.get("parameters", {})
    assert isinstance(words, Mapping)
    head_rows = [(name, "none" if value is None else str(value)) for name, value in heading.items()]
    found = [Table("Identity", ["", ""], [*head_rows, *rows(entry)])]
    if words:
        lines = [
            [name, str(row["word"]), row["format"], _number(row["value"]), row["unit"]] for name, row in words.items()
        ]
        head = ["parameter", "word", "format", "value", "unit"]
        note = "Variances count in a unit that each parameter set chooses: their values are left out."
        found.append(Table(f"Parameters ({len(lines)})", head, lines, note, folded=True))
    return found


def _number(value: object) -> str:
    return "" if value is None else f"{value:.9g}" if isinstance(value, float) else str(value)
