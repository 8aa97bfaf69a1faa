"""Chips with a gyro, an accelerometer or both, as chips/NAME.toml declares them: the tables of the firmware, the
simulated chips, the drawings of the wiring and the calibrations are made from these.

    title, sheet     what people call the chip, and where its facts are from
    modules          names that modules with the chip are sold by
    address          on I2C, 7 bits; missing for a chip that is wired to SPI alone
    spi_khz          the fastest clock for every register on SPI; missing for a chip without SPI
    spi_many         a read of several bytes on SPI wants bit 6 of the command
    data             first register of a sample
    low_byte_first   of a count
    rail             a count of at least this size is at the rail; 32767 by default
    option_first     the least option (output rate, low-pass) that the board takes
    identities       of a chip that has several: name and value of the register that `known` reads
    set_up           register accesses in order: what is done, register, mask, value, meaning. The first checks the
                     identity, the last awaits a sample. `check`: the register, masked, must hold the value; `known`:
                     one of the identities; `write`; `option`: write the value with the option or-ed in; `await`: as
                     `check`, for up to 200 ms. Bits of the mask are read again in turn while the chip is sampled; 0:
                     not read again
    wired            how it may be wired: `number`, the value of the parameter accel_bus, `bus`, and of an
                     accelerometer `gyro`, the chip on I2C that serves beside it
    module           of a chip with both sensors on SPI: its terminals, and the pins they are wired to
    [gyro], [accel]  at: place in a sample, in bytes; counts_per_unit: per deg/s, per g; option_hz: bandwidth for each
                     option, with sampled = true output rate; noise: least at rest, rms, behind noise_hz, of the sensor
                     or each axis; or noise_density, per sqrt(Hz), up to noise_hz if there is one
    [invensense]     what the simulated chip of that family has of its own: power_on, registers that do not start at 0;
                     spi_alone, register and bits that switch I2C off; accel_filter, a low-pass register of the
                     accelerometer
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from typing import Any

from plumb.errors import UsageError
from plumb.spec.imu_limits import Still, limits

FOLDER = Path(__file__).with_name("chips")
ACTIONS = ("check", "known", "write", "option", "await")
PCLK2_KHZ = 72000
WIRES_KHZ = 4500
"""The fastest clock on SPI that wires laid by hand are trusted with."""


@dataclass(frozen=True)
class Step:
    """A register access of a set-up."""

    does: str
    register: int
    mask: int
    value: int
    doc: str


@dataclass(frozen=True)
class Sensor:
    """Gyro or accelerometer of a chip. counts_per_unit: per deg/s, per g. noise_counts, apart_s: by option, from
    option_first on: least noise at rest of each axis, rms, and the time between readings that do not know of each
    other."""

    at: int
    counts_per_unit: float
    option_hz: tuple[float, ...]
    noise_counts: tuple[tuple[float, ...], ...]
    apart_s: tuple[float, ...]

    @cached_property
    def still(self) -> tuple[Still, ...]:
        """By option: how long counts may stand still. Found when first asked for, which most commands never do: it
        takes longer than to read all declarations of the systems."""
        return tuple(limits(noise, apart_s) for noise, apart_s in zip(self.noise_counts, self.apart_s, strict=True))


@dataclass(frozen=True)
class Chip:
    """A declared chip; the entries are those of its file."""

    name: str
    title: str
    sheet: str
    modules: tuple[str, ...]
    address: int | None
    spi_khz: int
    spi_many: bool
    data: int
    low_byte_first: bool
    rail: int
    option_first: int
    identities: Mapping[str, int]
    set_up: tuple[Step, ...]
    module: tuple[tuple[str, str], ...]
    gyro: Sensor | None
    accel: Sensor | None
    invensense: Mapping[str, Any]  # Any: an entry of TOML

    @property
    def both(self) -> bool:
        """True for a chip with both sensors."""
        return self.gyro is not None and self.accel is not None

    @property
    def scales(self) -> tuple[float | None, ...]:
        """Counts per deg/s and per g, and the count at the rail: what a calibration by the data sheet takes."""
        return (*(sensor.counts_per_unit if sensor else None for sensor in (self.gyro, self.accel)), self.rail)

    @property
    def data_bytes(self) -> int:
        """Of a sample, from its first register to the last count."""
        return max(sensor.at for sensor in (self.gyro, self.accel) if sensor) + 6


@dataclass(frozen=True)
class Wired:
    """How gyro and accelerometer are wired: a value of the parameter accel_bus. gyro, accel: chips, the same one where
    it has both. bus: of the accelerometer; a gyro in a chip of its own is on I2C."""

    number: int
    gyro: Chip
    accel: Chip
    bus: str

    @property
    def text(self) -> str:
        """For people."""
        if self.gyro is self.accel:
            return f"{self.gyro.title} on {self.bus}"
        return f"{self.accel.title} on {self.bus}, {self.gyro.title} on I2C"

    @property
    def spi_divider_log2(self) -> int:
        """SPI's clock is PCLK2 divided by 2 to this power."""
        if self.bus != "SPI":
            return 1
        return math.ceil(math.log2(PCLK2_KHZ / min(self.accel.spi_khz, WIRES_KHZ)))


def _noise(given: Mapping[str, Any], hz: float, counts: float) -> tuple[float, ...]:  # Any: an entry of TOML
    """Least noise of each axis at rest with this bandwidth, in counts rms."""
    limit_hz = given.get("noise_hz", math.inf)
    if "noise_density" in given:
        return (counts * given["noise_density"] * math.sqrt(min(hz, limit_hz)),) * 3
    noise = given["noise"]
    axes = tuple(noise) if isinstance(noise, list) else (noise,) * 3
    return tuple(counts * sigma * min(1.0, math.sqrt(hz / limit_hz)) for sigma in axes)


def _sensor(given: Mapping[str, Any]) -> Sensor:  # Any: an entry of TOML
    counts, options = given["counts_per_unit"], tuple(given["option_hz"])
    apart = 1.0 if given.get("sampled") else 0.5  # of a period: readings of an output rate, of a bandwidth
    noise_counts = tuple(_noise(given, hz, counts) for hz in options)
    return Sensor(given["at"], counts, options, noise_counts, tuple(apart / hz for hz in options))


def _chip(name: str, given: dict[str, Any]) -> Chip:  # Any: an entry of TOML
    steps = tuple(Step(*step) for step in given["set_up"])
    unknown = [step.does for step in steps if step.does not in ACTIONS]
    if unknown or steps[0].does not in ("check", "known") or steps[-1].does != "await":
        raise ValueError("set_up begins with check or known, ends with await, and has only " + ", ".join(ACTIONS))
    sensors = {which: _sensor(given[which]) if which in given else None for which in ("gyro", "accel")}
    return Chip(
        name=name,
        title=given["title"],
        sheet=given["sheet"],
        modules=tuple(given["modules"]),
        address=given.get("address"),
        spi_khz=given.get("spi_khz", 0),
        spi_many=given.get("spi_many", False),
        data=given["data"],
        low_byte_first=given.get("low_byte_first", False),
        rail=given.get("rail", 32767),
        option_first=given["option_first"],
        identities=given.get("identities", {}),
        set_up=steps,
        module=tuple((label, pin) for label, pin in given.get("module", ())),
        gyro=sensors["gyro"],
        accel=sensors["accel"],
        invensense=given.get("invensense", {}),
    )


@cache
def _declared() -> tuple[dict[str, Chip], tuple[Wired, ...]]:
    chips, tables = {}, {}
    for path in sorted(FOLDER.glob("*.toml")):
        try:
            tables[path.stem] = tomllib.loads(path.read_text(encoding="utf-8"))
            chips[path.stem] = _chip(path.stem, tables[path.stem])
        except (KeyError, TypeError, ValueError, tomllib.TOMLDecodeError) as error:
            raise UsageError(f"{path}: {error}; plumb.spec.imu_chips explains the entries") from None
    wired = [
        Wired(way["number"], chips[way.get("gyro", name)], chips[name], way["bus"])
        for name, table in tables.items()
        for way in table.get("wired", ())
    ]
    wired.sort(key=lambda way: way.number)
    if [way.number for way in wired] != list(range(len(wired))):
        raise UsageError(f"{FOLDER}: the numbers in `wired` are not 0 to {len(wired) - 1}, each once")
    return chips, tuple(wired)


def chips() -> dict[str, Chip]:
    """The chips by name. Raises UsageError for a declaration that is wrong."""
    return _declared()[0]


def ways() -> tuple[Wired, ...]:
    """How the sensors may be wired, in the order of accel_bus."""
    return _declared()[1]


def one_chip(name: str) -> Wired:
    """How the chip with both sensors is wired."""
    return next(way for way in ways() if way.gyro is way.accel is chips()[name])


def ways_text() -> str:
    """The values of accel_bus, for its row in the table of parameters."""
    return ", ".join(f"{way.number} {way.text}" for way in ways())
