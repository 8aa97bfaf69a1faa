"""Finds a flash image by its name (`plumb.spec.images`): the build of this checkout, else the package's."""

from __future__ import annotations

from pathlib import Path

from plumb.checkout import CHECKOUT, IN_CHECKOUT
from plumb.errors import UsageError
from plumb.flash.packaged_images import packaged_image, packaged_images
from plumb.near_names import did_you_mean
from plumb.spec import images


def build_of(name: str) -> Path:
    """Path at which a checkout builds the image of that name, below its root."""
    folder = Path("stm32f103") if name == images.ALL else Path("images") / name
    return "build" / folder / "firmware.bin"


def named_image(name: str | None = None) -> Path:
    """The file of the image of that name, or without a name of `all`. Raises UsageError when there is none."""
    wanted = images.ALL if name is None else name
    known = images.images()
    if wanted in known:
        for root in (CHECKOUT, Path.cwd()):
            if (root / build_of(wanted)).is_file():
                return root / build_of(wanted)
    packaged = packaged_image(wanted)
    if packaged is not None:
        return packaged
    held = f"; the package has {', '.join(packaged_images())}" if packaged_images() else ""
    if name is None and not IN_CHECKOUT:
        raise UsageError(
            "there is no flash image in this installation of plumb; name one with --image, or install a wheel of a "
            "release"
        )
    if name is None:
        raise UsageError("there is no flash image; build one with 'make image' or name one with --image")
    if name in known:
        raise UsageError(f"the image {name} is not built: build it with 'make images'{held}")
    if Path(name).exists():
        raise UsageError(f"{name} is a {'folder' if Path(name).is_dir() else 'device'}, no flash image; name a file")
    raise UsageError(
        f"there is no file {name}, and no image of that name{did_you_mean(name, known)}: 'make images' builds "
        f"{', '.join(known)}{held}"
    )
