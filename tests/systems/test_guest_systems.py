"""Three systems outside the checkout, each written as CONTRIBUTING.md says, and with nothing that turns in space: a
motor's current with an output that it checks itself, a filter without an output, and three slides with a setpoint each.

They share one native core and one flash image.
"""

from __future__ import annotations

import json
import re
import shutil
import sys
from pathlib import Path

import pytest

from support.built_systems import Plumb, build
from support.once_per_run import once_per_run, run_folder

ROOT = Path(__file__).resolve().parents[2]
GUESTS = ROOT / "tests" / "guest_systems"
NAMES = ("current", "notch", "gantry")
OF_ATTITUDE = re.compile(
    r"attitude|angle|angular|tilt|pitch|\broll|yaw|gyro|accel|kalman|innovation|plausib|takeoff|quaternion|"
    r"[_ ]deg|dps|lsb",
    re.IGNORECASE,
)


@pytest.fixture(scope="module")
def guests(tmp_path_factory: pytest.TempPathFactory) -> Plumb:
    """All workers of a run of the tests share one build."""
    folder, python = run_folder(tmp_path_factory), Path(sys.executable)
    systems = folder / "guest_systems"

    def built() -> tuple[Path, Path]:
        shutil.copytree(GUESTS, systems, dirs_exist_ok=True, ignore=shutil.ignore_patterns("__pycache__"))
        options = (f"-DPLUMB_SYSTEMS={';'.join(NAMES)}", f"-DPLUMB_SYSTEM_PATH={systems}")
        return build(ROOT, folder / "guest_build", python, *options)

    core, image = once_per_run(folder, "guest systems", built)
    return Plumb(python, core, image, {"PLUMB_SYSTEM_PATH": str(systems)})


@pytest.mark.parametrize("name", NAMES)
def test_nothing_of_it_speaks_of_attitude(name: str) -> None:
    files = [path for path in GUESTS.rglob("*") if path.is_file() and name in path.parts and path.suffix != ".pyc"]
    assert len(files) >= 11
    assert {path.name: found.group() for path in files if (found := OF_ATTITUDE.search(path.read_text("utf-8")))} == {}


def test_their_vectors_hold_on_every_board(guests: Plumb, tmp_path: Path) -> None:
    shutil.copy(GUESTS / "recipe.toml", tmp_path)
    guests("golden", "make", "--vectors", str(tmp_path))
    report = json.loads(
        guests(
            "golden", "check", "--board", "native", "--board", "virtual", "--vectors", str(tmp_path), "--json"
        ).stdout
    )
    assert report["verdict"] == "pass"
    assert {name: row["steps"] for name, row in report["boards"].items()} == dict.fromkeys(
        ("fixed", "native", "virtual"), 4500
    )


@pytest.mark.parametrize(
    ("name", "figures"),
    [
        ("current", ("current_rmse_a", "duty_apart_max")),
        ("notch", ("left_rmse_counts", "apart_max_counts")),
        ("gantry", ("apart_max_counts", "arrived_percent")),
    ],
)
def test_a_run_has_the_figures_that_its_system_declares(
    guests: Plumb, name: str, figures: tuple[str, ...], tmp_path: Path
) -> None:
    report = json.loads(guests("run", name, "--board", "native", "--json", "--out", str(tmp_path)).stdout)
    assert (report["verdict"], tuple(report["metrics"])) == ("pass", (*figures, "target_vs_fixed_mismatches"))
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "integers against float64" in page.replace("duty of the ", "") and " deg" not in page


def test_the_current_runs_armed_on_its_own_sensor(guests: Plumb) -> None:
    report = json.loads(guests("run", "current", "--board", "virtual", "--live", "--seconds", "1.5", "--json").stdout)
    assert (report["verdict"], report["steps"]) == ("pass", 1500)
    assert report["metrics"]["current_rmse_a"] < 0.2


def test_a_check_of_its_own_disarms(guests: Plumb) -> None:
    live = ("run", "current", "--board", "virtual", "--live", "--seconds", "1", "--scenario", "short")
    said = guests(*live, code=3).stderr
    assert "disarmed itself before step 50" in said and "more current than trip_a for three steps" in said


def test_a_condition_of_its_own_refuses_arming(guests: Plumb) -> None:
    live = ("run", "current", "--board", "virtual", "--live", "--seconds", "1", "--scenario", "flowing")
    said = guests(*live, code=3).stderr
    assert "it is not ready to be armed; current flows: wait until the motor is at rest" in said


SETPOINT_FIRST = """
import sys, plumb
with plumb.connect("virtual", system="current", image=sys.argv[1]) as board:
    list(board.stream(seconds=0.2))
    board.set_setpoint(0.5)
    list(board.stream(seconds=0.05))
    try:
        board.arm()
    except plumb.PlumbError as refused:
        print(refused)
"""


def test_a_setpoint_refuses_arming_by_its_own_checks(guests: Plumb) -> None:
    said = guests.run(guests.python, "-c", SETPOINT_FIRST, str(guests.image)).stdout
    assert "the setpoint is not 0" in said


def test_limits_are_of_its_main_figure(guests: Plumb, tmp_path: Path) -> None:
    """Of those that have one: measured by the tool that measures angles, in the unit that it declares."""
    shutil.copytree(GUESTS, tmp_path, dirs_exist_ok=True)
    here = Plumb(guests.python, guests.core, guests.image, {"PLUMB_SYSTEM_PATH": str(tmp_path)})
    said = here.run(here.python, ROOT / "tools/gen_limits.py", "notch", "gantry", "--seeds", "2").stdout
    assert "gantry: nothing of it is compared with a truth" in said
    text = json.loads(here("run", "notch", "--board", "native", "--json").stdout)
    assert text["accuracy"] == "pass"
    [limit] = text["accuracy_limits"]
    assert (limit["metric"], limit["unit"]) == ("left_rmse_counts", "count")


def test_three_setpoints_move_three_slides(guests: Plumb, tmp_path: Path) -> None:
    guests("run", "gantry", "--board", "virtual", "--tuning", "quick", "--seconds", "5", "--out", str(tmp_path))
    first, *_, last = (tmp_path / "steps.csv").read_text(encoding="utf-8").splitlines()
    row = dict(zip(first.split(","), last.split(","), strict=True))
    asked = [float(row[f"true_place_{axis}"]) for axis in "xyz"]
    path = [int(row[f"path_{axis}_counts"]) for axis in "xyz"]
    assert len(set(path)) == 3 and 0 not in path
    assert all(place * at > 0 for place, at in zip(asked, path, strict=True))
