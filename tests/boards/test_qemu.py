"""The core on QEMU's Cortex-M processors gives the model's words, and the process around it is always cleaned up."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from plumb.boards import qemu
from plumb.contract import run_fixed
from plumb.contract.parameters import ControlParams, quantise
from plumb.errors import LinkError, UsageError
from plumb.proof.golden_recipe import WILD
from plumb.systems.quad import scenarios as quad

FOLDER = Path(__file__).parents[2] / "build/stm32f103"
IMAGE = FOLDER / qemu.image_name()
needs_qemu = pytest.mark.skipif(
    shutil.which(qemu.PROGRAM) is None or not all((FOLDER / qemu.image_name(core)).is_file() for core in qemu.MACHINES),
    reason="qemu-system-arm or an image is missing: apt install qemu-system-arm, make image",
)
SLEEPER = [sys.executable, "-c", "import time; time.sleep(60)"]


def wild(kind: str, steps: int) -> tuple[ControlParams, np.ndarray, np.ndarray]:
    raw, setpoint = WILD[kind](7, steps)
    return quantise(quad.TUNINGS["adaptive"]), raw.astype(np.int16), setpoint.astype(np.int32)


CASES = [*(("m3", kind) for kind in sorted(WILD)), *((core, "extremes") for core in qemu.MACHINES if core != "m3")]


@needs_qemu
@pytest.mark.parametrize(("core", "kind"), CASES)
def test_every_word_and_digest_is_the_models(core: str, kind: str) -> None:
    params, raw, setpoint = wild(kind, 300)
    with qemu.QemuBoard(core, FOLDER / qemu.image_name(core)) as board:
        assert board.name == f"qemu:{core}"
        answer = board.run_injected(params, raw, setpoint)
        of_step = board.words_of_step(params, raw, setpoint, 123)
    expected = run_fixed.run_control(params, raw, setpoint)
    assert answer.words is not None
    for name, values in expected.items():
        assert np.array_equal(values, answer.words[name]), name
    assert np.array_equal(answer.digests, expected.digests())
    assert of_step == {name: int(values[123]) for name, values in expected.items()}


@needs_qemu
def test_parameters_of_another_layout_are_refused_in_a_sentence() -> None:
    class Short:
        system = "quad"

        def words(self) -> list[int]:
            return [1, 2, 3]

    params, raw, setpoint = wild("uniform", 3)
    assert params.words()
    with pytest.raises(UsageError, match="another parameter layout"), qemu.QemuBoard(image=IMAGE) as board:
        board.run_injected(Short(), raw, setpoint)  # type: ignore[arg-type]


def test_missing_qemu_names_the_package(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")
    with pytest.raises(UsageError, match="apt install qemu-system-arm"):
        qemu.QemuBoard("m0", IMAGE)


def test_missing_image_names_the_command(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(shutil, "which", lambda _: sys.executable)
    monkeypatch.setattr(qemu, "CHECKOUT", tmp_path)
    monkeypatch.chdir(tmp_path)
    with pytest.raises(UsageError, match=r"there is no build/stm32f103/plumb_qemu_m0\.elf; build it with make image"):
        qemu.QemuBoard("m0")


@needs_qemu
@pytest.mark.parametrize(("core", "architecture"), [("m0", "v6S-M"), ("m3", "v7"), ("m4", "v7E-M"), ("m7", "v7E-M")])
def test_an_image_is_of_its_processor(core: str, architecture: str) -> None:
    command = ["arm-none-eabi-readelf", "-A", str(FOLDER / qemu.image_name(core))]
    said = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    assert f"Tag_CPU_arch: {architecture}\n" in said


def test_a_process_that_hangs_is_stopped_and_reaped(tmp_path: Path) -> None:
    before = children()  # of tests in this process before
    with pytest.raises(LinkError, match="did not finish"):
        qemu._run(SLEEPER, tmp_path, 0.2)
    assert not set(children()).difference(before)


def test_a_process_that_fails_is_quoted(tmp_path: Path) -> None:
    with pytest.raises(LinkError, match="code 3: no such machine"):
        qemu._run([sys.executable, "-c", "import sys; print('no such machine', file=sys.stderr); sys.exit(3)"],
                  tmp_path, 20)  # fmt: skip


def test_an_interrupt_stops_the_process(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupt(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    started: list[subprocess.Popen[bytes]] = []
    original = subprocess.Popen

    def popen(*arguments: object, **options: object) -> subprocess.Popen[bytes]:
        started.append(original(*arguments, **options))  # type: ignore[call-overload]
        real = started[-1].communicate
        calls = iter([interrupt, real])
        monkeypatch.setattr(started[-1], "communicate", lambda *a, **k: next(calls)(*a, **k))  # type: ignore[operator]
        return started[-1]

    monkeypatch.setattr(subprocess, "Popen", popen)
    with pytest.raises(KeyboardInterrupt):
        qemu._run(SLEEPER, tmp_path, 30)
    assert started[0].returncode == -signal.SIGKILL


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux kills a child with its parent")
def test_the_process_dies_with_its_parent(tmp_path: Path) -> None:
    program = f"""
import subprocess, sys
from plumb.boards import qemu
process = subprocess.Popen({SLEEPER!r}, preexec_fn=qemu._die_with_parent)
print(process.pid, flush=True)
sys.stdin.read()
"""
    parent = subprocess.Popen(
        [sys.executable, "-c", program], stdin=subprocess.PIPE, stdout=subprocess.PIPE, cwd=tmp_path
    )
    assert parent.stdout is not None
    child = int(parent.stdout.readline())
    parent.kill()
    parent.communicate()
    for _ in range(100):
        if not alive(child):
            return
        time.sleep(0.05)
    os.kill(child, signal.SIGKILL)
    pytest.fail("the child outlived its parent")


def alive(pid: int) -> bool:
    try:
        return "\nState:\tZ" not in Path(f"/proc/{pid}/status").read_text(encoding="utf-8")
    except FileNotFoundError:
        return False


def children() -> list[str]:
    return Path(f"/proc/self/task/{os.getpid()}/children").read_text(encoding="utf-8").split()
