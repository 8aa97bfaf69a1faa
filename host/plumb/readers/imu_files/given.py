"""What a user says of a table that its header does not: --units, --columns and --frame."""

from __future__ import annotations

import json
import re
import shlex
from dataclasses import asdict, dataclass, field

from plumb.errors import UsageError
from plumb.readers.imu_files.header_words import UNITS

COUNTS = {"time": 1, "gyr": 3, "acc": 3}
"""By quantity: its columns."""
SHOWN = {"time": ("s", "ms", "us", "ns"), "gyr": ("rad/s", "deg/s", "mdps"), "acc": ("m/s2", "g", "mg")}
"""By quantity: the units that a sentence names."""
PARTS = {"time": "1/100 s", "gyr": "1/131 deg/s", "acc": "1/16384 g"}
"""By quantity: how a count of it is said."""
COLUMNS_EXAMPLE = '--columns "time=t,gyr=wx wy wz,acc=ax ay az"'
_SCALED = re.compile(r"(?:([0-9.]+)(?:/([0-9.]+))? +)?(\S.*)")


@dataclass(frozen=True)
class Given:
    """By quantity: units, in its words; columns, the names of its columns. frame: a key of `frames.FRAMES`."""

    units: dict[str, str] = field(default_factory=dict)
    columns: dict[str, list[str]] = field(default_factory=dict)
    frame: str | None = None

    def factor(self, quantity: str) -> float | None:
        """To s, deg/s or g; None where no unit was given."""
        return unit_factor(quantity, self.units[quantity]) if quantity in self.units else None

    @property
    def text(self) -> str:
        return json.dumps(asdict(self))


def of_text(text: str) -> Given:
    """The inverse of `Given.text`."""
    return Given(**json.loads(text))


def parse(units: str | None, columns: str | None, frame: str | None) -> Given:
    """Of the options as typed; raises UsageError, which names the option."""
    found = Given(_parts(units or "", "--units"), frame=frame)
    for quantity, unit in found.units.items():
        unit_factor(quantity, unit)
    for quantity, names in _parts(columns or "", "--columns").items():
        try:
            found.columns[quantity] = shlex.split(names)
        except ValueError:
            raise UsageError(f"--columns: {names!r} has a quote that does not end") from None
        if len(found.columns[quantity]) != COUNTS[quantity]:
            raise UsageError(
                f"--columns: {quantity} has {COUNTS[quantity]} of them, not {len(found.columns[quantity])}, as in "
                f"{COLUMNS_EXAMPLE}; a name with spaces stands in single quotes"
            )
    return found


def unit_factor(quantity: str, unit: str) -> float:
    """Factor to s, deg/s or g of a unit, perhaps behind a number or a fraction, as `1/131 deg/s`; raises UsageError."""
    found = _SCALED.fullmatch(unit)
    known = UNITS[quantity].get(found[3].lower()) if found else None
    try:
        factor = float(found[1] or 1) / float(found[2] or 1) if found else 0.0
    except (ValueError, ZeroDivisionError):
        factor = 0.0
    if known is None or not 0.0 < factor < float("inf"):
        raise UsageError(
            f"--units: {unit!r} is no unit of {quantity}; it has {', '.join(SHOWN[quantity])}, and a number before it "
            f"is that of one count, as in '1/131 deg/s'"
        )
    return factor * known


def _parts(text: str, option: str) -> dict[str, str]:
    """`time=a,gyr=b c d` by quantity."""
    found: dict[str, str] = {}
    for part in re.split(r",(?=\s*\w+\s*=)", text) if text.strip() else []:
        name, equals, value = part.partition("=")
        name = name.strip().lower()
        if not equals or name not in COUNTS or not value.strip() or name in found:
            example = '--units "gyr=rad/s,acc=m/s2,time=us"' if option == "--units" else COLUMNS_EXAMPLE
            raise UsageError(f"{option}: {part.strip()!r} is not time=, gyr= or acc= once each, as in {example}")
        found[name] = value.strip()
    return found
