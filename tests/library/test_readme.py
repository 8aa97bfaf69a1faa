"""The code of README: its lines of C, compiled, give the integers of its lines of Python."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from support.c_library import ARCHIVE, HEADERS, ROOT, WARNINGS, run

README = (ROOT / "README.md").read_text(encoding="utf-8")
MAIN = """
#include <stdio.h>
int main(void) {
    int raw[6];
    if (begin() != 0) {
        return 1;
    }
    while (scanf("%d %d %d %d %d %d", raw, raw + 1, raw + 2, raw + 3, raw + 4, raw + 5) == 6) {
        int16_t counts[PLUMB_RAW_MAX] = {0};
        for (int i = 0; i < 6; i++) {
            counts[i] = (int16_t)raw[i];
        }
        const int32_t *up = up_q30(counts);
        printf("%ld %ld %ld\\n", (long)up[0], (long)up[1], (long)up[2]);
    }
    return 0;
}
"""


def example(language: str) -> str:
    """The one block of README in a language."""
    found = re.findall(rf"(?ms)^```{language}\n(.*?)^```", README)
    assert len(found) == 1
    return str(found[0])


def test_the_lines_of_c_give_the_integers_of_the_lines_of_python(tmp_path: Path, capsys: Any) -> None:
    names: dict[str, Any] = {}
    code = example("python")
    exec(code, names)
    assert [f"# {line}" for line in capsys.readouterr().out.splitlines()] == code.splitlines()[-1:]
    source, program, samples = (tmp_path / name for name in ("user.c", "user", "samples"))
    source.write_text(example("c") + MAIN)
    run("gcc", "-std=c99", *WARNINGS, f"-I{HEADERS.parent}", source, ARCHIVE, "-o", program)
    estimate = names["estimate"]
    samples.write_text("".join(" ".join(map(str, row)) + "\n" for row in estimate.raw.tolist()))
    printed = run("sh", "-c", f"{program} < {samples}").splitlines()
    of_python = zip(*(estimate.words[f"up_q30_{axis}"].tolist() for axis in range(3)), strict=True)
    assert printed == [" ".join(map(str, up)) for up in of_python]
