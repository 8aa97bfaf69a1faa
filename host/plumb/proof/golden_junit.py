"""JUnit XML of a check of golden vectors: a test suite for each board, a test case for each vector on it.

The elements are those that Jenkins, GitLab and GitHub's reporters share: testsuites, testsuite (name, tests, failures,
errors, skipped, time, timestamp), testcase (name, classname, time), failure, error and skipped (message, type).
"""

from __future__ import annotations

from collections.abc import Mapping
from xml.etree import ElementTree

from plumb.proof.golden_result import Result, VectorResult
from plumb.proof.run_identity import date_utc


def xml_text(text: str) -> str:
    """The text without characters that XML 1.0 forbids even as references; they become backslash escapes."""
    return "".join(c if _allowed(ord(c)) else c.encode("unicode_escape", "surrogatepass").decode() for c in text)


def _allowed(code: int) -> bool:
    return code in (9, 10, 13) or 32 <= code < 0xD800 or 0xE000 <= code < 0xFFFE or code >= 0x10000


def junit(results: Mapping[str, Result], errors: Mapping[str, str]) -> bytes:
    """The document. results: by board. errors: board -> why its check ended early; each gets its own test case."""
    boards = list(dict.fromkeys([*results, *errors]))
    stamp = date_utc().removesuffix("Z")  # xs:dateTime without a zone is what the schema takes
    suites = ElementTree.Element("testsuites", name="plumb golden check")
    for board in boards:
        rows = results[board].rows if board in results else []
        counts = {
            "tests": len(rows) + (board in errors),
            "failures": sum(row.verdict == "fail" for row in rows),
            "errors": sum(row.verdict == "unverified" for row in rows) + (board in errors),
            "skipped": 0,
        }
        suite = ElementTree.SubElement(suites, "testsuite", name=xml_text(board), timestamp=stamp)
        suite.set("time", _seconds(sum(row.seconds for row in rows)))
        for key, count in counts.items():
            suite.set(key, str(count))
        for row in rows:
            _case(suite, board, row)
        if board in errors:
            case = ElementTree.SubElement(
                suite, "testcase", name="the board", classname=_class(board, "link"), time="0.000"
            )
            ElementTree.SubElement(case, "error", message=xml_text(errors[board]), type="link")
    for key in ("tests", "failures", "errors"):  # the schema has no skipped here
        suites.set(key, str(sum(int(suite.get(key, "0")) for suite in suites)))
    suites.set("time", _seconds(sum(float(suite.get("time", "0")) for suite in suites)))
    ElementTree.indent(suites)
    text: bytes = ElementTree.tostring(suites, encoding="utf-8", xml_declaration=True)
    return text + b"\n"


def _case(suite: ElementTree.Element, board: str, row: VectorResult) -> None:
    case = ElementTree.SubElement(
        suite, "testcase", name=xml_text(row.vector), classname=_class(board, row.system), time=_seconds(row.seconds)
    )
    if row.verdict == "fail":
        said = ElementTree.SubElement(case, "failure", message=xml_text(row.describe()), type="mismatch")
        first = row.first_divergence
        said.text = xml_text(f"{row.mismatches} of {row.steps} steps differ" + (f"\n{first}" if first else ""))
    elif row.verdict == "unverified":
        ElementTree.SubElement(case, "error", message=xml_text(row.describe()), type="unverified")


def _class(board: str, system: str) -> str:
    """Tools cut a class name at its dots: those of a path are replaced."""
    return xml_text(f"plumb.golden.{board.replace('.', '_')}.{system}")


def _seconds(value: float) -> str:
    return f"{value:.3f}"
