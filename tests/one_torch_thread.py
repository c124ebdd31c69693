"""PyTorch on one thread: threads that wait for each other cost more than such networks do."""

from collections.abc import Iterator

import pytest

torch = pytest.importorskip("torch", reason="needs the extra nets")


@pytest.fixture(autouse=True)
def one_torch_thread() -> Iterator[None]:
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)
