"""What benchmarks share: OpenCV on one thread."""

from collections.abc import Iterator

import cv2
import pytest


@pytest.fixture
def one_thread() -> Iterator[None]:
    before = cv2.getNumThreads()
    cv2.setNumThreads(1)
    yield
    cv2.setNumThreads(before)
