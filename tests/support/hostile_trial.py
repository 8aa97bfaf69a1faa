"""A reader against hostile files of one format: each ends in time, with one sentence or a result, within its memory."""

from __future__ import annotations

import resource
import time
from collections.abc import Callable
from pathlib import Path

from plumb.errors import PlumbError, UsageError
from support.campaigns import campaign

WHOLE, BLOCK = 200, 20
"""Files of a format, and of one test: a foreign file may take seconds on a busy machine, and a test has a limit."""
CPU_S = 120.0
"""Of this process, for one file. The largest has 3 MiB, whose reading may cost 20 s twice on this machine; without
limits each of several kinds takes hours, so that the bound need not be close."""
MEMORY_BYTES = 1500 << 20
"""More of this process for all files of a format: the largest result is that of 2^20 steps, 500 MiB."""


def try_block(path: Path, block: int, make: Callable[[int], bytes], read: Callable[[Path], object]) -> None:
    """Read the hostile files of a block of seeds from `path`, alone in its folder. make: seed -> what the file holds.

    At least one is refused, each refusal is one sentence, and no other file stays in the folder.
    """
    before, refused = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, 0
    for seed in range(block * BLOCK, block * BLOCK + campaign(4, BLOCK)):
        path.write_bytes(make(seed))
        begin_s = time.process_time()
        try:
            read(path)
        except PlumbError as error:
            refused += 1
            assert isinstance(error, UsageError), f"seed {seed}: {error!r}"
            assert str(error) and "\n" not in str(error), f"seed {seed}: {error}"
        except Exception as error:
            raise AssertionError(f"seed {seed}") from error
        assert time.process_time() - begin_s < CPU_S, f"seed {seed}"
        assert (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) * 1024 < MEMORY_BYTES, f"seed {seed}"
    assert refused, "none of these files is hostile"
    assert list(path.parent.iterdir()) == [path]
