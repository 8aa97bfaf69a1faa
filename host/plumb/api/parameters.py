"""`board.params`: the parameters of a board in engineering units, by the names of its tuning."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from plumb.api.kept_parameters import KeptParameters
from plumb.api.parameter_limits import float_limits, int_limits
from plumb.boards.native import core as native_core
from plumb.contract.parameters import quantise
from plumb.errors import UsageError
from plumb.link import parameter_table
from plumb.link.session import Session
from plumb.spec import parameters
from plumb.spec.parameter_file import by_name
from plumb.spec.tuning import AnyTuning
from plumb.tuning import quantities
from plumb.tuning.quantities import Value


@dataclass(frozen=True)
class ParameterDescription:
    """Description of a parameter.

    Attributes:
        name: Its whole name, as `pid.kp_per_deg`.
        alias: A shorter name for it, without the unit, as `pid.kp`; the name itself where that is not unique.
        unit: Its unit; "1" for a pure number, "choice" for one of a few names.
        value: Its value on the board, in the unit.
        min, max: The smallest and the largest value that the board takes while the other parameters are as they are,
            in the unit, exactly as its integers hold them; infinite where 1e12 is taken, too; None for choices.
        meaning: What it is for.
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

    Every write commits the whole table: the board takes it as a whole, or refuses it. A run in real time goes on if
    only gains of controllers change (`pid.kp`, `pid.ki`, `pid.kd`), from one step to the next and without a jump; any
    other write ends a run that is on. An armed board is never disarmed by a write: it takes gains alone, each to at
    most twice and at least half of what it was at arming, and refuses the rest. A write lasts until the board is reset;
    `save` keeps it.
    """

    def __init__(self, session: Session) -> None:
        self._session = session

    def move_to(self, session: Session) -> None:
        """Read and write over this session from here on: the board was lost, and is back."""
        self._session = session

    # ---- reading ----

    def __getitem__(self, name: str) -> Value:
        """Value in the unit of the name, as the board's integers have it: within 0.1 % of what was written.

        Raises:
            UsageError: A name that there is not, with the nearest names.
            LinkError: The board does not answer.
        """
        table = self._table()
        return quantities.values_of(table)[_known(name, table)]

    def __iter__(self) -> Iterator[str]:
        return iter(quantities.values_of(self._table()))

    def __len__(self) -> int:
        return len(quantities.values_of(self._table()))

    def __contains__(self, name: object) -> bool:
        try:
            return isinstance(name, str) and bool(_known(name, self._table()))
        except UsageError:
            return False

    def __repr__(self) -> str:
        return f"<Parameters of {self.system}>"

    @property
    def system(self) -> str:
        """Name of the system that the board runs."""
        return self._session.system

    def read(self) -> dict[str, Value]:
        """All parameters by their whole names, with one transfer. Raises LinkError when the board does not answer."""
        return quantities.values_of(self._table())

    @property
    def tuning(self) -> AnyTuning:
        """All parameters of the control step, as the tuning object that `plumb.run` and `plumb.Estimator` take."""
        return quantities.tuning_of(self._table())

    @property
    def words(self) -> dict[str, int]:
        """The integers of the whole table, by the names that `plumb params` shows."""
        return self._table()

    def read_words(self) -> list[int]:
        """The integers of the whole table in its order, with those that this version has no name for. Raises
        LinkError."""
        return parameter_table.read_table(self._session)

    @property
    def kept(self) -> KeptParameters:
        """The board's parameters as kept on this computer: changes that were made from here, and profiles."""
        return KeptParameters((self._session.identity or self._session.connect()).unique_id)

    def describe(self, name: str) -> ParameterDescription:
        """Unit, value, limits and meaning of a parameter.

        Args:
            name: Its name, with or without the unit.

        Raises:
            UsageError: A name that there is not, with the nearest names.
            LinkError: The board does not answer.
        """
        return description(name, self._table())

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
                or one that it does not take while armed, with the nearest one that it takes. Nothing is changed then.
            LinkError: The board does not answer, has other definitions, or is armed over its other link.
        """
        if not isinstance(values, Mapping):
            raise UsageError(f"{values!r:.40}: give a dictionary of name and value")
        self._session.require_match()
        table = self._table()
        wanted = {_known(name, table): value for name, value in values.items()}
        self._session.pump()  # an armed board waits for its keep-alive
        self.write_words(quantities.changed(table, wanted), table)

    def write_words(self, words: Mapping[str, int], before: Mapping[str, int] | None = None) -> None:
        """Write the integers of the whole table with one commit.

        Args:
            words: Every integer by its name, as `words` gives them. Nothing keeps those that belong together in step.
            before: The table in use, where it has just been read.

        Raises:
            UsageError: The board is armed and takes no such change.
            LinkError: The board does not answer, has other definitions, or is armed over its other link.
        """
        self._session.require_match()
        self._session.pump()
        parameter_table.commit(self._session, words, before)

    def load(self) -> None:
        """Take the parameters that are saved in the board's flash. Raises as `save`."""
        self._session.execute_idle("LOAD", keep_armed=True)

    def reset(self) -> None:
        """Take the factory values. Raises as `save`."""
        self._session.execute_idle("DEFAULTS", keep_armed=True)

    def save(self) -> None:
        """Write the parameters in use to the board's flash, which it loads at every start.

        Raises:
            UsageError: The board is armed, and writing its flash would end the run.
            LinkError: The board does not answer, or its flash takes nothing.
        """
        self._session.execute_idle("SAVE", keep_armed=True)

    def _table(self) -> dict[str, int]:
        return by_name(self.read_words())


def _known(name: str, table: Mapping[str, int]) -> str:
    """The whole name; raises UsageError with the nearest names."""
    return quantities.find(name, quantities.quantities_of(table)).name


def description(name: str, table: Mapping[str, int]) -> ParameterDescription:
    """`Parameters.describe` for a table by name, as a board has it."""
    one = quantities.find(name, quantities.quantities_of(table))
    low, high = _limits(one.name, table)
    words = tuple(row.name for row in quantities.rows_of(one.name, table))
    value = quantities.values_of(table)[one.name]
    return ParameterDescription(one.name, one.alias, one.unit, value, low, high, one.meaning, words)


def _limits(name: str, table: Mapping[str, int]) -> tuple[float | int | None, float | int | None]:
    """The smallest and the largest value that `quantities.changed` and the board accept; None for choices."""
    value = quantities.values_of(table)[name]
    if isinstance(value, str):
        return None, None

    tuning = quantities.tuning_of(table)
    row = quantities.link_row(name)

    def held(candidate: float | int) -> float | int | None:
        try:
            if row is None:
                quantised = quantise(quantities.with_value(tuning, name, candidate))
                new = {**table, **quantised.own(), **quantised.link_words()}
            else:
                new = quantities.changed(table, {name: candidate})
            params = quantities.control_of(new)
            for one in parameters.table():
                parameters.check_range(one, new[one.name])
            words = [new[one.name] for one in parameters.table()]
            if parameters.contradiction(words) is not None or not native_core.params_valid(params):
                return None
            found = new[name] if row is not None else quantities.value_in(quantities.tuning_of(new), name)
        except UsageError:
            return None
        return None if isinstance(found, str) else found

    if not isinstance(value, int):
        return float_limits(value, held)
    low, high = (row.min, row.max) if row is not None else (-(1 << 31), (1 << 31) - 1)
    return int_limits(value, low, high, held)
