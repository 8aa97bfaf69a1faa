"""The native core is found or its absence explained, and neither it nor fixed takes inputs that it would misread."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from plumb.boards import native_core
from plumb.errors import UsageError
from plumb.systems import run_fixed
from plumb.systems.quad import scenarios as quad
from plumb.tuning.quantise import quantise

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
        (np.zeros((5, 7), int), np.zeros(5, int), "3 to 6"),
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


@pytest.mark.parametrize("implementation", [run_fixed, native_core])
def test_as_many_parameter_sets_as_runs(implementation: ModuleType) -> None:
    raw, setpoint = np.zeros((5, 6, 3), int), np.zeros((5, 3), int)
    with pytest.raises(UsageError, match="2 parameter sets were given for 3 runs"):
        implementation.run_control([PARAMS, PARAMS], raw, setpoint)


@pytest.mark.parametrize("implementation", [run_fixed, native_core])
def test_no_steps_are_no_words(implementation: ModuleType) -> None:
    words = implementation.run_control(PARAMS, np.zeros((0, 6), int), np.zeros(0, int))
    assert words.record.shape == (0,) and words.digests().size == 0
