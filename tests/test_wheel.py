"""The installed package alone: built from a tree without git, run in an empty environment and an empty folder.

The commands run with an empty PATH: no compiler, no QEMU, no git. Some golden vectors stand for all of them.
"""

from __future__ import annotations

import importlib.util
import json
import re
import shutil
import subprocess
import tarfile
import zipfile
from pathlib import Path

import pytest

from plumb.cockpit.page_server import ASSETS
from plumb.cockpit.steering.trip_page import ASSETS as FLIGHT
from plumb.spec import images
from plumb.version import FALLBACK
from support.declared_systems import without_output
from support.wheel import IMAGE, NEEDS_IMAGE, VECTORS, Built, built_wheel, run, users_environment

ROOT = Path(__file__).resolve().parents[1]

pytestmark = [pytest.mark.slow, NEEDS_IMAGE]


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Built:
    return built_wheel(tmp_path_factory)


def test_the_wheel_serves_every_python_and_holds_images_and_vectors(built: Built) -> None:
    assert re.fullmatch(r"plumb_imu-[\w.+]+-py3-none-\w+\.whl", built.wheel.name)
    names = set(zipfile.ZipFile(built.wheel).namelist())
    assert {
        "plumb/py.typed",
        "plumb/images/plumb.bin",
        "plumb/images/plumb-quad.bin",
        "plumb/images/images.json",
    } <= names
    assert {f"plumb/vectors/{name}.golden" for name in VECTORS} <= names
    assert {f"plumb/cockpit/page/{name}" for name, _ in (*ASSETS.values(), *FLIGHT.values())} <= names
    assert "plumb/cockpit/page/steering/ogl.LICENSE" in names
    assert {"plumb/vectors/quad.recipe.toml", "plumb/vectors/manifest.json"} <= names
    assert not {name for name in names if not name.startswith(("plumb/", "plumb_imu-"))}
    with tarfile.open(built.sdist) as sdist:
        inside = {name.partition("/")[2] for name in sdist.getnames()}
    assert {"host/plumb/images/plumb.bin", "firmware/core/kalman.c", "tests/vectors/quad.recipe.toml"} <= inside
    assert not {name for name in inside if name.startswith((".git/", "build/", "out/", "dist/", ".venv/"))}


def test_version_without_git_is_the_fallback(built: Built, tmp_path: Path) -> None:
    assert f"-{FALLBACK}-" in built.wheel.name
    assert built.plumb("--version", cwd=tmp_path).stdout == f"plumb {FALLBACK}\n"


def test_demo_passes_and_says_that_qemu_is_not_there(built: Built, tmp_path: Path) -> None:
    done = built.plumb("demo", "--seconds", "6", cwd=tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "without qemu: qemu-system-arm is not installed" in done.stderr
    summary = json.loads((tmp_path / "out" / "demo" / "summary.json").read_text())
    assert summary["verdict"] == "pass" and set(summary["golden"]) == {"native", "virtual", "virtual, CAN"}
    assert [row["vectors"] for row in summary["golden"].values()] == [len(VECTORS), *2 * [len(VECTORS) - 1]]
    assert summary["golden_left_out"] == {"qemu": "qemu-system-arm is not installed"}
    assert (tmp_path / "out" / "demo" / "report.html").is_file()


def test_golden_check_passes_with_either_image(built: Built, tmp_path: Path) -> None:
    boards = ["--board", "native", "--board", "virtual"]
    for chosen in (["--system", without_output()], ["--image", "quad", "--system", "quad"]):
        done = built.plumb("golden", "check", *boards, *chosen, cwd=tmp_path)
        assert done.returncode == 0 and done.stdout.endswith("pass\n"), done.stdout + done.stderr


TYPED = """
import numpy as np

import plumb

estimate: plumb.Estimate = plumb.Estimator("quad", period_s=0.01).run(np.zeros((5, 3)), np.ones((5, 3)))
tilt_deg: float = float(np.degrees(estimate.tilt_rad[-1]))
with plumb.connect("native", system="quad") as board:
    board.params["pid.kp"] = 0.05
    limit: float | int | None = board.params.describe("pid.kp").max
    samples: list[plumb.Sample] = list(board.stream(seconds=0.1))
    result: plumb.RunResult = board.run("quad", raw=np.zeros((5, 3), np.int16))
exact: bool | None = result.bit_exact
checked = plumb.golden.check(["native"], ["quad"], names=["quad_hold*"])
rows: list[str] = [one.vector for one in checked.failed()]
"""
"""A program of a user's, with the types that they expect."""
MISTYPED = {
    "a wrong link": 'plumb.connect("virtual", link="usb")',
    "a name that there is not": "plumb.estimate",
    "a wrong type of a result": "steps: str = plumb.run('quad').steps",
}


def test_a_strict_type_checker_takes_the_program_of_a_user(
    tmp_path: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    """And refuses what is wrong: types are found, not Any."""
    python = users_environment(tmp_path_factory) / "bin" / "python"
    command: list[str | Path] = [python, "-m", "mypy", "--strict", "--cache-dir", tmp_path / "cache"]
    program = tmp_path / "program.py"
    program.write_text(TYPED)
    said = subprocess.run([*command, program], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert said.returncode == 0, said.stdout + said.stderr
    program.write_text("\n".join(["import plumb", *MISTYPED.values(), ""]))
    said = subprocess.run([*command, program], cwd=tmp_path, capture_output=True, text=True, check=False)
    for number, what in enumerate(MISTYPED, 2):
        assert said.returncode == 1 and f"program.py:{number}: error" in said.stdout, (what, said.stdout)
    program.write_text(TYPED)
    run(python, program)


def test_doctor_names_image_commit_and_systems(built: Built, tmp_path: Path) -> None:
    done = built.plumb("doctor", "--json", cwd=tmp_path)
    found = {finding["what"]: finding for finding in json.loads(done.stdout)["findings"]}
    assert done.returncode == 0
    detail = found["flash image"]["detail"]
    assert str(built.environment) in detail and ", ".join(images.image(images.ALL).systems) in detail
    assert re.search(r"commit [0-9a-f]{16}\+?, ", detail) and re.search(r"SHA-256 [0-9a-f]{64}$", detail)


def test_flash_has_help_and_names_the_packaged_images(built: Built, tmp_path: Path) -> None:
    assert built.plumb("flash", "--help", cwd=tmp_path).returncode == 0
    done = built.plumb("flash", "--port", "none", "--image", "nosuch", cwd=tmp_path)
    assert done.returncode == 2 and ", ".join(["the package has all", *images.left_out_of_all(), "quad"]) in done.stderr


def test_without_images_one_sentence_says_what_is_missing(built: Built, tmp_path: Path) -> None:
    environment = tmp_path / "environment"
    shutil.copytree(built.environment, environment, symlinks=True)
    shutil.rmtree(next(environment.glob("lib/python3*/site-packages/plumb/images")))
    command: list[str | Path] = [
        environment / "bin" / "python",
        "-m",
        "plumb",
        "golden",
        "check",
        "--board",
        "virtual",
        "--system",
        without_output(),
    ]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr.splitlines() == [
        "plumb: there is no flash image in this installation of plumb; name one with --image, or install a wheel of a "
        "release"
    ]


@pytest.mark.parametrize(
    ("described", "version"),
    [
        ("v0.2.0-0-g1a2b3c4", "0.2.0"),
        ("v0.2.0-13-g1a2b3c4", "0.2.1.dev13+g1a2b3c4"),
        ("", FALLBACK),
        ("release-0-g1a2b3c4", FALLBACK),
    ],
)
def test_version_of_what_git_describes(described: str, version: str) -> None:
    from plumb.version import version_of

    assert version_of(described) == version


def test_versions_of_a_repository_without_and_with_a_tag(tmp_path: Path) -> None:
    from plumb.version import from_git

    def git(*arguments: str) -> None:
        identity = ["-c", "user.name=test", "-c", "user.email=test@example.org"]
        run("git", "-C", tmp_path, *identity, *arguments)

    assert from_git(tmp_path) is None
    git("init", "-q")
    git("commit", "-q", "--allow-empty", "-m", "first")
    untagged = from_git(tmp_path)
    assert untagged is not None and untagged.version == FALLBACK and len(untagged.git_hash) == 16
    git("tag", "v1.2.3")
    tagged = from_git(tmp_path)
    assert tagged is not None and tagged.version == "1.2.3" and not tagged.git_dirty
    git("commit", "-q", "--allow-empty", "-m", "second")
    later = from_git(tmp_path)
    assert later is not None and re.fullmatch(r"1\.2\.4\.dev1\+g[0-9a-f]+", later.version)


def test_a_changed_image_of_the_package_is_refused(tmp_path: Path) -> None:
    from plumb.errors import UsageError
    from plumb.flash.packaged_images import packaged_image

    spec = importlib.util.spec_from_file_location("package_images", ROOT / "tools" / "package_images.py")
    assert spec and spec.loader
    tool = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(tool)
    tool.package(["all"], tmp_path / "images", None, unchecked=True)
    path = packaged_image("all", tmp_path / "images")
    assert path is not None and path.read_bytes() == IMAGE.read_bytes()
    whole = path.read_bytes()
    path.write_bytes(whole[:-1] + bytes((whole[-1] ^ 1,)))
    with pytest.raises(UsageError, match=r"is not the image that images\.json lists; install plumb again"):
        packaged_image("all", tmp_path / "images")
    (tmp_path / "images" / "images.json").write_text("{}")
    with pytest.raises(UsageError, match="damaged"):
        packaged_image("all", tmp_path / "images")
