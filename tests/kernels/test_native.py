"""The native core is found or its absence explained, and neither it nor fixed takes inputs that it would misread."""

from __future__ import annotations

import os
import shutil
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from plumb.boards.native import build as native_build
from plumb.boards.native import core as native_core
from plumb.cli import doctor
from plumb.contract import run_fixed
from plumb.contract.parameters import ControlParams, quantise
from plumb.errors import UsageError
from plumb.spec import dbc
from plumb.systems.quad import scenarios as quad

PARAMS = quantise(quad.TUNINGS["paper"])


def test_a_missing_library_is_one_sentence_that_says_what_to_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(native_core.CORE_VARIABLE, raising=False)
    monkeypatch.setattr(native_core, "LIBRARY", "libplumb_nowhere.so")
    with pytest.raises(UsageError, match="cmake --preset native"):
        native_core.core_path()


@pytest.mark.parametrize("content", [b"", b"not a library"])
def test_a_library_that_is_none_is_refused(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, content: bytes) -> None:
    other = tmp_path / native_core.LIBRARY
    other.write_bytes(content)
    monkeypatch.setattr(native_core, "core_path", lambda: other)
    native_core.c_core.cache_clear()
    try:
        with pytest.raises(UsageError, match="is not this core"):
            native_core.c_core()
    finally:
        native_core.c_core.cache_clear()


def test_a_library_of_other_words_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(native_core, "word_names", lambda core, system: ("raw_0",))
    native_core.c_core.cache_clear()
    try:
        with pytest.raises(UsageError, match="another version"):
            native_core.c_core()
    finally:
        native_core.c_core.cache_clear()


@pytest.mark.parametrize("implementation", [run_fixed, native_core])
@pytest.mark.parametrize(
    ("raw", "setpoint", "reason"),
    [
        (np.zeros((5, 6)), np.zeros(5, int), "round them"),
        (np.full((5, 6), 32768), np.zeros(5, int), "16 bits"),
        (np.zeros((5, 6), int), np.full(5, 1 << 31), "32 bits"),
        (np.zeros((5, 2), int), np.zeros(5, int), "3 to 6"),
        (np.zeros((5, dbc.inputs_most() + 1), int), np.zeros(5, int), "3 to 6"),
        (np.ones((5, 7), int), np.zeros(5, int), "3 to 6"),
        (np.zeros(5, int), np.zeros(5, int), "3 to 6"),
        (np.zeros((5, 6), int), np.zeros(4, int), "do not match"),
        (np.zeros((5, 6, 2), int), np.zeros(5, int), "do not match"),
    ],
)
def test_inputs_that_do_not_fit_are_refused(
    implementation: ModuleType, raw: np.ndarray, setpoint: np.ndarray, reason: str
) -> None:
    with pytest.raises(UsageError, match=reason):
        implementation.run_control(PARAMS, raw, setpoint)


def test_as_many_parameter_sets_as_runs() -> None:
    raw, setpoint = np.zeros((5, 6, 3), int), np.zeros((5, 3), int)
    with pytest.raises(UsageError, match="2 parameter sets were given for 3 runs"):
        native_core.run_control([PARAMS, PARAMS], raw, setpoint)


@pytest.mark.parametrize("implementation", [run_fixed, native_core])
def test_no_steps_are_no_words(implementation: ModuleType) -> None:
    words = implementation.run_control(PARAMS, np.zeros((0, 6), int), np.zeros(0, int))
    assert words.record.shape == (0,) and words.digests().size == 0


def stale(monkeypatch: pytest.MonkeyPatch, root: Path, *, built_s: int, changed_s: int) -> Path:
    """A checkout with one source and a library, changed and built at these times."""
    library, source = root / "build" / "native" / native_core.LIBRARY, root / "firmware" / "core" / "pid.c"
    for path, time_s in ((library, built_s), (source, changed_s)):
        path.parent.mkdir(parents=True)
        path.touch()
        os.utime(path, (time_s, time_s))
    monkeypatch.setattr(native_build, "CHECKOUT", root)
    return library


def test_a_core_older_than_its_sources_is_named_with_the_command_that_builds_it(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """It refuses the parameters of a version that it does not know: that is not what is wrong."""
    wrong = ControlParams({**PARAMS.values, "kalman.rate_now": 99})
    with pytest.raises(UsageError, match="the core refuses these parameters of quad; take those of a tuning"):
        native_core.require_valid(wrong)
    library = stale(monkeypatch, tmp_path, built_s=100, changed_s=101)
    monkeypatch.setattr(native_core, "core_path", lambda: library)
    with pytest.raises(UsageError) as refused:
        native_core.require_valid(wrong)
    assert str(refused.value) == (
        f"{native_core.LIBRARY} is older than its sources (firmware/core/pid.c): "
        "run 'cmake --preset native && cmake --build --preset native' in the checkout"
    )
    assert not doctor.native_core().good


@pytest.mark.parametrize(("built_s", "place"), [(101, "build"), (102, "build"), (100, "elsewhere")])
def test_a_core_that_was_built_after_its_sources_or_elsewhere_is_not(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, built_s: int, place: str
) -> None:
    library = stale(monkeypatch, tmp_path, built_s=built_s, changed_s=101)
    if place == "elsewhere":
        library = Path(shutil.copy2(library, tmp_path / "other.so"))
    assert native_build.stale_text(library) == ""
