"""The list of tests that run on one port alone names tests that there are."""

from __future__ import annotations

import re
from pathlib import Path

from support.port_only import NATIVE_ONLY


def test_every_case_of_one_port_is_a_test_with_a_reason() -> None:
    text = "".join(path.read_text(encoding="utf-8") for path in Path(__file__).parent.glob("test_*.py"))
    named = set(re.findall(r"def (test_\w+)", text))
    assert {name.partition("[")[0] for name in NATIVE_ONLY} <= named
    assert all(len(reason) > 10 for reason in NATIVE_ONLY.values())
