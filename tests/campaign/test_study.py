"""Studies: what varies from run to run, and what is refused before the first run."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from plumb.campaign import study
from plumb.campaign.study import from_table
from plumb.errors import UsageError


def test_a_grid_gives_every_point_the_same_seeds() -> None:
    declared = from_table(
        {
            "system": "quad",
            "runs": 12,
            "vary": {"scenario": ["motion", "quiet"], "condition.bandwidth_hz": [20, 50, 350]},
        }
    )
    runs = [(declared.seed(i), *declared.values(i).values()) for i in range(12)]
    assert runs[:3] == [(1000, "motion", 20.0), (1000, "motion", 50.0), (1000, "motion", 350.0)]
    assert [run[0] for run in runs] == [1000] * 6 + [1001] * 6
    assert len(set(runs)) == 12


def test_a_hypercube_takes_every_stratum_once() -> None:
    declared = from_table(
        {
            "system": "quad",
            "runs": 50,
            "draw": "latin-hypercube",
            "vary": {
                "condition.delay_ms": {"low": 0, "high": 10},
                "tuning.trust.r_deg2": {"low": 0.1, "high": 10, "log": True},
            },
        }
    )
    values = np.array([list(declared.values(i).values()) for i in range(50)], np.float64)
    assert sorted(np.floor(values[:, 0] * 5.0).astype(int)) == list(range(50))
    assert sorted(np.floor((np.log10(values[:, 1]) + 1.0) * 25.0).astype(int)) == list(range(50))
    # Independent columns of 50: 1 / sqrt(50) = 0.14, three times.
    assert abs(np.corrcoef(values[:, 0], np.log(values[:, 1]))[0, 1]) < 0.4


def test_a_random_draw_does_not_depend_on_the_number_of_runs() -> None:
    def drawn(runs: int) -> list[object]:
        table = {
            "system": "quad",
            "runs": runs,
            "draw": "random",
            "vary": {"condition.delay_ms": {"low": 0, "high": 10}},
        }
        return [from_table(table).values(i)["condition.delay_ms"] for i in range(5)]

    assert drawn(5) == drawn(500) and len(set(drawn(5))) == 5


def test_settings_of_a_tuning_are_replaced_by_their_path() -> None:
    declared = from_table({"system": "quad", "runs": 2, "vary": {"tuning.trust.r_deg2": [0.5, 1.5]}}, "own.toml")
    tuning = declared.request(1).tuning
    assert getattr(tuning, "trust").r_deg2 == 1.5  # noqa: B009  (a tuning of any system)
    assert declared.command(1) == "plumb campaign own.toml --only 1 --runs 2 --first-seed 1000"


def test_the_command_of_a_run_repeats_it() -> None:
    declared = from_table(
        {
            "system": "quad", "runs": 4, "seconds": 20, "open_loop": True, "tuning": "quiet", "scenario": "quiet",
            "conditions": {"bandwidth_hz": 50}, "vary": {"faults": [[], ["stuck:gyro@12"]]},
        }
    )  # fmt: skip
    assert declared.command(3) == (
        "plumb run quad --board native --seed 1001 --scenario quiet --tuning quiet --seconds 20 "
        "--condition bandwidth_hz=50.0 --fault stuck:gyro@12 --open-loop"
    )


@pytest.mark.parametrize(
    ("entry", "said"),
    [
        ({"system": "quadd"}, "quadd"),
        ({"run": 4}, "no entry 'run' (did you mean runs?)"),
        ({"runs": 0}, "a campaign has 1 to"),
        ({"runs": "4"}, "it is a whole number"),
        ({"seconds": 0.1}, "1 to 3600 s"),
        ({"draw": "sobol"}, "there are grid, random, latin-hypercube"),
        ({"scenario": "nowhere"}, "no scenario 'nowhere'"),
        ({"vary": {"tuning": ["quiet", "loud"]}}, "no tuning 'loud'"),
        ({"vary": {"condition.delay_ms": {"low": 0, "high": 1}}}, "is a range: list its values"),
        ({"vary": {"condition.delay_ms": {"low": 2, "high": 1}}}, "low < high"),
        ({"vary": {"condition.delay": [1, 2]}}, "no condition 'delay'"),
        ({"vary": {"tuning.trust.q": [1, 2]}}, "no setting 'q'"),
        ({"vary": {"seed": [1, 2]}}, "'seed' cannot be varied"),
        ({"faults": ["stuck:wing@3"]}, "stuck:wing"),
        ({"confirm": "virtuall"}, "'virtuall' is not a board (did you mean virtual?)"),
        ({"confirm": "qemu", "link": "can"}, "link is for confirm = 'virtual'"),
        ({"image": "quad"}, "image is for confirm = 'virtual'"),
        ({"faults": [1]}, "faults = [1]: it is a list of texts"),
        ({"faults": [["stuck:gyro@1"]]}, "it is a list of texts"),
        ({"first_seed": 10**18}, "a seed is 0 to 1000000000000000000"),
        ({"draw_seed": 10**19}, "a seed is 0 to"),
        ({"seconds": 10**400}, "seconds is no finite number"),
        ({"seconds": math.nan}, "seconds is no finite number"),
        ({"conditions": {"delay_ms": 10**400}}, "conditions.delay_ms is no finite number"),
        ({"limits": {"angle_rmse_deg": math.nan}}, "limits.angle_rmse_deg is no finite number"),
        ({"vary": {"condition.delay_ms": [10**400]}}, "vary.condition.delay_ms has the choice 1000"),
        (
            {"vary": {"tuning.period_us": [20000, 20000.5]}},
            "period_us of the tuning 'trapezium' of quad is a whole number",
        ),
        ({"tuning": "quiet", "vary": {"tuning": ["quiet", "paper"]}}, "tuning is set, and varied by vary.tuning"),
        (
            {"conditions": {"delay_ms": 1}, "vary": {"condition.delay_ms": [1, 2]}},
            "condition.delay_ms is set, and varied",
        ),
    ],
)
def test_a_broken_study_is_one_sentence(entry: dict[str, object], said: str) -> None:
    with pytest.raises(UsageError) as refused:
        from_table({"system": "quad", **entry}, "own.toml")
    assert said in str(refused.value) and str(refused.value).startswith("own.toml: ") and "\n" not in str(refused.value)


def test_a_file_that_is_no_toml_is_one_sentence(tmp_path: Path) -> None:
    path = tmp_path / "broken.toml"
    path.write_text("system = quad\n", encoding="utf-8")
    with pytest.raises(UsageError, match=r"broken.toml is no study: .*line 1"):
        study.read(path)


def test_lists_in_lists_without_end_are_one_sentence(tmp_path: Path) -> None:
    path = tmp_path / "deep.toml"
    path.write_text(f"system = {'[' * 3000}{']' * 3000}\n", encoding="utf-8")
    with pytest.raises(UsageError, match=r"deep.toml is no study: its lists or tables are nested too deeply"):
        study.read(path)


def test_a_study_may_begin_with_the_mark_of_an_editor(tmp_path: Path) -> None:
    path = tmp_path / "marked.toml"
    path.write_bytes(b'\xef\xbb\xbfsystem = "quad"\r\nruns = 3\r\n')
    assert study.read(path).runs == 3


def test_a_limit_does_not_make_another_campaign() -> None:
    one, other = (from_table({"system": "quad", "limits": {"angle_rmse_deg": limit}}) for limit in (0.5, 0.6))
    assert one.sha256() == other.sha256() != from_table({"system": "quad", "runs": 3}).sha256()


def test_a_setting_that_is_a_name_is_varied_by_its_names() -> None:
    study = from_table({"system": "quad", "runs": 4, "vary": {"tuning.kalman.rate": ["previous", "trapezium"]}})
    rates = [study.request(index).tuning.kalman.rate for index in range(4)]  # type: ignore[union-attr]
    assert rates == ["previous", "trapezium"] * 2
    for vary, reason in (
        ({"tuning.kalman.rate": [1, 2]}, "rate of the kalman .* is a name, not 1.0"),
        ({"tuning.trust.r_deg2": ["large"]}, "r_deg2 of the trust .* is no name, not 'large'"),
    ):
        with pytest.raises(UsageError, match=reason):
            from_table({"system": "quad", "vary": vary})
