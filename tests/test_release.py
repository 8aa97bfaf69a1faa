"""What the release workflow demands of a tag holds for the version that comes next."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

from plumb.version import FALLBACK

ROOT = Path(__file__).resolve().parents[1]
CHANGELOG = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")


def test_c_library_and_changelog_have_the_version_that_the_workflow_asks_for() -> None:
    workflow = (ROOT / ".github/workflows/release.yml").read_text(encoding="utf-8")
    checks = re.findall(r"^ +(grep -q .*)$", workflow, re.MULTILINE)
    assert len(checks) == 2
    for check in checks:
        done = subprocess.run(["sh", "-c", f"version={FALLBACK}; {check}"], cwd=ROOT, check=False)
        assert done.returncode == 0, check


def test_every_version_of_the_changelog_has_a_date_and_only_the_first_may_be_unreleased() -> None:
    headings = re.findall(r"^## (.*)$", CHANGELOG, re.MULTILINE)
    versions = headings[1:] if headings[0] == "Unreleased" else headings
    assert versions
    assert all(re.fullmatch(r"\d+\.\d+\.\d+ \(\d{4}-\d\d-\d\d\)", heading) for heading in versions), versions
