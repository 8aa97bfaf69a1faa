"""Quantise a tuning to the words of plumb_params_t, each within 0.1 % of its setting, and back.

A setting that cannot be represented is refused with a reason. plumb.systems.NAME.quantise quantises a system's own
groups (`Quantiser` is its contract), `groups` those that systems share. A system declares in its system.toml which
groups it reads.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol

from plumb.errors import UsageError
from plumb.spec import declarations, parameters, system_parts
from plumb.spec.system import group_of
from plumb.spec.system_parts import Part
from plumb.spec.tuning import AnyTuning


@dataclass(frozen=True)
class Context:
    """Data that belong to a set of words and are not in them. scales: values of the units that the set chose, by name,
    to convert words back; link: parameters of the link's part that a host sends with the words."""

    scales: Mapping[str, float] = field(default_factory=dict)
    link: Mapping[str, int] = field(default_factory=dict)


NOTHING = Context()


@dataclass(frozen=True)
class ControlParams:
    """plumb_params_t as integers by name, in the order of the table. Groups that the system does not read have their
    defaults."""

    values: dict[str, int]
    context: Context = field(default=NOTHING, compare=False)

    @classmethod
    def from_words(cls, words: Sequence[int], context: Context = NOTHING) -> ControlParams:
        """From the words of the control part, signed or unsigned. Raises UsageError if their number is wrong or one is
        out of range."""
        whole = parameters.whole_table([int(word) & 0xFFFFFFFF for word in words])
        rows = [row for row in parameters.table() if row.owner == "control"]
        return cls({row.name: row.from_word(word) for row, word in zip(rows, whole, strict=False)}, context)

    @classmethod
    def of(cls, system: str, own: Mapping[str, int], context: Context = NOTHING) -> ControlParams:
        """From the words of the groups that the system reads. Raises UsageError if one is missing, unknown or out of
        range."""
        rows = [row for row in parameters.table() if row.owner == "control"]
        groups = groups_of(system)
        wanted = {row.name for row in rows if row.group in groups}
        if wanted != set(own):
            odd = ", ".join(sorted(wanted ^ set(own)))
            raise UsageError(f"{odd}: missing or unknown among the parameters that {system} reads")
        values = {row.name: own.get(row.name, row.default) for row in rows}
        for row in rows:
            parameters.check_range(row, values[row.name])
        return cls({**values, "system": declarations.system(system).number}, context)

    @property
    def system(self) -> str:
        """Name of the system."""
        return declarations.name_of(self.values["system"])

    def own(self) -> dict[str, int]:
        """The words of the groups that the system reads."""
        groups = groups_of(self.system)
        return {name: value for name, value in self.values.items() if group_of(name) in groups}

    def __getitem__(self, name: str) -> int:
        return self.values[name]

    def words(self) -> list[int]:
        """The integers in order, signed for rows of type int32."""
        return list(self.values.values())

    def crc32(self) -> int:
        """CRC-32 of the control part of the table."""
        return parameters.crc32(self.words())

    def wide(self, high: str, low: str) -> int:
        """The 64-bit integer of two words."""
        return self.values[high] * (1 << 32) + self.values[low]

    def link_words(self) -> dict[str, int]:
        """The parameters of the link's part that belong to these words, as keywords for Session.upload."""
        return {parameters.UNIT: 0, **self.context.link}

    @property
    def period_s(self) -> float:
        return parameters.period_s(self.system, self.values)


class Change(NamedTuple):
    """Other parameters of the same system, in use from a step of a run on."""

    step: int
    params: ControlParams


Changes = Sequence[Change]
"""The changes of a run in the order of their steps."""


class Quantiser(Protocol):
    """quantise.py: a system's tuning in engineering units as integers, and back."""

    def quantise(self, tuning: AnyTuning, /) -> ControlParams:
        """The integers of a tuning; raises UsageError with the parameter, its value and the limit."""

    def dequantise(self, params: ControlParams, /) -> AnyTuning:
        """The tuning in engineering units that the integers represent."""


QUANTISER = Part[Quantiser]("quantise", Quantiser)


def groups_of(system: str) -> tuple[str, ...]:
    """The parameter groups that a system reads."""
    return declarations.system(system).all_groups


def quantise(tuning: AnyTuning) -> ControlParams:
    """The integers of a tuning; raises UsageError with the parameter, its value and the limit."""
    return system_parts.load(tuning.system, QUANTISER).quantise(tuning)


def dequantise(params: ControlParams) -> AnyTuning:
    """The tuning in engineering units that the integers represent. The reference model runs on it, so that its distance
    to the integer model is that of the arithmetic alone."""
    return system_parts.load(params.system, QUANTISER).dequantise(params)
