import numpy as np
import pytest

from dfdbench.datasets.depth_scale import DepthScale
from dfdbench.errors import InputError
from dfdbench.metrics.metres import abs_rel, aligned, rmse_metres, share_within
from dfdbench.metrics.protocol import RELEASED, score

SCALE = DepthScale(law="inverse", near=0.5, far=4.0)


def test_levels_are_scored_as_distances_over_known_pixels() -> None:
    random = np.random.default_rng(4)
    depth = random.integers(0, 256, (20, 30)).astype(np.uint8)
    test = random.uniform(0, 255, depth.shape).astype(np.float32)
    valid = depth > 0
    true, found = SCALE.to_metres(depth), SCALE.to_metres(test)
    metric = score(RELEASED["metric"], depth, valid, test, 16, SCALE)
    assert metric == {
        "abs_rel": abs_rel(true, found, mask=valid),
        "rmse_m": rmse_metres(true, found, mask=valid),
        "delta_1": share_within(true, found, mask=valid, factor=1.25),
        "delta_2": share_within(true, found, mask=valid, factor=1.5625),
        "delta_3": share_within(true, found, mask=valid, factor=1.953125),
    }
    moved = aligned(true, found, 4.0, valid)
    fitted = score(RELEASED["aligned"], depth, valid, test, 16, SCALE)
    assert list(fitted) == ["abs_rel", "delta_1", "delta_2", "delta_3"]
    assert fitted["abs_rel"] == abs_rel(true, moved, mask=valid)
    assert fitted["delta_3"] == share_within(true, moved, mask=valid, factor=1.953125)
    changed = np.where(valid, test, 255).astype(np.float32)
    assert score(RELEASED["metric"], depth, valid, changed, 16, SCALE) == metric
    assert score(RELEASED["aligned"], depth, valid, changed, 16, SCALE) == fitted


def test_levels_linear_in_inverse_depth_are_aligned_whatever_their_scale() -> None:
    depth = np.arange(1, 241, dtype=np.uint8).reshape(12, 20)
    half = (depth / 2 + 100).astype(np.float32)
    scores = score(RELEASED["aligned"], depth, depth > 0, half, 16, SCALE)
    assert scores["abs_rel"] == pytest.approx(0, abs=1e-6)
    assert scores["delta_1"] == 1
    assert score(RELEASED["metric"], depth, depth > 0, half, 16, SCALE)["abs_rel"] > 0.1


def test_without_a_scale_there_are_no_metres() -> None:
    depth = np.full((4, 4), 9, np.uint8)
    with pytest.raises(InputError, match="how levels become metres"):
        score(RELEASED["metric"], depth, depth > 0, depth.astype(np.float32), 16)
