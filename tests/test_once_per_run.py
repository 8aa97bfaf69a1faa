"""A measurement shared by the workers of a run is made once for each image, however many ask at the same time."""

from __future__ import annotations

import threading
import time
from pathlib import Path

import pytest

from support.once_per_run import once_per_run


def test_workers_that_ask_together_measure_once(tmp_path: Path) -> None:
    image, begun, results = tmp_path / "image", threading.Barrier(4), []
    image.write_bytes(b"image")
    measurements: list[int] = []

    def measure() -> dict[str, float]:
        measurements.append(1)
        time.sleep(0.05)  # long enough for a worker that does not wait to begin its own
        return {"error": 0.1 + 0.2}

    def ask() -> None:
        begun.wait()
        results.append(once_per_run(tmp_path, image, measure))

    workers = [threading.Thread(target=ask) for _ in range(4)]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()
    assert measurements == [1] and results == [{"error": 0.1 + 0.2}] * 4


def test_another_image_is_measured_again(tmp_path: Path) -> None:
    image = tmp_path / "image"
    for content in (b"one", b"two", b"one"):
        image.write_bytes(content)
        assert once_per_run(tmp_path, image, image.read_bytes) == content


def test_a_failed_measurement_is_repeated(tmp_path: Path) -> None:
    image = tmp_path / "image"
    image.write_bytes(b"image")
    with pytest.raises(ZeroDivisionError):
        once_per_run(tmp_path, image, lambda: 1 // 0)
    assert once_per_run(tmp_path, image, lambda: 1) == 1
