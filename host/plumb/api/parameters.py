"""`board.params`: the parameters of a board in engineering units, by the names of its tuning."""

from __future__ import annotations

import difflib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any

from plumb.api.parameter_limits import float_limits, int_limits
from plumb.boards import native_core
from plumb.errors import UsageError
from plumb.link import parameter_table
from plumb.link.session import Session
from plumb.spec import parameters
from plumb.spec.parameter_file import by_name
from plumb.spec.parameters import Parameter
from plumb.spec.tuning import AnyTuning
from plumb.tuning.quantise import ControlParams, dequantise, quantise

Value = float | int | str

_UNITS = {
    "per_deg_s": "1/(deg s)",
    "deg2_per_s": "deg^2/s",
    "dps2_per_s": "(deg/s)^2/s",
    "deg_per_mps": "deg/(m/s)",
    "deg_per_m": "deg/m",
    "deg_per_g": "deg/g",
    "unit_per_count": "1/count",
    "per_deg": "1/deg",
    "per_dps": "1/(deg/s)",
    "per_s": "1/s",
    "counts": "count",
    "deg2": "deg^2",
    "dps2": "deg/s^2",
    "mps": "m/s",
    "dps": "deg/s",
    "deg": "deg",
    "us": "us",
    "s": "s",
    "m": "m",
}
"""End of a name of a tuning -> its unit; the first that fits."""
_VARIANCES = ("p00_", "p01_", "p11_")
_OF_CALIBRATION = {"gyro": "deg/s", "angular": "deg/s^2", "accel": "g", "accel_up": "g"}
"""Channel -> what its unit_per_count counts in."""
LARGEST = 1 << 64
"""More than any integer parameter holds."""
NUDGE = 1.07
"""A value times this has other integers, whatever its resolution."""


@dataclass(frozen=True)
class ParameterDescription:
    """What a parameter is.

    Attributes:
        name: Its whole name, as `pid.kp_per_deg`.
        alias: A shorter name for it, without the unit, as `pid.kp`; the name itself where that is not unique.
        unit: Its unit; empty for pure numbers and choices.
        value: Its value on the board, in the unit.
        min, max: The smallest and the largest value that the board takes while the other parameters are as they are,
            in the unit, exactly as its integers hold them; infinite where 1e12 is taken, too; None for choices.
        meaning: What it is for: the text of the words that hold it.
        words: The integers of the board's table that hold it.
    """

    name: str
    alias: str
    unit: str
    value: Value
    min: float | int | None
    max: float | int | None
    meaning: str
    words: tuple[str, ...]


class Parameters(Mapping[str, Value]):
    """The parameters of a board in units: a mapping of name -> value that reads and writes the board.

    Names are those of the tuning of the board's system, with the unit at the end (`pid.kp_per_deg`,
    `kalman.q_angle_deg2_per_s`, `esc.max_us`), or the same without the unit where that is unique (`pid.kp`,
    `kalman.q_angle`), and those of the link's part of the table (`arm_hold_ms`). `period_us` is the period of a step,
    for the filter and for the timer of the board.

    Every write commits the whole table: the board takes it as a whole, or refuses it. A write disarms the board and
    ends a run that is on, and lasts until the board is reset; `save` keeps it.
    """

    def __init__(self, session: Session) -> None:
        self._session = session

    # ---- reading ----

    def __getitem__(self, name: str) -> Value:
        """Value in the unit of the name, as the board's integers have it: within 0.1 % of what was written.

        Raises:
            UsageError: A name that there is not, with the nearest names.
            LinkError: The board does not answer.
        """
        table = self._table()
        return _values(table)[_known(name, table)]

    def __iter__(self) -> Iterator[str]:
        return iter(_values(self._table()))

    def __len__(self) -> int:
        return len(_values(self._table()))

    def __contains__(self, name: object) -> bool:
        table = self._table()
        return isinstance(name, str) and (name in _values(table) or name in _aliases(table))

    def __repr__(self) -> str:
        return f"<Parameters of {self.system}>"

    @property
    def system(self) -> str:
        """Name of the system that the board runs."""
        return self._session.system

    def read(self) -> dict[str, Value]:
        """All parameters by their whole names, with one transfer. Raises LinkError when the board does not answer."""
        return _values(self._table())

    @property
    def tuning(self) -> AnyTuning:
        """All parameters of the control step, as the tuning object that `plumb.run` and `plumb.Estimator` take."""
        return dequantise(_control(self._table()))

    @property
    def words(self) -> dict[str, int]:
        """The integers of the whole table, by the names that `plumb params` shows."""
        return self._table()

    def describe(self, name: str) -> ParameterDescription:
        """Unit, value, limits and meaning of a parameter.

        Args:
            name: Its name, with or without the unit.

        Raises:
            UsageError: A name that there is not, with the nearest names.
            LinkError: The board does not answer.
        """
        table = self._table()
        whole = _known(name, table)
        aliases = {full: short for short, full in _aliases(table).items()}
        rows = _rows_of(whole, table)
        text = "; ".join(dict.fromkeys(row.doc for row in rows))
        unit = rows[0].unit if _is_link(whole) else _unit(whole)
        alias = aliases.get(whole, whole)
        low, high = _limits(whole, table)
        words = tuple(row.name for row in rows)
        return ParameterDescription(whole, alias, unit, _values(table)[whole], low, high, text, words)

    # ---- writing ----

    def __setitem__(self, name: str, value: Value) -> None:
        """Write one parameter; see `update`."""
        self.update({name: value})

    def update(self, values: Mapping[str, Value]) -> None:
        """Write several parameters with one commit.

        Args:
            values: Name, with or without the unit, -> value in the unit.

        Raises:
            UsageError: A name that there is not, or a value that the board could not hold within 0.1 %, with the limit;
                nothing is changed then.
            LinkError: The board does not answer, or has other definitions.
        """
        if not isinstance(values, Mapping):
            raise UsageError(f"{values!r:.40}: give a dictionary of name and value")
        self._session.require_match()
        table = self._table()
        wanted = {_known(name, table): value for name, value in values.items()}
        parameter_table.commit(self._session, _changed(table, wanted))

    def save(self) -> None:
        """Write the parameters in use to the board's flash, which it loads at every start.

        Raises:
            LinkError: The board does not answer, or its flash takes nothing.
        """
        self._session.execute_idle("SAVE")

    def _table(self) -> dict[str, int]:
        return by_name(parameter_table.read_table(self._session))


def _is_link(name: str) -> bool:
    return any(row.name == name and row.owner == "link" for row in parameters.table())


def _link_rows() -> list[Parameter]:
    """Those that have a name of their own: not the unit of variance, which goes with the set."""
    return [row for row in parameters.table() if row.owner == "link" and row.name != parameters.UNIT]


def _control(table: Mapping[str, int]) -> ControlParams:
    words = [table[row.name] for row in parameters.table() if row.owner == "control"]
    unit_deg2 = table[parameters.UNIT] / 2.0**56 * 360.0**2 / 2.0**32
    if not unit_deg2 and any(row.unit.endswith("lsb") for row in _own_rows(ControlParams.from_words(words))):
        raise UsageError(
            "the board's parameters do not say their unit of variance: commit one with `plumb params tuning`"
        )
    return ControlParams.from_words(words, unit_deg2 or 1.0)


def _own_rows(params: ControlParams) -> list[Parameter]:
    own = params.own()
    return [row for row in parameters.table() if row.name in own]


def _flat(settings: Any, path: str = "") -> Iterator[tuple[str, Value]]:  # Any: a dataclass of any system's tuning
    for entry in fields(settings):
        value = getattr(settings, entry.name)
        if entry.name == "exact_period_s" or (not path and entry.name == "period_us"):
            continue  # period_us is the link's
        if is_dataclass(value):
            yield from _flat(value, f"{path}{entry.name}.")
        else:
            yield path + entry.name, value


def _with(settings: Any, path: str, value: Value) -> Any:  # Any: a dataclass of any system's tuning
    head, _, rest = path.partition(".")
    inner = _with(getattr(settings, head), rest, value) if rest else value
    return replace(settings, **{head: inner})


def _values(table: Mapping[str, int]) -> dict[str, Value]:
    """Every parameter by its whole name."""
    return {**dict(_flat(dequantise(_control(table)))), **{row.name: table[row.name] for row in _link_rows()}}


def _end(name: str) -> str:
    """The unit at the end of a name; empty where it has none."""
    last = name.rpartition(".")[2]
    return next((end for end in _UNITS if last.endswith(f"_{end}") or last == end), "")


def _unit(name: str) -> str:
    path, _, last = name.rpartition(".")
    channel = path.rpartition(".")[2]
    if last == "unit_per_count":
        return f"{_OF_CALIBRATION.get(channel, 'unit')} per count"
    if last.startswith(_VARIANCES):
        return {"p00_deg2": "deg^2", "p01_deg2_per_s": "deg^2/s", "p11_dps2": "(deg/s)^2"}[last]
    return _UNITS.get(_end(name), "")


def _aliases(table: Mapping[str, int]) -> dict[str, str]:
    """Name without the unit -> whole name, where that is unique and no name itself."""
    names = [name for name in _values(table) if not _is_link(name)]
    short = [name.removesuffix(f"_{end}") if (end := _end(name)) else name for name in names]
    return {
        alias: name
        for alias, name in zip(short, names, strict=True)
        if alias != name and short.count(alias) == 1 and alias not in names
    }


def _known(name: str, table: Mapping[str, int]) -> str:
    """The whole name; raises UsageError with the nearest names."""
    if not isinstance(name, str):
        raise UsageError(f"there is no parameter {name!r:.40}: a name is a text, such as pid.kp")
    names, aliases = list(_values(table)), _aliases(table)
    if name in names:
        return name
    if name in aliases:
        return aliases[name]
    every = [*names, *aliases]
    near = [other for other in every if name and name in other][:3] or difflib.get_close_matches(name, every, 3, 0.5)
    hint = f"did you mean {' or '.join(near)}?" if near else "list(board.params) names them all"
    if any(row.name == name for row in parameters.table()):
        hint = f"{name} is an integer of the table, which board.params.words shows; {hint}"
    raise UsageError(f"there is no parameter '{name}' in units; {hint}")


def _changed(table: Mapping[str, int], wanted: Mapping[str, Value]) -> dict[str, int]:
    """The whole table with these values; raises UsageError for one that cannot be."""
    params = _control(table)
    before = after = dequantise(params)
    link: dict[str, int] = {}
    for name, value in wanted.items():
        if isinstance(value, bool) or not isinstance(value, int | float | str):
            raise UsageError(
                f"{name} = {value!r:.40}: give a number{'' if _unit(name) else ', or the name of a choice'}"
            )
        if isinstance(value, int) and abs(value) > LARGEST:
            raise UsageError(f"{name}: no parameter is as large as a number of {value.bit_length()} bits")
        if not _is_link(name):
            if isinstance(value, str) is not isinstance(_values(table)[name], str):
                raise UsageError(f"{name} = {value!r:.40}: it is {_values(table)[name]!r} now, give something like it")
            after = _with(after, name, value)
            continue
        row = next(row for row in parameters.table() if row.name == name)
        if isinstance(value, str) or not float(value).is_integer():
            raise UsageError(f"{name} = {value}: give a whole number")
        parameters.check_range(row, int(value))
        link[name] = int(value)
    if "period_us" in link:
        after = replace(after, period_us=link["period_us"], exact_period_s=None)
    new = {**table, **link}
    if after != before:
        new |= _requantised(params, before, after)
    return new


def _limits(name: str, table: Mapping[str, int]) -> tuple[float | int | None, float | int | None]:
    """The smallest and the largest value that `_changed` and the board accept; None for choices."""
    value = _values(table)[name]
    if isinstance(value, str):
        return None, None

    tuning = dequantise(_control(table))
    row = next((row for row in _link_rows() if row.name == name), None)

    def held(candidate: float | int) -> float | int | None:
        try:
            if row is None:
                quantised = quantise(_with(tuning, name, candidate))
                new = {**table, **quantised.own(), **quantised.link_words()}
            else:
                new = _changed(table, {name: candidate})
            params = _control(new)
            for one in parameters.table():
                parameters.check_range(one, new[one.name])
            words = [new[one.name] for one in parameters.table()]
            if parameters.contradiction(words) is not None or not native_core.params_valid(params):
                return None
            found = new[name] if row is not None else dict(_flat(dequantise(params)))[name]
        except UsageError:
            return None
        return None if isinstance(found, str) else found

    if not isinstance(value, int):
        return float_limits(value, held)
    low, high = (row.min, row.max) if row is not None else (-(1 << 31), (1 << 31) - 1)
    return int_limits(value, low, high, held)


def _requantised(params: ControlParams, before: AnyTuning, after: AnyTuning) -> dict[str, int]:
    """The words of a changed tuning: only those that the change moves, so that rounding twice moves no others.
    Variances are counted in a unit of the whole set, and go together."""
    old, new = quantise(before), quantise(after)
    moved = {name for name, value in new.own().items() if old.own()[name] != value}
    of_variance = {row.name for row in _own_rows(new) if row.unit.endswith("lsb")}
    if old.own() == params.own() or moved & of_variance:
        return {**new.own(), **new.link_words()}
    return {name: new[name] for name in moved}


def _rows_of(name: str, table: Mapping[str, int]) -> list[Parameter]:
    """The rows of the table that hold a parameter: those whose meaning moves with it."""
    rows = {row.name: row for row in parameters.table()}
    if _is_link(name):
        return [rows[name]]
    params = _control(table)
    tuning = dequantise(params)
    value = _values(table)[name]
    old = quantise(tuning)
    for other in _others(name, value):
        try:
            new = quantise(_with(tuning, name, other))
        except UsageError:
            continue
        moved = [row for row in _own_rows(new) if _moves(row, old, new)]
        if moved:
            return moved
    return []


def _others(name: str, value: Value) -> list[Value]:
    if isinstance(value, str):
        return ["arcsine", "atan2", "previous", "current", "body", "euler", "data", "attitude", "printed"]
    if isinstance(value, int):
        return [value - 1, value + 1]
    return [value * NUDGE, value / NUDGE, value * 0.5, 1.0, 0.1, 1e-3, 1e-4]


def _moves(row: Parameter, old: ControlParams, new: ControlParams) -> bool:
    """Whether a word means something else; two words of one integer move together. Variances count in the unit of their
    set, and rounding moves them by less than 2 %."""
    a, b = _whole(row.name, old), _whole(row.name, new)
    if row.unit.endswith("lsb"):
        a, b = a * old.lsb_deg2, b * new.lsb_deg2
        return abs(a - b) > 0.02 * max(abs(a), abs(b))
    return a != b


def _whole(name: str, params: ControlParams) -> float:
    """The integer that a word is of: of 64 bits for a high and a low word, with its fraction where it has one."""
    for end in ("_hi", "_lo"):
        stem = name.removesuffix(end)
        if stem != name:
            return float(params.wide(f"{stem}_hi", f"{stem}_lo"))
    stem = name.removesuffix("_frac_q30")
    fraction = params.values.get(f"{stem}_frac_q30", 0)
    return params[stem] + fraction / 2.0**30
