"""The flash images by name: which systems each holds and what it may take, from images.toml and the declarations."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from plumb.errors import UsageError
from plumb.spec import declarations, images

TOYS = Path(__file__).resolve().parents[1] / "toy_systems"
FIRST, VEHICLES = declarations.names()[0], images.images()["vehicles"].systems
LEFT_OUT = [name for name in declarations.names() if name not in VEHICLES][-1]
"""A system of none of the sets but `all`."""
ALONE = next(iter(images.left_out_of_all()))
C8_FLASH, C8_RAM = 60 * 1024, 20 * 1024
"""Flash below the parameters of an STM32F103C8, and its RAM."""


def test_there_is_an_image_of_each_system_of_each_set_and_of_all() -> None:
    found, systems = images.images(), declarations.systems()
    sets = {name for system in systems.values() for name in system.images}
    assert list(found) == [*systems, *sorted(sets), images.ALL]
    for name, image in found.items():
        declared = [
            one
            for one, system in systems.items()
            if name == one or name in system.images or (name == images.ALL and system.in_all)
        ]
        assert (image.name, list(image.systems)) == (name, declared)
    assert sets and all(len(found[name].systems) > 1 for name in sets)


def test_every_image_may_take_what_a_c8_has_and_the_smaller_less() -> None:
    found = images.images()
    assert found[images.ALL].ram_bytes < C8_RAM
    for image in found.values():
        assert image.flash_bytes <= C8_FLASH and image.ram_bytes <= found[images.ALL].ram_bytes


def test_a_system_may_say_how_much_flash_its_own_image_takes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shutil.copytree(TOYS, tmp_path, dirs_exist_ok=True)
    declared = tmp_path / "toy" / "system.toml"
    text = declared.read_text(encoding="utf-8")
    declared.write_text(f"flash_kib = 41\n{text}", encoding="utf-8")
    monkeypatch.setenv(declarations.SEARCH_PATH, str(tmp_path))
    assert images.image("toy").flash_bytes == 41 * 1024
    for wrong in ("0", "61", "32.5", '"32"'):
        declared.write_text(f"flash_kib = {wrong}\n{text}", encoding="utf-8")
        with pytest.raises(UsageError, match=r"system\.toml: flash_kib is a whole number of 1 to 60, not "):
            declarations.load_system(tmp_path / "toy")


def test_a_new_system_has_an_image_and_is_in_all_without_an_edit(monkeypatch: pytest.MonkeyPatch) -> None:
    before = images.images()
    monkeypatch.setenv(declarations.SEARCH_PATH, str(TOYS))
    after = images.images()
    assert set(after) - set(before) == {"toy"}
    assert after["toy"].systems == ("toy",) and set(after[images.ALL].systems) == {*before[images.ALL].systems, "toy"}


def test_all_leaves_out_a_system_that_says_so_and_keeps_its_parameters() -> None:
    left_out = images.left_out_of_all()
    systems = declarations.systems()
    assert set(left_out) == {name for name, system in systems.items() if not system.in_all} != set()
    held = images.images()[images.ALL].systems
    assert not set(left_out) & set(held)
    assert images.held_groups(held) == images.held_groups(tuple(systems)) > images.held_groups(held[:1])


def test_a_system_lists_the_sets_that_it_is_in(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shutil.copytree(TOYS, tmp_path, dirs_exist_ok=True)
    declared = tmp_path / "toy" / "system.toml"
    text = declared.read_text(encoding="utf-8")
    declared.write_text('images = ["vehicles"]\n' + text, encoding="utf-8")
    monkeypatch.setenv(declarations.SEARCH_PATH, str(tmp_path))
    assert images.image("vehicles").systems[-1] == "toy"
    for wrong in ('["vehicle"]', '["all"]', '["alone"]', "[7]"):
        declared.write_text(f"images = {wrong}\n{text}", encoding="utf-8")
        with pytest.raises(UsageError, match=r"system\.toml: images: there is no set .*; images\.toml has vehicles"):
            declarations.load_system(tmp_path / "toy")
    declared.write_text(text, encoding="utf-8")
    (tmp_path / "toy").rename(tmp_path / "vehicles")
    (tmp_path / "judging" / "toy").rename(tmp_path / "judging" / "vehicles")
    with pytest.raises(UsageError, match="'vehicles' is the name of a set of images; rename the folder"):
        declarations.load_system(tmp_path / "vehicles")


def test_a_build_asks_by_the_name_of_an_image_or_by_names_of_systems() -> None:
    found = images.images()
    assert images.asked([]) == images.asked(["all"]) == found["all"]
    assert images.asked([LEFT_OUT]) == found[LEFT_OUT]
    assert images.asked([*reversed(found["vehicles"].systems)]) == found["vehicles"] == images.asked(["vehicles"])
    other = images.asked([LEFT_OUT, FIRST])
    assert other == images.Image("", (FIRST, LEFT_OUT), found["all"].flash_bytes, found["all"].ram_bytes)
    for wrong in (["nothing"], [FIRST, "vehicles"]):
        with pytest.raises(UsageError, match=f"there is no (image|system) '{wrong[-1]}'"):
            images.asked(wrong)


@pytest.mark.parametrize(
    ("wanted", "present", "flashed"),
    [
        (VEHICLES[-1], VEHICLES[:1], "vehicles"),
        (VEHICLES[-1], VEHICLES[:-1], "vehicles"),
        (LEFT_OUT, (FIRST,), "all"),
        (LEFT_OUT, (), LEFT_OUT),
    ],
)
def test_the_image_to_flash_keeps_the_systems_of_the_board(wanted: str, present: tuple[str, ...], flashed: str) -> None:
    sentence = images.lacking(wanted, present)
    assert f"the board's image has no {wanted}, only " in sentence
    assert f"plumb flash --image {flashed} has it" in sentence
    assert all(name in sentence for name in present)
    others = {one.name for one in images.holding([wanted])} - {flashed}
    said = sentence.partition("so have the images " if len(others) > 1 else "so has the image ")[2]
    assert others and all(name in said for name in others)


def test_an_image_that_loses_systems_says_so() -> None:
    """No image holds a system that `all` leaves out together with all the others."""
    present = images.image("all").systems
    lost = [name for name in present if name not in images.image(ALONE).systems]
    assert lost and f"plumb flash --image {ALONE} has it, but not {', '.join(lost)}; so ha" in images.lacking(
        ALONE, present
    )
