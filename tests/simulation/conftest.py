"""What several tests of rooms need."""

import numpy as np
import pytest

from dfdbench.simulation import rooms


@pytest.fixture
def unlit(monkeypatch: pytest.MonkeyPatch) -> None:
    """Rooms without shadows, which take most of the time that drawing a room does."""
    monkeypatch.setattr(rooms, "lit", lambda scene, *_: scene)


@pytest.fixture
def bare(unlit: None, monkeypatch: pytest.MonkeyPatch) -> None:
    """Rooms without shadows and photographs, for what depends on shapes alone."""
    monkeypatch.setattr(rooms, "_photograph", lambda *_: np.ones((1, 1, 3)))
