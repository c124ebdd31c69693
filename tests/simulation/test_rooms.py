import numpy as np
import pytest
from numpy.typing import NDArray

from dfdbench.datasets.rendered import FAR, NEAR
from dfdbench.errors import InputError
from dfdbench.simulation import rooms
from dfdbench.simulation.lens import depth
from dfdbench.simulation.rooms import draw_room
from dfdbench.simulation.unseen import draw_camera

pytestmark = pytest.mark.usefixtures("bare")


def test_a_room_is_the_same_for_the_same_seed_and_number_only() -> None:
    first, again, other, third = (draw_room(*key) for key in ((2, 0), (2, 0), (2, 1), (3, 0)))
    for name, array in first._asdict().items():
        assert np.array_equal(array, getattr(again, name))
    assert not np.array_equal(first.rows, other.rows)
    assert not np.array_equal(first.rows, third.rows)


def depths(seed: int, count: int) -> NDArray[np.float32]:
    """Return the depth of rooms at every fourth pixel."""
    camera = draw_camera(seed)
    maps = [depth(draw_room(seed, number), camera) for number in range(count)]
    return np.array(maps)[:, ::4, ::4]


def test_rooms_are_closed_and_between_near_and_far() -> None:
    metres = depths(4, 6)
    assert metres.min() >= NEAR
    assert metres.max() <= FAR
    near, far = np.quantile(metres, (0.05, 0.95), axis=(1, 2))
    assert (far / near >= 1.6).all()


@pytest.mark.slow
def test_no_positional_prior_beats_the_median() -> None:
    # Fitted on 24 rooms, tested on 24; over eight seeds, as one seed's 24 rooms scatter.
    gains: dict[str, list[float]] = {"row": [], "column": [], "pixel": []}
    for seed in range(1, 9):
        metres = depths(seed, 48)
        train, test = metres[24:], metres[:24]
        shape = test.shape[1:]
        priors = {
            "row": np.broadcast_to(np.median(train, axis=(0, 2))[:, np.newaxis], shape),
            "column": np.broadcast_to(np.median(train, axis=(0, 1)), shape),
            "pixel": np.median(train, axis=0),
        }
        flat = np.abs(test - np.median(train)).mean(axis=(1, 2))
        for name, prior in priors.items():
            gains[name] += list((flat - np.abs(test - prior).mean(axis=(1, 2))) / flat.mean())
    for name, shares in gains.items():
        error = np.std(shares, ddof=1) / len(shares) ** 0.5
        print(f"{name} prior: {100 * np.mean(shares):.2f} % better, +- {196 * error:.2f} %")
        assert np.mean(shares) < 2 * error


def test_a_seed_without_a_room_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rooms, "_fits", lambda _: False)
    monkeypatch.setattr(rooms, "_MOST_ATTEMPTS", 2)
    with pytest.raises(InputError, match="no room of this seed"):
        draw_room(1, 0)
