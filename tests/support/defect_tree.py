"""A copy of the checkout in which defects are built and the rows and tests of each are run.

The copy has build folders of its own, so that nothing that is built here ever lies where the product looks for it, and
a child process that imports the package from the copy, so that every test finds the code that the copy has built.
Files are only written when they differ: a defect costs the compilation of one file and a link.
"""

from __future__ import annotations

import fcntl
import hashlib
import json
import os
import re
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from plumb.proof.faults import table
from plumb.proof.faults.pilot import PILOT, RIDER, flies, rides
from plumb.spec import images
from support.defects import ROOT, Defect

IMAGE, NATIVE = "stm32f103", "native"
"""Presets of CMake, and their build folders. The preset of another flash image is its name."""
NAMED = re.compile(r'find_image\(Path\("(\w+)"\)\)')
RUNNING = re.compile(r'images\.running\(["\'](\w+)["\']\)')
"""How a test opens another flash image than that of all systems: by its name, or as that which runs a system."""
CODE = {
    IMAGE: (f"build/{IMAGE}/firmware.bin",),
    NATIVE: (f"build/{NATIVE}/libplumb_native.so", f"build/{NATIVE}/libplumb_board.so"),
}
"""What is loaded, by preset."""
PHASES = 7
"""Moments at which a row is injected that depends on timing: the runner's 60 ms in so many parts are no multiple of the
keep-alive's 10 ms."""
FORGET_INSTALLED = """\
# The package of this copy is imported, not the one that is installed in the environment.
import sys

sys.meta_path[:] = [finder for finder in sys.meta_path if not type(finder).__module__.startswith("_editable_")]
"""


class CannotBuild(Exception):
    """The compiler, or a check of the finished image, refuses the change."""


@dataclass(frozen=True)
class Verdict:
    """What one row or test said. image: SHA-256 of the code that it says it has loaded, or that it was started with."""

    name: str
    red: bool
    why: str
    image: str


@dataclass
class Tree:
    """A copy of the checkout in `folder`; make it with `opened`."""

    folder: Path
    _green: dict[str, Verdict] = field(default_factory=dict)
    _configured: set[str] = field(default_factory=set)

    @classmethod
    @contextmanager
    def opened(cls, folder: Path) -> Iterator[Tree]:
        """The copy brought up to date; no other process uses it meanwhile."""
        folder.mkdir(parents=True, exist_ok=True)
        with (folder.parent / f"{folder.name}.lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            tree = cls(folder)
            tree._copy()
            yield tree

    def _copy(self) -> None:
        listed = subprocess.run(
            ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
            cwd=ROOT, check=True, capture_output=True, text=True,
        ).stdout.split("\0")  # fmt: skip
        names = {name for name in listed if name and (ROOT / name).is_file()}
        for name in names:
            _write(self.folder / name, (ROOT / name).read_bytes())
        for folder in ("firmware", "host", "tests", "tools"):
            for path in (self.folder / folder).rglob("*"):
                if path.is_file() and path.suffix != ".pyc" and path.relative_to(self.folder).as_posix() not in names:
                    path.unlink()
        _write(self.folder / "site" / "sitecustomize.py", FORGET_INSTALLED.encode())

    def build(self, preset: str) -> str:
        """Build what tests of this preset load; its SHA-256. Raises CannotBuild with the last words of the build."""
        if preset not in CODE:
            if not (self.folder / CODE[IMAGE][0]).is_file():  # such a test may ask for that of all systems, too
                self.build(IMAGE)
            self._built(self._python("tools/build_images.py", preset))
            return self.loaded(preset)
        if preset not in self._configured:  # the Python of the tests has what the checks of an image need
            self._called(["cmake", "--preset", preset, f"-DPython3_EXECUTABLE={sys.executable}"])
            self._configured.add(preset)
        targets = ["--target", "firmware"] if preset == IMAGE else []
        self._called(["cmake", "--build", "--preset", preset, *targets])
        return self.loaded(preset)

    def loaded(self, preset: str) -> str:
        """SHA-256 of the code that tests of this preset load."""
        paths = CODE.get(preset, (f"build/images/{preset}/firmware.bin",))
        return hashlib.sha256(b"".join((self.folder / path).read_bytes() for path in paths)).hexdigest()

    def _called(self, command: Sequence[str]) -> None:
        self._built(subprocess.run(command, cwd=self.folder, capture_output=True, text=True, check=False))

    def _built(self, done: subprocess.CompletedProcess[str]) -> None:
        if done.returncode:
            raise CannotBuild("\n".join((done.stdout + done.stderr).splitlines()[-12:]))

    @contextmanager
    def with_defect(self, defect: Defect) -> Iterator[None]:
        """The copy with this defect in its source."""
        path = self.folder / defect.source
        healthy = path.read_text(encoding="utf-8")
        _write(path, defect.applied(healthy).encode())
        try:
            yield
        finally:
            _write(path, healthy.encode())

    def run(self, name: str) -> Verdict:
        """Run one row or test on what is built."""
        if "/" not in name:
            return self._run_row(name)
        if name.endswith(".c"):
            return self._run_c_test(name)
        return self._run_test(name)

    def green(self, name: str) -> Verdict:
        """What the row or test says of the code without a defect; asked once."""
        if name not in self._green:
            self.build(preset_of(name))
            self._green[name] = self.run(name)
        return self._green[name]

    def _python(self, *arguments: str) -> subprocess.CompletedProcess[str]:
        places = [str(self.folder / name) for name in ("site", "host", "tests")]
        kept = {name: value for name, value in os.environ.items() if not name.startswith(("PYTEST_", "COV_"))}
        # compiled once for all rows; whatever the environment says: that takes longer than a row
        compiled = {"PYTHONPYCACHEPREFIX": str(self.folder / "compiled"), "PYTHONDONTWRITEBYTECODE": ""}
        kept |= {"PYTHONPATH": os.pathsep.join(places), **compiled}
        return subprocess.run(
            [sys.executable, *arguments], cwd=self.folder, env=kept, capture_output=True, text=True, check=False
        )

    def _run_row(self, name: str) -> Verdict:
        done = self._python("-m", "support.fault_row", name, str(PHASES))
        if done.returncode:
            raise RuntimeError(f"{name}: exit code {done.returncode}: {done.stderr[-500:]}")
        report = json.loads(done.stdout)
        return Verdict(name, bool(report["why"]), report["why"], report["image"])

    def _run_test(self, name: str) -> Verdict:
        done = self._python("-m", "pytest", "-x", "-n0", "-p", "no:cacheprovider", name)
        if done.returncode not in (0, 1) or (done.returncode == 0 and " passed" not in done.stdout):
            raise RuntimeError(f"{name}: exit code {done.returncode}: {(done.stdout + done.stderr)[-500:]}")
        said = [line for line in done.stdout.splitlines() if line.startswith("E ")]
        return Verdict(name, done.returncode == 1, "; ".join(said[:3]), self.loaded(preset_of(name)))

    def _run_c_test(self, name: str) -> Verdict:
        program = self.folder / "build" / NATIVE / name.removesuffix(".c")
        done = subprocess.run([program], cwd=program.parent, capture_output=True, text=True, check=False)
        return Verdict(name, done.returncode != 0, (done.stdout + done.stderr)[-300:], self.loaded(NATIVE))


def preset_of(name: str) -> str:
    """What the row or test runs: a flash image, or the core on this machine."""
    if "/" not in name:
        return running(system_of_row(name))
    text = (ROOT / name.partition("::")[0]).read_text(encoding="utf-8")
    if (named := NAMED.search(text)) is not None:
        return named[1]
    if (of_system := RUNNING.search(text)) is not None:
        return running(of_system[1])
    on_image = "stm32f103" in text or "find_image" in text or "balancer_bench" in text or "unicorn" in text
    return IMAGE if on_image else NATIVE


def running(system: str | None) -> str:
    """The image that runs a system; None: one that the image of all systems has."""
    image = images.running(system)
    return IMAGE if image is None else str(image)


def system_of_row(name: str) -> str | None:
    """The system that alone has a row, where the image of all systems leaves it out: the one that is flown, or the one
    that is ridden."""
    needs = [fault.needs for fault in table.FAULTS if fault.name == name.partition("@")[0]]
    for feature, has in ((PILOT, flies), (RIDER, rides)):
        if needs and all(feature in wanted for wanted in needs):
            return next(filter(has, table.tested_systems()))
    return None


def judged(tree: Tree, defect: Defect) -> tuple[list[Verdict], list[str]]:
    """What every row and test of the defect says with it, and all that is wrong: a row that is red without the defect,
    one that does not notice it, or one that did not load what was built."""
    wrong = []
    healthy = {name: tree.green(name) for name in defect.caught_by}
    wrong += [f"{name} is red without the defect: {said.why}" for name, said in healthy.items() if said.red]
    verdicts = []
    with tree.with_defect(defect):
        built = {preset: tree.build(preset) for preset in {preset_of(name) for name in defect.caught_by}}
        for name in defect.caught_by:
            said = tree.run(name)
            verdicts.append(said)
            if said.image != built[preset_of(name)]:
                wrong.append(f"{name} has not loaded the image that was built")
            if said.image == healthy[name].image:
                wrong.append(f"{name}: the defect changes no byte of what is loaded")
            if not said.red:
                wrong.append(f"{name} does not notice it")
            elif defect.why not in said.why:
                wrong.append(f"{name} says '{said.why}', not '{defect.why}'")
    return verdicts, wrong


def _write(path: Path, data: bytes) -> None:
    """Write the file unless it has these bytes: its time decides what is compiled."""
    if path.is_file() and path.read_bytes() == data:
        return
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)
