"""Settings: the parameter table in units, by the names of a tuning."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import pytest

from plumb import systems
from plumb.contract.parameters import quantise
from plumb.errors import UsageError
from plumb.spec import declarations, parameters
from plumb.spec.system import group_of
from plumb.spec.tuning import NUMBER, Channel, quantity
from plumb.systems import shipped_tunings
from plumb.tuning import quantities

DEFAULTS = {row.name: row.default for row in parameters.table()}
QUAD = shipped_tunings.table_of("quad", None)
SHIPPED = [(name, tuning) for name in systems.SYSTEMS for tuning in systems.load(name).TUNINGS]


def moved(before: dict[str, int], after: dict[str, int]) -> set[str]:
    return {name for name in before if before[name] != after[name]}


@pytest.mark.parametrize("system", list(systems.SYSTEMS))
def test_every_quantity_has_a_unit_a_meaning_and_names_that_find_it(system: str) -> None:
    table = shipped_tunings.table_of(system, None)
    found = quantities.quantities_of(table)
    assert set(found) == set(quantities.values_of(table))
    for name, one in found.items():
        assert one.unit and one.meaning, name
        assert "unit" not in one.unit.split(), f"{name}: its group has no unit"
        assert quantities.find(one.alias, found) is quantities.find(name, found) is one


@pytest.mark.parametrize("system", list(systems.SYSTEMS))
def test_a_table_that_a_tuning_has_committed_is_read_in_units(system: str) -> None:
    """With the unit of variance as a host sends it: 0 for a system that has none."""
    module = systems.load(system)
    params = quantise(module.TUNINGS[module.DEFAULT_TUNING])
    assert quantities.values_of({**DEFAULTS, **params.values, **params.link_words()})["period_us"]


@pytest.mark.parametrize(("system", "tuning"), SHIPPED)
def test_a_shipped_tuning_differs_from_itself_in_nothing(system: str, tuning: str) -> None:
    origin = shipped_tunings.origin_of(shipped_tunings.table_of(system, tuning))
    assert (origin.system, origin.tuning, origin.differing) == (system, tuning, ())


def test_a_changed_table_still_comes_from_its_tuning() -> None:
    constant = shipped_tunings.table_of("quad", "constant")
    after = quantities.changed(constant, {"pid.kp_per_deg": 0.05, "arm_hold_ms": 5})
    origin = shipped_tunings.origin_of(after)
    assert (origin.tuning, origin.differing) == ("constant", ("pid.kp_per_deg", "arm_hold_ms"))


def test_the_recorded_tuning_goes_before_a_nearer_one_unless_that_is_equal() -> None:
    constant = shipped_tunings.table_of("quad", "constant")
    near = quantities.changed(constant, {"arm_hold_ms": 5})
    assert shipped_tunings.origin_of(near, "paper").tuning == "paper"
    assert shipped_tunings.origin_of(near, "no such tuning").tuning == "constant"
    assert shipped_tunings.origin_of(constant, "paper").tuning == "constant"


def test_one_quantity_moves_its_own_integers_alone() -> None:
    after = quantities.changed(QUAD, {"pid.kp_per_deg": 0.05})
    assert moved(QUAD, after) == {"pid.kp_q22"} and after["pid.kp_q22"] == round(0.05 * 360 * 2**22)
    assert quantities.differing(QUAD, after) == ["pid.kp_per_deg"]


def test_the_period_moves_every_integer_per_step_and_no_other_setting() -> None:
    after = quantities.changed(QUAD, {"period_us": 10_000})
    assert {"period_us", "kalman.dt_s_q33", "pid.ki_dt_q22", "pid.slew_q22", "kalman.qa_lo"} <= moved(QUAD, after)
    assert quantities.differing(QUAD, after) == ["period_us"]


def test_what_has_another_unit_of_variance_differs_by_its_value_alone() -> None:
    after = quantities.changed(QUAD, {"trust.r_deg2": 0.05})
    assert after[parameters.UNIT] != QUAD[parameters.UNIT]
    assert quantities.differing(QUAD, after) == ["trust.r_deg2"]


@pytest.mark.parametrize(
    ("name", "whole"),
    [
        ("pid.kp_per_deg", "pid.kp_per_deg"),
        ("pid.kp", "pid.kp_per_deg"),
        ("kp", "pid.kp_per_deg"),
        ("kalman.r", "trust.r_deg2"),
        ("kalman.q_bias", "kalman.q_bias_dps2_per_s"),
        ("gyro.zero", "calibration.gyro.zero_counts"),
        ("accel_up.unit_per_count", "calibration.accel_up.unit_per_count"),
        ("tilt", "tilt"),
    ],
)
def test_a_quantity_is_found_by_short_names(name: str, whole: str) -> None:
    assert quantities.find(name, quantities.quantities_of(QUAD)).name == whole


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("zero", "did you mean calibration.gyro.zero or calibration.accel.zero"),
        ("pid.kpp", "did you mean pid.kp"),
        ("pid.kp_q22", "pid.kp_q22 is an integer of the table, which --raw"),
        ("accel_y.gain", "accel.gain is an integer of the table"),
        ("x" * 5000, "x" * 80 + "' in units; "),
        ("", "names them all"),
    ],
)
def test_a_name_that_is_none_or_several_is_refused(name: str, said: str) -> None:
    with pytest.raises(UsageError) as refused:
        quantities.find(name, quantities.quantities_of(QUAD))
    assert said in str(refused.value) and len(str(refused.value)) < 300


def test_a_name_that_is_near_is_offered_once() -> None:
    with pytest.raises(UsageError) as refused:
        quantities.find("recever", quantities.quantities_of(shipped_tunings.table_of("quadrotor", None)))
    offered = str(refused.value).rpartition("did you mean ")[2].rstrip("?").split(" or ")
    assert "receiver" in offered and len(set(offered)) == len(offered)


@pytest.mark.parametrize("end", ["min", "max"])
def test_integers_that_stand_for_no_tuning_are_a_sentence(end: str) -> None:
    """Every integer of every system at the end of its range: a tuning in units, or one sentence."""
    for system in systems.SYSTEMS:
        table = shipped_tunings.table_of(system, None)
        for row in parameters.table():
            if group_of(row.name) not in declarations.system(system).all_groups:
                continue
            try:
                values = quantities.values_of({**table, row.name: row.min if end == "min" else row.max})
            except UsageError as error:
                assert len(str(error).splitlines()) == 1
            else:
                assert len(values) == len(quantities.quantities_of(table))


def test_a_field_without_a_unit_is_named() -> None:
    @dataclass(frozen=True)
    class Bare:
        system: ClassVar[str] = "bare"
        share: float = field(default=1.0, metadata=quantity(NUMBER, "share"))
        gain: float = 0.0

    with pytest.raises(UsageError, match=r"gain of .*Bare has no unit and meaning"):
        quantities.quantities_of_type(Bare)


def test_the_unit_of_a_group_is_that_of_its_fields() -> None:
    @dataclass(frozen=True)
    class Sensor:
        system: ClassVar[str] = "sensor"
        field_strength: Channel = field(metadata=quantity("uT", "magnetic field"))

    one = quantities.quantities_of_type(Sensor)["field_strength.unit_per_count"]
    assert one.unit == "uT per count" and one.meaning.startswith("magnetic field: value of one count")
