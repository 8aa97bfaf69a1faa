"""The wheel as a user installs it: built once in a run of the tests, from a tree without git, in empty environments.

The sdist is made from the files that git tracks, the wheel from the sdist.
"""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

import pytest

from plumb.spec import declarations
from support.once_per_run import once_per_run, run_folder

ROOT = Path(__file__).resolve().parents[2]
IMAGE = ROOT / "build" / "stm32f103" / "firmware.bin"


def _smallest(system: str) -> list[str]:
    """The vector of a system that is the smallest of those for a link."""
    found = (ROOT / "tests" / "vectors").glob(f"{system}_*_link.golden")
    return [path.stem for path in sorted(found, key=lambda path: path.stat().st_size)[:1]]


OF_QUAD = {"quad_hold", "quad_disturb_paper", "quad_motion_paper_link"}
VECTORS = OF_QUAD | {vector for name in declarations.names() if name != "quad" for vector in _smallest(name)}
"""One of each system, and those of the page about golden vectors in a user's CI, of which one is for no link."""
NEEDS_IMAGE = pytest.mark.skipif(not IMAGE.exists(), reason="the flash image is not built: run make image")


@dataclass(frozen=True)
class Built:
    """What `python -m build` made, and an environment that holds the wheel and what it asks for, and nothing else."""

    sdist: Path
    wheel: Path
    environment: Path

    def plumb(self, *arguments: str, cwd: Path) -> subprocess.CompletedProcess[str]:
        """Run `plumb` with an empty PATH: no compiler, no QEMU, no git."""
        scripts = self.environment / "bin"
        return subprocess.run(
            [scripts / "plumb", *arguments], cwd=cwd, env={"PATH": str(scripts), "HOME": str(cwd)}, capture_output=True,
            text=True, check=False,
        )  # fmt: skip


def run(*command: str | Path) -> None:
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]


def copy_tracked_files(tree: Path) -> None:
    """The tree without git, with one vector of each system, and with the flash image that was built."""
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    for name in filter(None, listed.split("\0")):
        if (ROOT / name).is_file() and not (name.endswith(".golden") and Path(name).stem not in VECTORS):
            (tree / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / name, tree / name)
    folder = tree / "tests" / "vectors"
    for recipe in folder.glob("*.recipe.toml"):
        head, *entries = recipe.read_text().split("[[vector]]\n")
        kept = [one for one in entries if re.search(r'^name = "(\w+)"', one, re.M)[1] in VECTORS]  # type: ignore[index]
        if kept:
            recipe.write_text("[[vector]]\n".join([head, *kept]))
        else:
            recipe.unlink()
    manifest = json.loads((folder / "manifest.json").read_text())
    manifest["vectors"] = [row for row in manifest["vectors"] if row["name"] in VECTORS]
    (folder / "manifest.json").write_text(json.dumps(manifest))


def _environment(folder: Path, *packages: str) -> Path:
    run(sys.executable, "-m", "venv", "--without-pip", folder)
    pip: list[str | Path] = [
        sys.executable,
        "-m",
        "pip",
        "--python",
        folder / "bin" / "python",
        "install",
        "--no-compile",
        "-q",
    ]
    run(*pip, *packages)
    return folder


def build(folder: Path) -> Built:
    tree, dist = folder / "tree", folder / "dist"
    copy_tracked_files(tree)
    images = tree / "host" / "plumb" / "images"
    run(sys.executable, ROOT / "tools" / "package_images.py", "--unchecked", "--images", "quad", "--out", images)
    run(sys.executable, "-m", "build", "--no-isolation", "--outdir", dist, tree)
    shutil.rmtree(tree)
    (sdist,), (wheel,) = dist.glob("*.tar.gz"), dist.glob("*.whl")
    return Built(sdist, wheel, _environment(folder / "environment", f"{wheel}[virtual,report]"))


def built_wheel(factory: pytest.TempPathFactory) -> Built:
    """Sdist, wheel and its environment, the same for all tests of a run."""
    folder = run_folder(factory) / "wheel"
    folder.mkdir(exist_ok=True)
    return once_per_run(folder, IMAGE, lambda: build(folder))


def users_environment(factory: pytest.TempPathFactory) -> Path:
    """An environment with the wheel, pytest and mypy, as in the project of a user."""
    built = built_wheel(factory)
    folder = run_folder(factory) / "users"
    folder.mkdir(exist_ok=True)
    wanted = (f"{built.wheel}[virtual]", f"pytest=={version('pytest')}", f"mypy=={version('mypy')}")
    return once_per_run(folder, IMAGE, lambda: _environment(folder / "environment", *wanted))
