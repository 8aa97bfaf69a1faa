"""Reports of a check of golden vectors: rows, JUnit XML, annotations, the page; and a program as a board."""

from __future__ import annotations

import hashlib
import json
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from html.parser import HTMLParser
from itertools import pairwise
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

import plumb
import plumb.__main__ as front
from plumb.boards import open_board
from plumb.boards.contract import Answer, GivesWordsOfSteps
from plumb.boards.native import core as native_core
from plumb.boards.native.board import NativeBoard
from plumb.boards.program import vector_text
from plumb.contract import run_fixed
from plumb.errors import LinkError
from plumb.flash.image import find_image, own_header
from plumb.proof import golden, golden_checks
from plumb.proof.golden_junit import junit, xml_text
from plumb.proof.golden_page import page, plots
from plumb.spec.records import Words

ROOT = Path(__file__).parents[2]
PYTHON = sys.executable
LIBRARY = ROOT / "examples/golden/library.py"
PORT = f"program:{PYTHON} {LIBRARY} {native_core.core_path()}"
RECIPE = """
[[vector]]
name = "steps_one"
system = "quad"
tuning = "adaptive"
wild = "steps"
seed = 5
steps = 90
on_link = true

[[vector]]
name = "walk_two"
system = "balancer"
tuning = "tuned"
wild = "walk"
seed = 6
steps = 30
"""


class Wrong(NativeBoard):
    """The native core with one bit of one signal changed from step 40 on; shorter runs are right."""

    def run_injected(self, params, raw, setpoint):  # type: ignore[no-untyped-def]
        answer = super().run_injected(params, raw, setpoint)
        assert answer.words is not None
        record = answer.words.record.copy()
        if params.system == "quad":
            record["bias_turn_q61"][40:] ^= 8
        words = Words(record)
        return Answer(words.digests(), words)


def wrong_checks(folder: Path) -> golden_checks.Checks:
    return golden_checks.check_boards(
        lambda name: Wrong() if name == "native" else open_board(name),
        ["fixed", "native"],
        golden.cases(folder),
        windows=True,
    )


def run(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str, str]:
    code = front.main(["golden", "check", *arguments])
    out, err = capsys.readouterr()
    return code, out, err


def sentence(capsys: pytest.CaptureFixture[str], folder: Path, *arguments: str, code: int = 2) -> str:
    got, out, err = run(capsys, "--vectors", str(folder), *arguments)
    assert (got, out) == (code, "") and err.count("\n") == 1 and "defect" not in err, err
    return err


# ---- rows ----


def test_json_has_the_contract_and_a_row_for_every_vector(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = run(capsys, "--vectors", str(folder), "--json")
    report = json.loads(out)
    assert code == 0 and (report["verdict"], report["bit_exact"], report["accuracy"]) == ("pass", True, None)
    native = report["boards"]["native"]
    assert {key: native[key] for key in ("vectors", "steps", "mismatches", "first_divergence")} == {
        "vectors": 2, "steps": 120, "mismatches": 0, "first_divergence": None,
    }  # fmt: skip
    assert [(row["vector"], row["steps"], row["verdict"]) for row in native["results"]] == [
        ("steps_one", 90, "pass"),
        ("walk_two", 30, "pass"),
    ]


def test_every_vector_that_differs_is_reported_with_step_and_signal(folder: Path) -> None:
    checks = wrong_checks(folder)
    whole = checks.to_json()
    assert (whole["verdict"], whole["bit_exact"]) == ("fail", False)
    one, two = checks.results["native"].rows
    assert one.first_divergence and (one.first_divergence.step, one.first_divergence.signal) == (40, "bias_turn_q61")
    assert (one.mismatches, two.verdict) == (50, "pass")
    assert "steps_one" in one.describe() and "step 40" in one.describe()


def test_vectors_are_chosen_by_pattern(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = run(capsys, "--vectors", str(folder), "--vector", "walk_*", "--verbose")
    assert code == 0 and out.count("walk_two") == 2 and "steps_one" not in out
    assert "walk_two" in sentence(capsys, folder, "--vector", "walk_tow")


def test_a_vector_that_was_not_asked_for_is_not_read(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """It costs no time, and damage to it stops the check of all alone."""
    (folder / "steps_one.golden").write_bytes(b"damaged")
    assert run(capsys, "--vectors", str(folder), "--vector", "walk_two")[0] == 0
    assert "steps_one.golden is not a whole golden vector" in sentence(capsys, folder)


def test_a_link_board_without_a_vector_to_run_is_wrong_use(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert "on_link" in sentence(capsys, folder, "--board", "virtual", "--vector", "walk_two")


# ---- JUnit ----

SCHEMA = {
    "testsuites": {"name", "tests", "failures", "errors", "time"},
    "testsuite": {"name", "tests", "failures", "errors", "skipped", "time", "timestamp"},
    "testcase": {"name", "classname", "time"},
    "failure": {"message", "type"},
    "error": {"message", "type"},
}
"""Elements that are written -> their attributes, all of which the schemas of Jenkins and of Surefire know."""


def checked(data: bytes) -> ElementTree.Element:
    """The document, held to the schema and to its own counts."""
    root = ElementTree.fromstring(data)
    assert root.tag == "testsuites"
    parents = {"testsuite": "testsuites", "testcase": "testsuite", "failure": "testcase", "error": "testcase"}
    for parent in root.iter():
        assert set(parent.attrib) == SCHEMA[parent.tag]
        assert all(parents[child.tag] == parent.tag for child in parent)
        assert all(re.fullmatch(r"\d+\.\d{3}", parent.attrib[key]) for key in ("time",) if key in parent.attrib)
    for element in root.iter():
        if element.tag in ("testsuites", "testsuite"):
            for key, tag in (("tests", "testcase"), ("failures", "failure"), ("errors", "error")):
                assert int(element.attrib[key]) == len(list(element.iter(tag)))
    for suite in root:
        assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d", suite.attrib["timestamp"])
    return root


def test_junit_has_a_case_for_every_board_and_vector(folder: Path, tmp_path: Path) -> None:
    checks = wrong_checks(folder)
    golden_checks.write_reports(checks, tmp_path / "new" / "golden.xml", None)
    root = checked((tmp_path / "new" / "golden.xml").read_bytes())
    cases = {(suite.attrib["name"], case.attrib["name"]): case for suite in root for case in suite}
    assert set(cases) == {(board, name) for board in ("fixed", "native") for name in ("steps_one", "walk_two")}
    failed = [key for key, case in cases.items() if case.find("failure") is not None]
    assert failed == [("native", "steps_one")]


def test_what_xml_forbids_is_written_as_an_escape() -> None:
    results = {"program:a\x00\x1b[1m<&\"'>\udcff\ufffe]]>\n": golden.Result()}
    results[next(iter(results))].add(golden.VectorResult("v", "quad", 3, 1))
    root = checked(junit(results, {"virtual": "it \x07 broke"}))
    assert [suite.attrib["errors"] for suite in root] == ["0", "1"]
    assert xml_text("\x00\ud800ü\U0001f600") == "\\x00\\ud800ü\U0001f600"


def test_a_board_that_breaks_off_leaves_its_reports(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def breaks(*_: object) -> Answer:
        raise LinkError("the cable is out")

    monkeypatch.setattr(NativeBoard, "run_injected", breaks)
    report, shown = tmp_path / "golden.xml", tmp_path / "golden.html"
    code, out, err = run(capsys, "--vectors", str(folder), "--junit", str(report), "--html", str(shown), "--github")
    assert (code, err) == (3, "plumb: the cable is out\n")
    assert out == "::error title=golden vectors on native::the cable is out\n"
    root = checked(report.read_bytes())
    assert (root.attrib["errors"], root.attrib["failures"], root.attrib["tests"]) == ("1", "0", "3")
    assert "the cable is out" in shown.read_text()


def test_the_page_says_what_the_check_was_made_with_and_the_command_where_the_page_is(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shown, report = tmp_path / "golden.html", tmp_path / "golden.xml"
    code, out, _ = run(capsys, "--vectors", str(folder), "--html", str(shown), "--junit", str(report))
    assert code == 0 and out.splitlines()[-3:] == ["pass", f"report: {shown}", f"junit: {report}"]
    page = shown.read_text()
    image = hashlib.sha256(native_core.core_path().read_bytes()).hexdigest()
    for text in (f"--html {shown}", "commit of plumb", "What ran", image):
        assert text in page, text


# ---- annotations ----


def test_annotations_name_file_and_step(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(folder.parent)
    monkeypatch.setattr("plumb.cli.options.board_of", lambda _, name: Wrong() if name == "native" else open_board(name))
    code, out, _ = run(capsys, "--vectors", str(folder), "--github")
    lines = [line for line in out.splitlines() if line.startswith("::")]
    assert code == 1 and len(lines) == 1
    place = f"file={folder.name}/steps_one.golden,title=golden vector steps_one on native"
    assert re.match(rf"::error {re.escape(place)}::.*step 40: bias_turn_q61", lines[0])


# ---- the page ----


class Outline(HTMLParser):
    """Tags, alternative texts, and whether every element is closed."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.labels: list[str] = []
        self.addresses: list[str] = []

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        named = dict(attributes)
        self.addresses += [value or "" for key, value in attributes if key in ("src", "href", "xlink:href")]
        if tag == "svg":
            assert named["role"] == "img"
            self.labels.append(named["aria-label"] or "")
        if tag not in ("meta",):
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attributes)
        self.handle_endtag(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def outline(text: str) -> Outline:
    read = Outline()
    read.feed(text)
    assert not read.open and not read.addresses, "closed, and nothing is loaded"
    assert "prefers-color-scheme: dark" in text
    return read


def test_the_page_plots_the_signal_that_diverged(folder: Path) -> None:
    checks = wrong_checks(folder)
    (shown,) = checks.windows
    assert (shown.signal, shown.first, shown.end) == ("bias_turn_q61", 0, 90)
    apart = [actual != expected for actual, expected in zip(shown.actual, shown.expected, strict=True)]
    assert apart == [False] * 40 + [True] * 50
    text = page(checks.results, checks.errors, checks.windows, checks.verdict)
    signal, difference = outline(text).labels
    assert "steps_one on native: bias_turn_q61" in signal and "first step that differs" in signal
    assert "got - expected" in difference and "from -8 to 8" in difference
    assert "agree before step 40 and differ in 50 of the steps shown" in text
    assert len(re.findall(r": expected \d+, got \d+</title></circle>", text)) == 90
    assert len(re.findall(r"<title>step \d+: [+-]8</title></circle>", text)) == 50


def test_the_plot_of_large_integers_close_together_counts_from_the_least(folder: Path) -> None:
    (shown,) = wrong_checks(folder).windows
    large = [2**60 + at for at in range(len(shown.expected))]
    signal, _ = plots(replace(shown, expected=large, actual=[*large[:40], *(value ^ 8 for value in large[40:])]))
    expected, got, first = signal.curves
    assert f" - {2**60} " in signal.y.label and expected.y.tolist() == list(range(90))
    assert (got.y - expected.y)[38:42].tolist() == [0, 0, -8, -8] and first.x.tolist() == [40, 40]


def test_the_page_names_the_image_of_every_board_that_has_one(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shown = tmp_path / "golden.html"
    boards = ["--board", "native", "--board", "virtual", "--board", PORT]
    code, out, err = run(capsys, "--vectors", str(folder), *boards, "--vector", "steps_*", "--html", str(shown))
    assert code == 0, out + err
    text = shown.read_text()
    outline(text)
    rows = re.findall(r"<tr><td>(.*?)</td><td>(.*?)</td><td>([0-9a-f]{64})</td>", text)
    files = {"native": native_core.core_path(), "virtual": find_image()}
    hashes = {name: (path.name, hashlib.sha256(path.read_bytes()).hexdigest()) for name, path in files.items()}
    assert {board: (file, sha256) for board, file, sha256 in rows} == hashes
    commit = own_header(find_image().read_bytes(), "image").git_hash
    assert commit and f">{commit}" in text


def test_the_page_of_a_pass_and_of_hostile_names_is_whole() -> None:
    results = {"program:<script>&\x00\udcff": golden.Result()}
    results[next(iter(results))].add(golden.VectorResult("v", "quad", 3, 0))
    text = page(results, {"<b>": "<i>\n"}, [], "pass")
    outline(text)
    assert "program:<" not in text and "<i>" not in text and "\x00" not in text
    assert "program:&lt;script&gt;&amp;\\x00\\udcff" in text and "ended early: &lt;i&gt;" in text
    text.encode("utf-8")


@pytest.mark.slow
def test_a_board_behind_a_link_gives_the_words_around_a_step(folder: Path) -> None:
    (case,) = golden.cases(folder, ["quad"])
    vector = case.vector
    with open_board("virtual") as board:
        assert isinstance(board, GivesWordsOfSteps)
        words = board.words_of_steps(vector.params, vector.raw, vector.setpoint, 20, 25)
    model = run_fixed.run_control(vector.params, vector.raw, vector.setpoint)
    assert words is not None and (words.record == model.record[20:25]).all()


# ---- places that cannot be written ----


@pytest.mark.parametrize("option", ["--junit", "--html"])
def test_a_report_that_cannot_be_written_is_reported_before_anything_runs(
    made: Path, tmp_path: Path, option: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setattr(golden, "check_each", lambda *_: pytest.fail("a board ran"))
    for place in (tmp_path, tmp_path / "file" / "golden", Path("/dev/null/x")):
        assert str(place) in sentence(capsys, made, option, str(place))
    assert "is named twice" in sentence(
        capsys, made, "--junit", str(tmp_path / "one"), "--html", str(tmp_path / "." / "one")
    )
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file"]


# ---- boards that cannot be opened ----


@pytest.mark.parametrize(
    ("arguments", "why"),
    [
        (["--board", "native", "--board", "nativ"], "'nativ' is not a board"),
        (["--board", "virtual", "--image", "none.bin"], "there is no file none.bin"),
        (["--board", "virtual", "--image", "text.bin"], "is not an image for the STM32F103"),
        (["--board", "virtual", "--image", "broken.bin"], "is damaged: its length or checksum is wrong"),
        (["--board", "native", "--image", "text.bin"], "is for board virtual: name virtual among the boards"),
        (["--board", "native", "--board", "program:./none"], "cannot run ./none"),
    ],
)
def test_a_wrong_board_or_image_is_reported_before_any_vector_runs(
    tmp_path: Path, arguments: list[str], why: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """From the command and from Python."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "text.bin").write_text("no vector table")
    if "broken.bin" in arguments:
        image = find_image().read_bytes()
        (tmp_path / "broken.bin").write_bytes(image[:-1] + bytes((image[-1] ^ 1,)))
    monkeypatch.setattr(golden, "cases", lambda *_: pytest.fail("vectors were read"))
    assert front.main(["golden", "check", *arguments]) == 2
    assert why in capsys.readouterr().err
    boards = [board for option, board in pairwise(arguments) if option == "--board"]
    with pytest.raises(plumb.UsageError, match=re.escape(why)):
        plumb.golden.check(boards, image=arguments[-1] if "--image" in arguments else None)


# ---- a program as a board ----


def test_a_shared_library_passes_through_the_example(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, out, err = run(capsys, "--vectors", str(folder), "--board", PORT)
    assert code == 0, out + err
    assert out.count("2 vectors, 120 steps, 0 mismatches") == 2


def compiled(example: str, port: Path) -> None:
    """As the head of the example says."""
    assert shutil.which("cc")
    text = (ROOT / "examples/golden" / example).read_text()
    command = re.sub(r" \*( {4,}|/)|\\\n \*", " ", text[text.index("cc -std") : text.index("plumb golden check")])
    command = " ".join(command.replace("*   ", "").split()).removesuffix(" *").replace("-o port", f"-o {port}")
    strict = command.replace("cc -std", "cc -Wall -Wextra -Wconversion -Wshadow -Werror -std")
    subprocess.run(strict, shell=True, cwd=ROOT, check=True)


def test_the_port_in_c_passes(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    compiled("port.c", tmp_path / "port")
    code, out, err = run(capsys, "--vectors", str(folder), "--board", f"program:{tmp_path}/port")
    assert code == 0, out + err


def test_the_short_port_in_c_passes_its_system(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Its main function is what a port has to write."""
    body = (ROOT / "examples/golden/quad.c").read_text().partition("int main(void) {\n")[2]
    assert body.count("\n") < 35
    compiled("quad.c", tmp_path / "port")
    asked = ("--vector", "quad_hold", "--vector", "quad_retune_*")
    code, out, err = run(capsys, "--board", f"program:{tmp_path}/port", *asked)
    assert code == 0, out + err
    assert re.search(rf"program:{tmp_path}/port: [2-9] vectors, \d+ steps, 0 mismatches", out)
    code, _, err = run(capsys, "--board", f"program:{tmp_path}/port", "--vector", "quad_refusal_adaptive")
    assert code == 3 and "steps and retunes alone: choose them with --vector" in err


def test_a_wrong_port_is_traced_to_its_signal(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """With the words to the signal, without them to the step."""
    wrong = tmp_path / "wrong.py"
    text = LIBRARY.read_text()
    kept = "\n    records.append("
    spoil = "\n    if step >= 25:\n        words[24] = (words[24][0] ^ 1).to_bytes(1, 'little')"
    assert kept in text
    wrong.write_text(text.replace(kept, spoil + kept))
    board = f"program:{PYTHON} {wrong} {native_core.core_path()}"
    shown = tmp_path / "golden.html"
    code, out, _ = run(
        capsys, "--vectors", str(folder), "--board", board, "--vector", "steps_*", "--json", "--html", str(shown)
    )
    first = json.loads(out)["boards"][board]["first_divergence"]
    assert (code, first["step"], first["signal"]) == (1, 25, "setpoint_turn_q32")
    assert outline(shown.read_text()).labels
    wrong.write_text(wrong.read_text().replace('vector["report"] == "words"', "False"))
    code, out, _ = run(
        capsys, "--vectors", str(folder), "--board", board, "--vector", "steps_*", "--json", "--html", str(shown)
    )
    first = json.loads(out)["boards"][board]["first_divergence"]
    assert (code, first["step"], first["signal"]) == (1, 25, "digest")
    assert outline(shown.read_text()).labels


PROGRAMS = {
    "no digest": ("print('hello')", 3, "8 hexadecimal digits"),
    "empty lines": ("print(); print()", 3, "8 hexadecimal digits"),
    "binary": ("import sys; sys.stdout.buffer.write(bytes(range(256)) * 99)", 3, "printed"),
    "one long line": ("print('0' * 9999)", 3, "line of more than"),
    "a crash": ("raise SystemExit('out of order')", 3, "code 1: out of order"),
    "a signal": ("import os; os.kill(os.getpid(), 9)", 3, "code -9"),
    "no such parameters": ("import sys; sys.exit(9)", 3, "it said nothing"),
    "without end": ("while True: print('0' * 4000)", 3, "without end"),
}


@pytest.mark.parametrize("kind", PROGRAMS)
def test_a_program_that_misbehaves_is_one_sentence(
    folder: Path, tmp_path: Path, kind: str, capsys: pytest.CaptureFixture[str]
) -> None:
    text, code, why = PROGRAMS[kind]
    (tmp_path / "bad.py").write_text(text)
    board = f"program:{PYTHON} {tmp_path}/bad.py"
    assert why in sentence(capsys, folder, "--board", board, "--vector", "walk_two", code=code)


def test_a_program_that_hangs_is_stopped(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("plumb.boards.program.START_UP_S", 0.2)
    assert "did not finish" in sentence(capsys, folder, "--board", "program:sleep 1000", code=3)


@pytest.mark.parametrize("printed", [[], ["00000000"] * 7, ["00000000"] * 900])
def test_too_few_and_too_many_digests_are_mismatches(
    folder: Path, tmp_path: Path, printed: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "some.py").write_text(f"print({chr(10).join(printed)!r}) if {bool(printed)} else None")
    board = f"program:{PYTHON} {tmp_path}/some.py"
    code, out, _ = run(capsys, "--vectors", str(folder), "--board", board, "--json", "--html", str(tmp_path / "p.html"))
    assert code == 1 and json.loads(out)["boards"][board]["bit_exact"] is False


@pytest.mark.parametrize("board", ["program:", "program:''x'", "program:   ", "program:/no/such/port", "program:/tmp"])
def test_a_program_that_is_none_is_wrong_use(folder: Path, board: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert "program" in sentence(capsys, folder, "--board", board)


def test_other_commands_say_what_a_program_cannot(capsys: pytest.CaptureFixture[str]) -> None:
    assert front.main(["monitor", "--board", "program:true", "--seconds", "1"]) == 2
    assert front.main(["run", "quad", "--board", "program:true", "--seconds", "1"]) in (2, 3)
    assert "defect" not in capsys.readouterr().err


def test_the_text_of_a_vector_is_what_the_page_says(folder: Path) -> None:
    (case,) = golden.cases(folder, ["balancer"])
    vector = case.vector
    lines = vector_text(vector.params, vector.raw, vector.setpoint, name=vector.name).splitlines()
    assert lines[:3] == ["plumb-program 1", "vector walk_two", "system balancer"]
    head = lines.index("steps 30")
    assert [line.split()[2] for line in lines[:head] if line.startswith("param ")] == [
        str(word) for word in vector.params.words()
    ]
    samples = np.array([line.split() for line in lines[head + 1 :]], int)
    assert (samples[:, :6] == vector.raw).all() and (samples[:, 6] == vector.setpoint).all()
