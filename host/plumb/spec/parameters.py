"""The parameter table: every 32-bit word that a run depends on, by number, with limits as integers.

`parameters.toml` declares the parameters that systems share and those of the link; each system declares its own
(`plumb.spec.declarations`). The firmware's table is generated from them, and the host checks values against them.
`plumb.contract.parameters` computes the integers of a tuning in engineering units.
"""

from __future__ import annotations

import binascii
import struct
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

from plumb.errors import UsageError
from plumb.spec import declarations, imu_chips, settings
from plumb.spec.settings import Setting
from plumb.spec.speed_controllers import GAP_HALFUS, foreign_parameter
from plumb.spec.system import System, TomlTable, group_of

ERASED = 0xFFFF
"""The value of erased flash; no row may have it as its id."""


@dataclass(frozen=True)
class Parameter:
    """One row of the table: a 32-bit word.

    name: member of plumb_params_t, or of the link's part. owner: control or link. type: int32 or uint32. format: what
    the integer stands for. min, max, default: integers as the firmware holds them. was: former names, oldest first.
    live: may change during a run in real time; while armed, to twice or half of its value at arming.
    weakens: numbered promises (docs/explanation/security.md) that it can weaken; armed: least and largest value of an
    armed board, () where conditions of several words say it (`plumb.spec.armed_values`). harmless: why it can weaken
    none. part: of a row of the link, the part of a board that it sets up: images whose systems do not use that part
    (`System.parts`) do not hold the row. setting: the setting in engineering units that it holds, if it holds one.
    """

    name: str
    owner: str
    type: str
    unit: str
    format: str
    min: int
    max: int
    default: int
    doc: str
    was: tuple[str, ...] = ()
    live: bool = False
    weakens: tuple[int, ...] = ()
    armed: tuple[int, ...] = ()
    harmless: str = ""
    part: str = ""
    setting: Setting | None = None

    @property
    def id(self) -> int:
        """CRC-16 of the oldest name (polynomial 0x1021, initial value 0xFFFF): stays when the row moves or is
        renamed."""
        return binascii.crc_hqx((*self.was, self.name)[0].encode(), 0xFFFF)

    @property
    def group(self) -> str:
        """What decides whether an image holds the row: the group, a member of plumb_params_t, `kalman` of kalman.qb; or
        the part of a board; "" for a row that every image holds."""
        return self.part or group_of(self.name)

    def out_of_range(self, value: int) -> str:
        """Error text for a value outside the range, without a full stop."""
        if value.bit_length() > 64:
            return f"{self.name} = {hex(value)[:10]}.. is outside {self.min} to {self.max}"
        foreign = foreign_parameter(self.name, value)
        return f"{self.name} = {value} is outside {self.min} to {self.max}" + (f": {foreign}" if foreign else "")

    def from_word(self, word: int) -> int:
        """The value of a received 32-bit word: two's complement for int32."""
        return word - (1 << 32) if self.type == "int32" and word & 0x80000000 else word


def _system_row() -> Parameter:
    """The first word of the table: the number of the system in use."""
    numbers = {system.number: system.name for system in declarations.systems().values()}
    doc = "which system the step is of: " + ", ".join(f"{number} {name}" for number, name in numbers.items())
    harmless = "which step runs; every system that drives something is checked alike"
    return Parameter("system", "control", "uint32", "", "choice", 0, max(numbers), min(numbers), doc, harmless=harmless)


def _row(given: TomlTable) -> Parameter:
    """A declared row. The text of a calibration row also names the channels that it calibrates, for each system."""
    setting = given.get("setting")
    if setting is not None and not isinstance(setting, Setting):
        setting = settings.read(setting, given["doc"])
    lists = {key: tuple(given.get(key, ())) for key in ("was", "weakens", "armed")}
    row = Parameter(**{**given, **lists, "setting": setting})
    if row.name == "accel_bus":
        ways = imu_chips.ways()
        return replace(row, max=len(ways) - 1, doc=f"{row.doc}: {imu_chips.ways_text()}")
    calibrated = {
        name: ", ".join(channel.name for channel in system.channels if channel.calibration == row.group)
        for name, system in declarations.systems().items()
        if row.group
    }
    channels = "; ".join(f"{system} {names}" for system, names in calibrated.items() if names)
    return replace(row, doc=f"{row.doc} ({channels})") if channels else row


def _own_row(given: TomlTable, system: System) -> Parameter:
    row = _row(given)
    return row if row.weakens or row.harmless else replace(row, harmless=f"{system.name} drives nothing")


def shared_rows() -> list[Parameter]:
    """The rows of parameters.toml: of shared groups, and of the link."""
    return [_row(row) for row in declarations.shared()["parameter"]]


def load() -> tuple[Parameter, ...]:
    """The rows in order: system, shared groups, groups of the systems in the order of their names, link. Raises
    UsageError for an invalid row."""
    given = shared_rows()
    own = [_own_row(row, system) for _, system in sorted(declarations.systems().items()) for row in system.parameters]
    control = [_system_row(), *(row for row in given if row.owner == "control"), *own]
    rows = (*control, *(row for row in given if row.owner == "link"))
    check(rows)
    return rows


def check(rows: Sequence[Parameter]) -> None:
    """Raises UsageError for a row with an invalid range, type or owner, and for names or ids that collide."""
    for row in rows:
        if row.live and row.type != "int32":
            raise UsageError(f"parameter {row.name}: a live one is an int32")
        low, high = (-(1 << 31), (1 << 31) - 1) if row.type == "int32" else (0, (1 << 32) - 1)
        if row.type not in ("int32", "uint32") or not low <= row.min <= row.default <= row.max <= high:
            raise UsageError(f"parameter {row.name}: not {low} <= min <= default <= max <= {high}")
        if row.owner not in ("control", "link"):
            raise UsageError(f"parameter {row.name}: the owner is control or link")
    names = [name for row in rows for name in (row.name, *row.was)]
    if len(set(names)) != len(names):
        raise UsageError("two parameters have the same name, or one that another had before")
    if len({row.id for row in rows} | {ERASED}) != len(rows) + 1:
        raise UsageError("the names of two parameters have the same CRC-16, or it is that of erased flash; rename one")


WIRING = ("pins", "dead_time_ns", "can_bitrate_kbit", "receiver", "battery_min_mv", "battery_full_mv", "battery_full_a")
"""Parameters that describe the wiring of a board. An upload leaves them as the board has them."""


@lru_cache(maxsize=1)
def table() -> tuple[Parameter, ...]:
    """The table of this version."""
    return load()


@lru_cache(maxsize=1)
def new_names() -> Mapping[str, str]:
    """Former name -> present name."""
    return {old: row.name for row in table() for old in row.was}


def crc32(words: Sequence[int]) -> int:
    """CRC-32 of the whole table, as a commit carries it. Words may be signed or unsigned; each is taken modulo 2^32."""
    return zlib.crc32(struct.pack(f"<{len(words)}I", *(word & 0xFFFFFFFF for word in words)))


_AT_MOST = (
    ("gyro.raw_min", "gyro.raw_max"),
    ("accel.raw_min", "accel.raw_max"),
    ("accel_up.raw_min", "accel_up.raw_max"),
    ("tilt.r_base", "tilt.r_max"),
    ("esc.neutral_halfus", "esc.min_halfus"),
    ("esc.min_halfus", "esc.mid_halfus"),
    ("esc.mid_halfus", "esc.max_halfus"),
)
"""Pairs (a, b) with a <= b."""


SCAN_US = 50
"""Duration of one scan of the analogue inputs in us: BOARD_SCAN_US of firmware/app/board_sensors.h."""


def contradiction(words: Sequence[int]) -> str | None:
    """Error text for the first pair of values that contradict each other, as the board checks; None if there is
    none."""
    values = {row.name: row.from_word(word & 0xFFFFFFFF) for row, word in zip(table(), words, strict=True)}
    for low, high in _AT_MOST:
        if values[low] > values[high]:
            return f"{low} = {values[low]} is more than {high} = {values[high]}"
    frame_halfus, longest = 2 * values["esc_period_us"], values["esc.max_halfus"]
    if longest + GAP_HALFUS > frame_halfus:
        return (
            f"esc.max_halfus = {longest} leaves less than {GAP_HALFUS // 2} us of esc_period_us = {frame_halfus // 2}"
        )
    scans_us = SCAN_US << values["adc_oversample_log2"]
    if scans_us > values["period_us"]:
        return f"adc_oversample_log2 = {values['adc_oversample_log2']} takes {scans_us} us of every period_us"
    return None


def period_s(system: str, values: Mapping[str, int]) -> float:
    """Period of a step in s, from the system's period parameter. values: the table, or its control part, by name."""
    name = declarations.system(system).period
    row = next(row for row in table() if row.name == name)
    return values[name] / 2.0 ** int(row.format[1:])


def period_s_q33(system: str, values: Mapping[str, int]) -> int:
    """The same in s Q33, as the checks of an output take it."""
    name = declarations.system(system).period
    row = next(row for row in table() if row.name == name)
    return (values[name] << 33) >> int(row.format[1:])


UNIT = "variance_turn2_q56"
"""Parameter of the link's part that holds the unit of variance of the control part; the host writes both together."""


def whole_table(control_words: Sequence[int], **link_words: int) -> list[int]:
    """Every word of the table in order: the control part, then the link's part from link_words, else its defaults.

    variance_turn2_q56 becomes 0 (unknown) if it is not in link_words and the control part is not the default one.
    Raises UsageError if the number of words is wrong, a name is unknown, or a value is out of range.
    """
    rows = table()
    control = [row for row in rows if row.owner == "control"]
    link = [row for row in rows if row.owner == "link"]
    if len(control_words) != len(control):
        raise UsageError(f"the control part has {len(control)} words, not {len(control_words)}")
    unknown = sorted(set(link_words) - {row.name for row in link})
    if unknown:
        raise UsageError(f"there is no parameter '{unknown[0]}'; the link's are {', '.join(row.name for row in link)}")
    ours = [row.default & 0xFFFFFFFF for row in control] == [int(word) & 0xFFFFFFFF for word in control_words]
    if not ours and UNIT not in link_words:  # the default is that of the default control part
        link_words = {**link_words, UNIT: 0}
    words = [int(word) for word in control_words] + [link_words.get(row.name, row.default) for row in link]
    for row, word in zip(rows, words, strict=True):
        check_range(row, row.from_word(word & 0xFFFFFFFF))
    return words


def refused_while_armed(
    before: Mapping[str, int], after: Mapping[str, int], at_arming: Mapping[str, int] | None = None
) -> list[Parameter]:
    """The rows whose change an armed board refuses: all but live ones, and of those a change to more than twice or less
    than half of what they were at arming, to or from zero, and of the sign. at_arming: None for the table in use."""
    first = before if at_arming is None else at_arming
    return [row for row in table() if before[row.name] != after[row.name] and not _near(row, first, after)]


def _near(row: Parameter, before: Mapping[str, int], after: Mapping[str, int]) -> bool:
    old, new = before[row.name], after[row.name]
    return row.live and old * new > 0 and abs(old) <= 2 * abs(new) and abs(new) <= 2 * abs(old)


def check_range(row: Parameter, value: int) -> None:
    """Raises UsageError for a value outside the range of the row."""
    if not row.min <= value <= row.max:
        raise UsageError(f"parameter {row.out_of_range(value)}")


def control_part(words: Sequence[int]) -> list[int]:
    """The control part of a whole table."""
    return [word for row, word in zip(table(), words, strict=True) if row.owner == "control"]
