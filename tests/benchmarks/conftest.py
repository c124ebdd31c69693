"""What benchmarks share: OpenCV on one thread, and the ledger that some of them fill."""

from collections.abc import Iterator
from pathlib import Path

import cv2
import pytest

from tests.benchmarks.ledger import Ledger


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--ledger", metavar="PAGE", help="only what has a peer; a page to write it on")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    if config.getoption("ledger", None):
        items[:] = [item for item in items if "ledger" in getattr(item, "fixturenames", ())]


@pytest.fixture(scope="session")
def ledger(request: pytest.FixtureRequest) -> Iterator[Ledger]:
    found = Ledger()
    yield found
    print(f"\n{found.text()}")
    if page := request.config.getoption("ledger", None):
        found.write(Path(page))


@pytest.fixture
def one_thread() -> Iterator[None]:
    before = cv2.getNumThreads()
    cv2.setNumThreads(1)
    yield
    cv2.setNumThreads(before)
