"""A log of a board or a bus: what the blocks of a .plog file hold, and how they are read.

    HEAD   JSON: who was recorded, by what, when; `clock` says what the times count
    DBCT   the DBC of the frames, UTF-8
    PARM   JSON: parameters by name, as the table's integers; the first holds all, later ones what changed
    FRMS   frames, packed records of FRAME
    TRTH   JSON: the true place of a simulated vehicle at some times, which no board measures
    DONE   JSON: why the recording ended, and what it counted; a log without it was cut, or is being written

The frames are the recording: raw counts, digests, signals and setpoints are in them, as the board sent them. docs/
reference/log.md is the specification.
"""

from __future__ import annotations

import json
import math
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from plumb.errors import UsageError, counted
from plumb.files.block_file import Block, Damage, read_blocks
from plumb.files.bounded_reader import MIB, Limits, pieces_of
from plumb.link.frame_records import BLOCK_FRAMES as BLOCK_FRAMES
from plumb.link.frame_records import ERROR as ERROR
from plumb.link.frame_records import EXTENDED as EXTENDED
from plumb.link.frame_records import FRAME as FRAME
from plumb.link.frame_records import PACK as PACK
from plumb.link.frame_records import REMOTE as REMOTE
from plumb.link.frame_records import Frames as Frames
from plumb.spec import parameters
from plumb.spec.protocol import Protocol, database_of, protocol, protocol_of

MAGIC = "plumb log 1"
SUFFIX = ".plog"
HEAD, DBC_TEXT, PARAMETERS, FRAMES, TRUTH, DONE = "HEAD", "DBCT", "PARM", "FRMS", "TRTH", "DONE"
UTC, SIMULATED = "utc", "simulated"
"""Clocks of a head: microseconds since 1970, or since the start of a simulated board."""
ADVICE = "give a log of `plumb record`"
DBC_LIMITS = Limits(cpu_s=(20.0, 0.0), memory_bytes=(512 * MIB, 0))
"""Time limit for reading the DBC of a log, and the factor for a slow machine is 20: plumb's own takes a second."""
_DBC_READER = f"{__name__}:read_dbc"

TRUE_PLACE = ("true_x_m", "true_y_m", "true_height_m")
"""Names of TRTH: x and y of the earth, and up."""
Json = Mapping[str, object]


@dataclass(frozen=True)
class ParameterSet:
    """Parameters by name, as the table's integers, from a place in the frames on. crc32: of the whole table, where it
    is known."""

    at: int
    values: dict[str, int]
    crc32: int | None = None


@dataclass
class Log:
    """Content of a log. blocks: reads its frames from the beginning, in pieces of a bounded size; count: how many there
    are. truth: name with unit -> times in us, by the clock of the frames, and values there. damages: places that are
    not whole blocks; lost_blocks: numbers that are missing between whole blocks. done: None when the recording was cut.
    notes: sentences on how a file of another tool was read."""

    path: Path
    head: dict[str, object] = field(default_factory=dict)
    dbc: str | None = None
    parameter_sets: list[ParameterSet] = field(default_factory=list)
    blocks: Callable[[], Iterable[Frames]] = tuple
    count: int = 0
    truth: dict[str, list[tuple[int, float]]] = field(default_factory=dict)
    done: dict[str, object] | None = None
    damages: list[Damage] = field(default_factory=list)
    lost_blocks: int = 0
    notes: list[str] = field(default_factory=list)

    @property
    def frames(self) -> Frames:
        """All frames together, in memory."""
        return np.concatenate([np.zeros(0, FRAME), *self.blocks()])

    @property
    def warnings(self) -> list[str]:
        """A sentence for everything that is not as the recorder wrote it."""
        found = list(self.notes)
        inside = [damage for damage in self.damages if not damage.at_end]
        if inside:
            size = sum(damage.end - damage.start for damage in inside)
            found.append(f"{self.path.name} is damaged at byte {inside[0].start}: {counted(size, 'byte')} left out")
        elif self.lost_blocks:
            found.append(f"{self.path.name} lacks {counted(self.lost_blocks, 'block')}: part of it was cut out")
        if any(damage.at_end for damage in self.damages):
            found.append(f"{self.path.name} was cut: it is read up to its last whole block")
        elif self.done is None:
            found.append(f"{self.path.name} has no end: the recorder was killed, or still writes it")
        return found

    def protocol(self) -> Protocol:
        """The messages by the log's own DBC; raises UsageError when it is lost and is not that of this version."""
        if self.dbc is None:
            said = self.head.get("protocol")
            if isinstance(said, dict) and said.get("dbc_hash") == f"0x{protocol().dbc_hash:08x}":
                return protocol()
            raise UsageError(f"the DBC in {self.path} is lost, and this plumb has another: give an undamaged copy")
        if self.dbc == _own_dbc():
            return protocol()
        return _foreign_protocol(self.path, self.dbc)


def _foreign_protocol(path: Path, dbc: str) -> Protocol:
    """The messages of another version's DBC, read first in a process with limits: cantools has none."""
    with tempfile.TemporaryDirectory(prefix="plumb-") as folder:
        copy = Path(folder) / f"{path.name}.dbc"
        copy.write_text(dbc, encoding="utf-8")
        try:
            for _ in pieces_of(_DBC_READER, copy, ADVICE, DBC_LIMITS):
                pass
            return protocol_of(database_of(dbc))
        except Exception as error:  # cantools raises many kinds of exceptions
            what = "it is damaged" if isinstance(error, UsageError) else type(error).__name__
            raise UsageError(f"the DBC in {path} cannot be read ({what}); {ADVICE}") from None


def read_dbc(path: Path) -> Iterator[bytes]:
    """Read a DBC, and give nothing. Runs in the process of the reader; raises what the libraries raise."""
    protocol_of(database_of(path.read_text(encoding="utf-8")))
    yield from ()


def _own_dbc() -> str:
    from plumb.spec import dbc

    return dbc.text()


def read_log(path: Path) -> Log:
    """Read a log up to its last whole block. Raises UsageError for a file that is no log, or that holds what no
    recorder writes."""
    log, following = Log(path, blocks=lambda: _blocks_of(path)), 0
    for one in read_blocks(path, MAGIC, ADVICE):
        if isinstance(one, Damage):
            log.damages.append(one)
            continue
        log.lost_blocks += max(one.number - following, 0)
        following = one.number + 1
        if one.kind == FRAMES:
            log.count += len(_frames_of(path, one))
        elif one.kind == DBC_TEXT:
            log.dbc = one.payload.decode("utf-8", "replace")
        elif one.kind == PARAMETERS:
            log.parameter_sets.append(_parameters_of(path, one, log.count))
        elif one.kind == TRUTH:
            _add_truth(path, one, log.truth)
        elif one.kind == HEAD:
            log.head = _json_of(path, one)
        elif one.kind == DONE:
            log.done = _json_of(path, one)
    if not log.head and not log.parameter_sets and not log.count:
        raise UsageError(f"{path} holds no whole block: nothing was recorded; record again")
    return log


def _blocks_of(path: Path) -> Iterator[Frames]:
    """The frames of the whole blocks. A log that grows meanwhile gives what was added, too."""
    for one in read_blocks(path, MAGIC, ADVICE):
        if isinstance(one, Block) and one.kind == FRAMES:
            yield _frames_of(path, one)


def _frames_of(path: Path, block: Block) -> Frames:
    if len(block.payload) % FRAME.itemsize:
        raise _odd(path, block)
    frames = np.frombuffer(block.payload, FRAME)
    if (frames["length"] > 8).any():
        raise _odd(path, block)
    return frames


def _parameters_of(path: Path, block: Block, at: int) -> ParameterSet:
    said = _json_of(path, block)
    values, crc32 = said.get("values"), said.get("crc32")
    if not isinstance(values, dict) or any(type(value) is not int for value in values.values()):
        raise _odd(path, block)
    now = parameters.new_names()
    named = {now.get(name, name): int(value) for name, value in values.items()}
    return ParameterSet(at, named, crc32 if type(crc32) is int else None)


def _add_truth(path: Path, block: Block, truth: dict[str, list[tuple[int, float]]]) -> None:
    said = _json_of(path, block)
    times = said.pop("time_us", None)
    if not isinstance(times, list) or any(type(time_us) is not int or abs(time_us) >= 1 << 62 for time_us in times):
        raise _odd(path, block)
    for name, values in said.items():
        if name not in TRUE_PLACE or not isinstance(values, list) or len(values) != len(times):
            raise _odd(path, block)
        if any(type(value) is not float or not math.isfinite(value) for value in values):
            raise _odd(path, block)
        truth.setdefault(name, []).extend(zip(times, values, strict=True))


def _json_of(path: Path, block: Block) -> dict[str, object]:
    try:
        value = json.loads(block.payload.decode("utf-8"))
    except (ValueError, RecursionError):
        raise _odd(path, block) from None
    if not isinstance(value, dict):
        raise _odd(path, block)
    return value


def _odd(path: Path, block: Block) -> UsageError:
    return UsageError(f"{path}: the block at byte {block.offset} is whole, but is no {block.kind} of a log; {ADVICE}")
