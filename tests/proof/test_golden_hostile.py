"""Golden files, manifest and recipe are not trusted: whatever stands in them, a check ends in one sentence and code 2.

The folder of every test holds two small vectors, of quad and of balancer. `sealed` gives damaged bytes a right check
value, so that what stands behind the CRC is tried, too.
"""

from __future__ import annotations

import hashlib
import json
import os
import random
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import plumb.__main__ as front
from plumb.boards.native import core as native_core
from plumb.contract.parameters import ControlParams, quantise
from plumb.errors import UsageError
from plumb.proof import golden, golden_manifest, golden_recipe
from plumb.proof.golden_file import FORMAT, MAX_FILE_BYTES, SUFFIX, Vector, sealed
from plumb.spec import declarations
from plumb.systems.quad import scenarios as quad
from support.campaigns import campaign

FOLDER = Path(__file__).parents[1] / "vectors"
RECIPE = """
[[vector]]
name = "one"
system = "quad"
tuning = "adaptive"
wild = "steps"
seed = 5
steps = 30
on_link = true

[[vector]]
name = "two"
system = "balancer"
tuning = "tuned"
wild = "walk"
seed = 6
steps = 30
"""


def sentence(capsys: pytest.CaptureFixture[str], folder: Path) -> str:
    """What `golden check` says of the folder: one line on stderr, exit code 2, nothing on stdout."""
    code = front.main(["golden", "check", "--board", "native", "--vectors", str(folder), "--json"])
    out, err = capsys.readouterr()
    assert (code, out) == (2, ""), err
    assert err.count("\n") == 1 and err.startswith("plumb: ") and "Traceback" not in err and "defect" not in err
    return err


def header_and_payload(path: Path) -> tuple[dict[str, Any], bytes]:
    line, _, rest = path.read_bytes().partition(b"\n")
    return json.loads(line), rest[:-4]


def put(folder: Path, data: bytes, name: str = "one") -> None:
    """The file, and its row of the manifest, as if `golden make` had written them."""
    (folder / (name + SUFFIX)).write_bytes(data)
    rows = golden_manifest.read(folder)
    digest = hashlib.sha256(data).hexdigest()
    golden_manifest.write(folder, [replace(row, sha256=digest) if row.name == name else row for row in rows])


# ---- damage ----


def test_the_undamaged_folder_passes(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert front.main(["golden", "check", "--board", "native", "--vectors", str(folder), "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["verdict"] == "pass"
    assert {name: (row["vectors"], row["steps"]) for name, row in report["boards"].items()} == {
        "fixed": (2, 60),
        "native": (2, 60),
    }


def test_every_inverted_bit_of_a_header_is_seen(made: Path) -> None:
    path = made / "one.golden"
    data = path.read_bytes()
    for at in range(data.index(b"\n") + 1):
        for bit in range(8):
            damaged = data[:at] + bytes([data[at] ^ 1 << bit]) + data[at + 1 :]
            with pytest.raises(UsageError, match="plumb golden make"):
                Vector.decode(damaged, path)


def test_every_inverted_bit_behind_the_header_is_seen(made: Path) -> None:
    path = made / "one.golden"
    data = path.read_bytes()
    for at in range(data.index(b"\n") + 1, len(data)):
        for bit in range(8):
            with pytest.raises(UsageError, match="damaged"):
                Vector.decode(data[:at] + bytes([data[at] ^ 1 << bit]) + data[at + 1 :], path)


def test_every_shorter_file_is_refused(made: Path) -> None:
    path = made / "two.golden"
    data = path.read_bytes()
    for length in range(len(data)):
        with pytest.raises(UsageError):
            Vector.decode(data[:length], path)


@pytest.mark.parametrize("seed", range(40))
def test_random_damage_never_passes(folder: Path, seed: int, capsys: pytest.CaptureFixture[str]) -> None:
    """Cut out, doubled, overwritten pieces; half of the files with a right check value, known to the manifest.

    A file that is whole in form but holds other counts or digests is a mismatch: verdict fail, code 1.
    """
    rng = random.Random(seed)
    path = folder / "one.golden"
    data = bytearray(path.read_bytes())
    for _ in range(rng.randrange(1, 4)):
        at = rng.randrange(len(data))
        length = rng.randrange(1, 40)
        piece = rng.choice([b"", bytes(data[at : at + length]) * 2, rng.randbytes(length), b"9" * length, b"[" * 3000])
        data[at : at + length] = piece
    put(folder, sealed(bytes(data[:-4])) if seed % 2 else bytes(data))
    code = front.main(["golden", "check", "--board", "native", "--vectors", str(folder), "--json"])
    out, err = capsys.readouterr()
    if code == 1 and seed % 2:
        assert json.loads(out)["verdict"] == "fail" and err == ""
    else:
        assert code == 2 and out == "" and err.count("\n") == 1 and "defect" not in err


@pytest.mark.slow
def test_a_changed_byte_passes_only_where_it_changes_nothing(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Every file with one byte changed is refused. With a right check value, known to the manifest, it is refused, or
    its verdict is fail, unless the byte is of a count that no output depends on: one that the step replaces, or that
    rounding leaves without effect. Then all else is as it was, the digests of every step included."""
    rng = random.Random(1)
    path = folder / "one.golden"
    good, data = Vector.read(path), path.read_bytes()
    header, codes = data.index(b"\n"), {0: 0, 1: 0, 2: 0}
    for _ in range(campaign(100, 2000)):
        at = rng.randrange(len(data) - 4)
        others = b"0123456789" if at < header and data[at : at + 1].isdigit() else bytes(range(256))
        changed = data[:at] + bytes([rng.choice(others.replace(data[at : at + 1], b""))]) + data[at + 1 :]
        with pytest.raises(UsageError):
            Vector.decode(changed, path)
        put(folder, sealed(changed[:-4]))
        code = front.main(["golden", "check", "--board", "native", "--vectors", str(folder), "--json"])
        codes[code] += 1
        capsys.readouterr()
        if code == 0:
            found = Vector.read(path)
            assert replace(found, raw=good.raw).encode() == data, f"byte {at}"
            assert not np.array_equal(found.raw, good.raw), f"byte {at}"
    assert codes[1] and codes[2], codes


# ---- a right check value, and a header that lies ----

DEEP = "[" * 50_000 + "]" * 50_000


def with_header(**changes: Any) -> Callable[[dict[str, Any]], str]:
    return lambda header: json.dumps({**header, **changes})


def with_param(value: Any) -> Callable[[dict[str, Any]], str]:
    return lambda header: json.dumps({**header, "params": {**header["params"], "kalman.dt_s_q33": value}})


LIES: dict[str, Callable[[dict[str, Any]], str]] = {
    "another name": with_header(name="two"),
    "a name that leads out": with_header(name="../one"),
    "a name that is a number": with_header(name=1),
    "another system": with_header(system=next(name for name in declarations.names() if name != "quad")),
    "no system": with_header(system="boat"),
    "a system that is a list": with_header(system=["quad"]),
    "on_link 1": with_header(on_link=1),
    "on_link false": with_header(on_link=False),
    "more steps": with_header(steps=31),
    "fewer steps": with_header(steps=29),
    "no steps": with_header(steps=0),
    "negative steps": with_header(steps=-1),
    "huge steps": with_header(steps=1 << 60),
    "steps beyond any integer": with_header(steps=10**4000),
    "steps true": with_header(steps=True),
    "steps 30.0": with_header(steps=30.0),
    "steps in text": with_header(steps="30"),
    "no columns": with_header(columns=[]),
    "columns not a list": with_header(columns=3),
    "columns twice": with_header(columns=[0, 0, 1, 2, 3, 4]),
    "negative columns": with_header(columns=[-1, 0, 1, 2, 3, 4]),
    "columns out of range": with_header(columns=[0, 1, 2, 3, 4, 6]),
    "columns out of order": with_header(columns=[1, 0, 2, 3, 4, 5]),
    "setpoint of 33 bits": with_header(setpoint=1 << 32),
    "setpoint in text": with_header(setpoint="0"),
    "setpoint NaN": with_header(setpoint=float("nan")),
    "setpoint infinite": with_header(setpoint=float("-inf")),
    "parameters a list": with_header(params=[1, 2]),
    "no parameters": with_header(params={}),
    "a parameter NaN": with_param(float("nan")),
    "a parameter in text": with_param("1"),
    "a parameter null": with_param(None),
    "a parameter 0": with_param(0),
    "a parameter of 70 bits": with_param(1 << 70),
    "a parameter that is another": lambda h: json.dumps(
        {**h, "params": {**h["params"], "gyro.gain": h["params"]["gyro.gain"] ^ 1}}
    ),
    "every parameter 0": lambda header: json.dumps({**header, "params": dict.fromkeys(header["params"], 0)}),
    "a former name of a parameter": lambda header: json.dumps(header).replace("accel.gain", "accel_y.gain"),
    "no final words": with_header(final={}),
    "final words null": with_header(final=None),
    "a field too many": with_header(more=1),
    "a field missing": lambda header: json.dumps({key: value for key, value in header.items() if key != "final"}),
    "the format before": with_header(format="plumb golden 2"),
    "a format of the future": with_header(format="plumb golden 4"),
    "a format that is a list": with_header(format=[FORMAT]),
    "a key twice": lambda header: json.dumps(header)[:-1] + ', "steps": 30}',
    "a key twice inside": lambda header: json.dumps(header).replace('"params": {', '"params": {"gyro.gain": 1, '),
    "a header that is a list": lambda header: json.dumps([header]),
    "a header that is null": lambda _: "null",
    "a header that is a number": lambda _: "7",
    "a header that is no UTF-8": lambda header: json.dumps(header).replace("quad", "q\udcffad"),
    "an empty header": lambda _: "",
    "a deep header": lambda _: DEEP[:60_000],
    "a deep field": lambda header: json.dumps(header).replace('"params": {', f'"params": {"[" * 20_000}{{'),
    "a header that never ends": lambda _: " " * (1 << 17),
}


@pytest.mark.parametrize("lie", LIES)
def test_a_header_that_lies_is_refused(folder: Path, lie: str, capsys: pytest.CaptureFixture[str]) -> None:
    header, payload = header_and_payload(folder / "one.golden")
    put(folder, sealed(LIES[lie](header).encode(errors="surrogateescape") + b"\n" + payload))
    sentence(capsys, folder)


def test_a_file_that_is_none_is_refused(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = folder / "one.golden"
    path.unlink()
    assert "cannot be read" in sentence(capsys, folder)
    path.mkdir()
    assert "is not a file" in sentence(capsys, folder)
    path.rmdir()
    path.symlink_to("/dev/zero")
    assert "is not a file" in sentence(capsys, folder)
    path.unlink()
    os.mkfifo(path)
    assert "is not a file" in sentence(capsys, folder)
    path.unlink()
    with path.open("wb") as file:
        file.truncate(MAX_FILE_BYTES + 1)  # sparse: takes no room
    assert "larger" in sentence(capsys, folder)


# ---- vectors that are not the ones of the recipe ----


def test_the_file_of_another_system_is_refused(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    put(folder, (folder / "one.golden").read_bytes(), "two")
    assert "two names have the same file" in sentence(capsys, folder)
    shutil.rmtree(folder)
    shutil.copytree(FOLDER, folder)
    shutil.copy(folder / "quad_motion_adaptive.golden", folder / "balancer_rough_tuned.golden")
    assert "says name quad_motion_adaptive" in sentence(capsys, folder)


def test_copies_of_one_vector_are_refused(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    shutil.rmtree(folder)
    shutil.copytree(FOLDER, folder)
    one = (folder / "wild_uniform_link.golden").read_bytes()
    for path in folder.glob("*" + SUFFIX):
        path.write_bytes(one)
    assert "says name wild_uniform_link" in sentence(capsys, folder)


def test_one_recipe_entry_repeated_is_refused(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    entry = RECIPE.split("[[vector]]")[1]
    (folder / golden_recipe.RECIPE).write_text(("[[vector]]" + entry) * 55)
    assert "names one twice" in sentence(capsys, folder)


def test_a_vector_missing_from_the_recipe_is_refused(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / golden_recipe.RECIPE).write_text(RECIPE[: RECIPE.rindex("[[vector]]")])
    assert "lacks two" in sentence(capsys, folder)


def test_a_recipe_that_asks_for_less_is_refused(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / golden_recipe.RECIPE).write_text(RECIPE.replace("steps = 30", "steps = 3"))
    assert "does not list one as the recipe does" in sentence(capsys, folder)


def test_other_inputs_with_right_digests_are_refused(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A whole vector of the same name, parameters and length, but of another seed: only the manifest knows."""
    entry = golden_recipe.read(folder)[0]
    (folder / "one.golden").write_bytes(golden.build(replace(entry, seed=99)).encode())
    assert "is not the file that manifest.json lists" in sentence(capsys, folder)


def test_a_folder_without_manifest_is_refused(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / golden_manifest.MANIFEST).unlink()
    assert "plumb golden make" in sentence(capsys, folder)


MANIFESTS: dict[str, Callable[[dict[str, Any]], str]] = {
    "empty": lambda _: "",
    "null": lambda _: "null",
    "deep": lambda _: DEEP,
    "no vectors": lambda whole: json.dumps({**whole, "vectors": []}),
    "vectors null": lambda whole: json.dumps({**whole, "vectors": None}),
    "a vector null": lambda whole: json.dumps({**whole, "vectors": [None]}),
    "half": lambda whole: json.dumps({**whole, "vectors": whole["vectors"][:1]}),
    "twice": lambda whole: json.dumps({**whole, "vectors": whole["vectors"] * 2}),
    "key twice": lambda whole: json.dumps(whole)[:-1] + ', "vectors": []}',
    "NaN": lambda whole: json.dumps(whole).replace("30", "NaN", 1),
    "float": lambda whole: json.dumps(whole).replace("30", "30.0", 1),
    "another digest": lambda whole: json.dumps(whole).replace('"sha256": "', '"sha256": "0', 1),
    "another format": lambda whole: json.dumps({**whole, "format": "plumb golden manifest 9"}),
    "names lead out": lambda whole: json.dumps(whole).replace('"one"', '"../one"'),
}


@pytest.mark.parametrize("kind", MANIFESTS)
def test_a_wrong_manifest_is_refused(folder: Path, kind: str, capsys: pytest.CaptureFixture[str]) -> None:
    path = folder / golden_manifest.MANIFEST
    path.write_text(MANIFESTS[kind](json.loads(path.read_text())))
    sentence(capsys, folder)


# ---- recipes ----

RECIPES = {
    "leads out": ('name = "one"', 'name = "../one"'),
    "absolute": ('name = "one"', 'name = "/tmp/one"'),
    "backslash": ('name = "one"', "name = 'a\\one'"),
    "dot": ('name = "one"', 'name = "."'),
    "empty name": ('name = "one"', 'name = ""'),
    "capital": ('name = "one"', 'name = "One"'),
    "newline": ('name = "one"', 'name = "one\\n"'),
    "long name": ('name = "one"', f'name = "{"a" * 65}"'),
    "number for a name": ('name = "one"', "name = 1"),
    "no name": ('name = "one"', ""),
    "no system": ('system = "quad"', ""),
    "unknown system": ('system = "quad"', 'system = "boat"'),
    "system list": ('system = "quad"', 'system = ["quad"]'),
    "system path": ('system = "quad"', 'system = "../quad"'),
    "unknown tuning": ('tuning = "adaptive"', 'tuning = "none"'),
    "tuning number": ('tuning = "adaptive"', "tuning = 3"),
    "unknown wild": ('wild = "steps"', 'wild = "mild"'),
    "unknown scenario": ('wild = "steps"', 'scenario = "mild"'),
    "wild and scenario": ('wild = "steps"', 'wild = "steps"\nscenario = "motion"'),
    "neither": ('wild = "steps"', ""),
    "no steps": ("steps = 30", "steps = 0"),
    "negative steps": ("steps = 30", "steps = -1"),
    "huge steps": ("steps = 30", "steps = 9000000000000000000"),
    "steps beyond 64 bits": ("steps = 30", "steps = 90000000000000000000000000"),
    "float steps": ("steps = 30", "steps = 30.0"),
    "true steps": ("steps = 30", "steps = true"),
    "nan steps": ("steps = 30", "steps = nan"),
    "negative seed": ("seed = 5", "seed = -5"),
    "huge seed": ("seed = 5", "seed = 1000000000000000000"),
    "text seed": ("seed = 5", 'seed = "5"'),
    "on_link 1": ("on_link = true", "on_link = 1"),
    "unknown field": ("on_link = true", "on_links = true"),
    "field twice": ("on_link = true", "on_link = true\non_link = true"),
    "set a list": ("on_link = true", "set = [1]"),
    "set unknown": ("on_link = true", 'set = {"kalman.nothing" = 1.0}'),
    "set unknown inside": ("on_link = true", 'set = {"nothing.nothing.nothing" = 1.0}'),
    "set the class": ("on_link = true", 'set = {"__class__.x" = 1}'),
    "set empty path": ("on_link = true", 'set = {"" = 1}'),
    "set a group": ("on_link = true", "set = {kalman = 1.0}"),
    "set text": ("on_link = true", 'set = {"kalman.q_angle_deg2_per_s" = "x"}'),
    "set nan": ("on_link = true", 'set = {"kalman.q_angle_deg2_per_s" = nan}'),
    "set inf": ("on_link = true", 'set = {"kalman.q_angle_deg2_per_s" = inf}'),
    "set negative": ("on_link = true", 'set = {"kalman.q_angle_deg2_per_s" = -1.0}'),
    "set zero period": ("on_link = true", "set = {period_us = 0}"),
    "set huge period": ("on_link = true", "set = {period_us = 1000000000000000000}"),
    "deep": ("on_link = true", f"set = {'[' * 5000}{']' * 5000}"),
    "no TOML": ("[[vector]]", "[[vector"),
    "one table": ("[[vector]]", "[vector]"),
    "vectors a number": (RECIPE, "vector = 3"),
    "vectors of numbers": (RECIPE, "vector = [1, 2]"),
    "empty": (RECIPE, ""),
    "no vector": (RECIPE, "[[others]]\nname = 'one'"),
}


@pytest.mark.parametrize("action", ["check", "make"])
@pytest.mark.parametrize("kind", RECIPES)
def test_a_wrong_recipe_is_refused(folder: Path, kind: str, action: str, capsys: pytest.CaptureFixture[str]) -> None:
    old, new = RECIPES[kind]
    (folder / golden_recipe.RECIPE).write_text(RECIPE.replace(old, new, -1 if old == "[[vector]]" else 1))
    before = sorted(folder.parent.rglob("*"))
    code = front.main(["golden", action, "--vectors", str(folder)])
    out, err = capsys.readouterr()
    assert (code, out) == (2, "") and err.count("\n") == 1 and "defect" not in err, err
    assert sorted(folder.parent.rglob("*")) == before, "nothing was written"


def test_a_recipe_that_is_no_text_is_refused(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / golden_recipe.RECIPE).write_bytes(b"\xff\xfe" + RECIPE.encode())
    assert "recipe.toml is no text" in sentence(capsys, folder)
    (folder / golden_recipe.RECIPE).write_text("#" * (golden_recipe.MAX_BYTES + 1))
    assert "has more than 1 MiB" in sentence(capsys, folder)


# ---- parameters ----


def zero_parameters() -> ControlParams:
    params = quantise(quad.TUNINGS["adaptive"])
    return replace(params, values={name: 0 for name in params.values} | {"system": declarations.system("quad").number})


def test_the_core_is_not_called_with_parameters_that_it_refuses() -> None:
    """Zeros made it divide by zero, which killed the process."""
    zeros = zero_parameters()
    assert not native_core.params_valid(zeros)
    for call in (
        lambda: native_core.run_control(zeros, [[0] * 6], [0]),
        lambda: native_core.Controller(zeros),
        lambda: native_core.kalman_run(zeros, [1], [1], [1]),
        lambda: native_core.tilt_and_trust(zeros, [1], [1]),
    ):
        with pytest.raises(UsageError, match="refuses"):
            call()


# ---- the committed vectors ----


def test_the_manifest_lists_every_vector_of_the_recipe() -> None:
    entries = golden_recipe.read(FOLDER)
    rows = golden_manifest.read(FOLDER)
    assert [row.name for row in rows] == [entry.name for entry in entries]
    assert all(row.describes(entry) for row, entry in zip(rows, entries, strict=True))
    files = {path.stem: hashlib.sha256(path.read_bytes()).hexdigest() for path in FOLDER.glob("*" + SUFFIX)}
    assert files == {row.name: row.sha256 for row in rows}
