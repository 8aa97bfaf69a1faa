"""An image that is named by its name: found among the builds, flashed through the ROM bootloader, run by the virtual
board; and what an image that does not fit says."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from plumb.__main__ import main
from plumb.errors import UsageError
from plumb.flash import named_images
from plumb.flash.call_graph import CallGraph
from plumb.flash.image import find_image
from plumb.flash.left_out import saved_bytes, systems_in
from plumb.spec import images
from support.linked_images import with_flash_limit
from support.made_image import made_image

ROOT = Path(__file__).parents[2]
BUILD = ROOT / "build/stm32f103/firmware.elf"
needs_image = pytest.mark.skipif(not BUILD.exists(), reason="the flash image is not built: run make image")


@pytest.fixture
def checkout(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A checkout in which the image `vehicles` is built, and nothing else."""
    built = tmp_path / "checkout" / "build" / "images" / "vehicles" / "firmware.bin"
    built.parent.mkdir(parents=True)
    built.write_bytes(made_image(2100))
    monkeypatch.setattr(named_images, "CHECKOUT", tmp_path / "checkout")
    monkeypatch.setattr(named_images, "packaged_image", lambda name: None)
    monkeypatch.setattr(named_images, "packaged_images", dict)
    monkeypatch.chdir(tmp_path)
    return built


def test_a_build_is_found_by_its_name_and_a_file_comes_first(checkout: Path, tmp_path: Path) -> None:
    assert find_image(Path("vehicles")) == checkout
    (tmp_path / "vehicles").write_bytes(b"")
    assert find_image(Path("vehicles")) == Path("vehicles")


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        (None, "there is no flash image; build one with 'make image'"),
        ("quad", "the image quad is not built: build it with 'make images'"),
        ("vehicle", r"there is no file vehicle, and no image of that name \(did you mean vehicles\?\): 'make images'"),
        ("nothere.bin", "there is no file nothere.bin, and no image of that name: 'make images' builds quad, "),
        (".", "^. is a folder, no flash image; name a file$"),
        ("/dev/null", "^/dev/null is a device, no flash image; name a file$"),
    ],
)
def test_an_image_that_is_not_there_is_named(checkout: Path, asked: str | None, said: str) -> None:
    with pytest.raises(UsageError, match=said):
        find_image(None if asked is None else Path(asked))


def test_the_simulated_bootloader_gets_the_image_of_that_name(
    checkout: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("pty", reason="the simulated bootloader needs a pseudo-terminal")
    pytest.importorskip("stm32loader", reason="stm32loader is not installed: the extra flash")
    from support.bootloader import Bootloader

    with Bootloader() as chip:
        code = main(["flash", "--port", chip.port, "--image", "vehicles", "--wait", "2", "--json"])
        held = bytes(chip.flash[:2100])
    said = json.loads(capsys.readouterr().out)
    assert (code, said["verdict"], said["image"]) == (0, "pass", str(checkout))
    assert held == checkout.read_bytes()


@needs_image
def test_an_image_that_does_not_fit_says_by_how_much_and_what_to_leave_out(tmp_path: Path) -> None:
    elf = tmp_path / "firmware.elf"
    shutil.copy(BUILD, elf)
    graph = CallGraph(elf)
    taken = graph.elf.flash_bytes
    check = [sys.executable, str(ROOT / "tools/check_elf.py"), str(with_flash_limit(elf, taken - 1000))]
    done = subprocess.run(check, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert (
        f"takes {taken} bytes of flash, 1000 more than the {taken - 1000} that it may take; leave out " in done.stderr
    )
    sizes = {name: saved_bytes(graph, name) for name in images.image(images.ALL).systems}
    assert systems_in(graph) == list(sizes)
    for name, size in sizes.items():
        assert (f"{name} ({size} bytes of code)" in done.stderr) is (size > 0), "another system may stand on it"
    assert 0 < sum(sizes.values()) < taken
