"""The film of README and docs home: its size, its length, where it is shown, and the scenes that it is made of."""

from __future__ import annotations

import struct
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

from plumb import systems
from plumb.systems.steered import PARTS, steered

ROOT = Path(__file__).resolve().parents[2]
FILM = ROOT / "docs" / "images" / "flight.webp"
SCENES = sorted((ROOT / "tools" / "films").glob("*.toml"))
MOST_BYTES, LEAST_S, MOST_S, LEAST_PICTURES_PER_S = 3_000_000, 15.0, 40.0, 10
GHOSTS = {"estimate", "VQF", "Mahony"}
HANDS = {"motors", "mode", "height"}, {"up", "yaw", "roll", "pitch"}


def chunks(data: bytes) -> Iterator[tuple[bytes, bytes]]:
    """The chunks of a WebP: kind and contents."""
    assert data[:4] == b"RIFF" and data[8:12] == b"WEBP" and struct.unpack("<I", data[4:8])[0] + 8 == len(data)
    at = 12
    while at < len(data):
        size = struct.unpack("<I", data[at + 4 : at + 8])[0]
        yield data[at : at + 4], data[at + 8 : at + 8 + size]
        at += 8 + size + size % 2


def test_the_film_is_small_and_long_enough() -> None:
    data = FILM.read_bytes()
    assert len(data) < MOST_BYTES
    durations_ms = [int.from_bytes(body[12:15], "little") for kind, body in chunks(data) if kind == b"ANMF"]
    assert LEAST_S < sum(durations_ms) / 1000 < MOST_S
    assert len(durations_ms) > LEAST_PICTURES_PER_S * LEAST_S and max(durations_ms[:-1]) <= 100
    body = next(body for kind, body in chunks(data) if kind == b"ANIM")
    assert struct.unpack("<H", body[4:6])[0] == 0, "it begins again"


@pytest.mark.parametrize("page", ["README.md", "docs/index.md"])
def test_it_is_the_first_picture_of_a_page(page: str) -> None:
    text = (ROOT / page).read_text(encoding="utf-8")
    first = text.index("](", text.index("!["))
    assert text[first:].startswith(("](docs/images/flight.webp)", "](images/flight.webp)"))
    assert text[: text.index("![")].count("\n") < 6, "it is above the fold"


def test_a_package_does_not_hold_it() -> None:
    built = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["scikit-build"]
    assert "docs/images/*.webp" in built["sdist"]["exclude"] and built["wheel"]["packages"] == ["host/plumb"]


@pytest.mark.parametrize("path", SCENES, ids=lambda path: path.stem)
def test_a_scene_names_what_there_is(path: Path) -> None:
    said = tomllib.loads(path.read_text(encoding="utf-8"))
    if not any(said["system"] in systems.with_part(part.name) for part in PARTS):
        pytest.skip(f"nobody steers a declared system {said['system']}")
    events = {*steered(said["system"]).EVENTS, "lost", *GHOSTS}
    times = [move["at_s"] for move in said["moves"]]
    assert times == sorted(times) and times[-1] < said["seconds"]
    buttons, axes = HANDS
    for move in said["moves"]:
        assert move.keys() <= {"at_s", "press", "axes", "click"} and move.get("axes", {}).keys() <= axes
        assert {move.get("click", "lost")} <= events and {move.get("press", "mode")} <= buttons


def test_it_shows_all_that_can_be_steered() -> None:
    shown = {tomllib.loads(path.read_text(encoding="utf-8"))["system"] for path in SCENES}
    assert shown and {name for part in PARTS for name in systems.with_part(part.name)} <= shown
