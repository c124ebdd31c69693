from dataclasses import replace

import numpy as np
import pytest

from dfdbench.blur.law import BlurLaw
from dfdbench.blur.recipe import RECIPES
from dfdbench.datasets.depth_scale import DepthScale
from dfdbench.datasets.manifest import Depth
from dfdbench.errors import MethodError
from dfdbench.methods.blurred import blurred_by
from dfdbench.methods.edges import within_edges
from dfdbench.methods.law_cost import law_cost
from dfdbench.methods.readout import rescaled
from tests.methods.made_planes import pair_of, slope, texture

pytest.importorskip("torch")

from dfdbench.methods import volume_costs, volume_net

LAW = BlurLaw(sigmas=tuple(RECIPES["published"].sigmas[::-1].tolist()))


def test_it_finds_depth_for_a_blur_that_it_was_not_trained_on() -> None:
    depth = np.full((96, 128), 70, np.uint8)
    depth[:, 64:] = 180
    depth[30:70, 20:50] = 230
    train = pair_of(texture(5, 96, 128), depth)
    method = volume_net.VolumeNetMethod(device="cpu")
    method.restore(dict(method.fit([train])))  # type: ignore[misc]
    found, sigma = method(train.infocus, train.defocus)
    assert found.shape == sigma.shape == depth.shape
    # A constant is off by 55 at the least.
    assert np.median(np.abs(found - depth)) < 8
    assert 0.85 < (np.abs(found - depth) <= 1.645 * sigma).mean() < 0.95


def test_looked_at_again_finer_levels_are_nearer_where_the_blur_explains_the_images() -> None:
    depth = np.full((48, 64), 101, np.uint8)
    depth[:, 32:] = 154
    pair = pair_of(texture(6, 48, 64), depth)
    levels = volume_costs.finer_levels(32)
    # 64 a nat.
    costs, _ = law_cost(blurred_by(LAW, pair.infocus, pair.defocus, levels), 64, 65535)
    said = depth + np.float32(6)
    unsure, sure = (
        volume_net.looked_again(costs.copy(), levels, said, np.full_like(said, by))
        for by in (9, 0.3)
    )
    assert np.abs(unsure - depth).mean() < 2
    # Who is surer is believed more.
    assert np.abs(sure - said).mean() < np.abs(unsure - said).mean() - 1


def test_the_mean_level_weighs_each_by_its_cost() -> None:
    random = np.random.default_rng(3)
    costs = random.integers(0, 300, (20, 30, 9)).astype(np.uint16)
    levels = np.arange(5, 90, 10)
    weights = np.exp(np.arange(120) / -20).astype(np.float32)
    found = np.empty(costs.shape[:2], np.float32)
    volume_net._mean_levels(costs, levels, weights, found)
    expected = np.average(np.broadcast_to(levels, costs.shape), 2, np.exp(costs / -20))
    # What weighs less than exp(-6) is left out.
    assert np.abs(found - expected).max() < 1
    assert np.abs(found - expected).mean() < 0.1


@pytest.mark.slow
def test_the_fit_looks_again_only_where_that_surely_errs_less() -> None:
    depth = np.full((64, 80), 70, np.uint8)
    depth[:, 40:] = 180
    clean = [pair_of(texture(seed), depth) for seed in range(5)]
    method = volume_net.VolumeNetMethod(device="cpu")
    method.restore(dict(method.fit(clean[1:])))  # type: ignore[misc]
    assert method.chosen.finer > 0
    never = volume_net.VolumeNetMethod(finer=False, device="cpu")
    never.restore(dict(never.fit(clean[1:])))  # type: ignore[misc]
    assert never.chosen.finer == 0
    found = [each(clean[0].infocus, clean[0].defocus)[0] for each in (method, never)]
    errors = [np.abs(each - depth).mean() for each in found]
    assert errors[0] < errors[1]
    # Three captures are too few to tell.
    method.restore(dict(method.fit(clean[2:])))  # type: ignore[misc]
    assert method.chosen.finer == 0


def test_a_gain_that_may_be_chance_changes_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    method = volume_net.VolumeNetMethod(device="cpu")
    rough = np.outer([9, -8, 9, -8, 9, -8, 9, -8], np.arange(30))
    steady = np.tile(np.arange(30.0), (8, 1))
    # Ten ways of looking again, or not, smoothed with one strength after the other.
    for gains, best in (
        (rough, (0.0, 1, 0.0)),
        (steady, (4.0, 13, 1000.0)),
        (steady * (np.arange(30) < 10), (4.0, 13, 0.0)),
        (steady * (np.arange(30) == 10), (0.0, 1, 100.0)),
        (rough * (np.arange(30) == 10), (0.0, 1, 0.0)),
    ):
        errors = iter(np.full((8, 30), 40.0) - gains / 8)
        monkeypatch.setattr(method, "_errors_on", lambda capture, errors=errors: next(errors))
        assert method._best_tried([None] * 8) == best  # type: ignore[list-item]
    # Captures without known depth do not count, and three are too few to tell.
    errors = iter(np.where(np.arange(8)[:, np.newaxis] < 3, 40.0 - steady / 8, 0.0))
    monkeypatch.setattr(method, "_errors_on", lambda capture: next(errors))
    assert method._best_tried([None] * 8) == (0.0, 1, 0.0)  # type: ignore[list-item]


@pytest.mark.parametrize("finer", [0.0, 2.0])
def test_the_answer_and_its_spread_are_smoothed_as_the_fit_chose(finer: float) -> None:
    pair, method = slope(3), volume_net.VolumeNetMethod(device="cpu")
    method.restore(dict(method.fit([pair])))  # type: ignore[misc]
    found = []
    for strength in (0.0, 1000.0):
        method.chosen = replace(method.chosen, finer=finer, strength=strength)
        found.append(np.stack(method._settled(pair.infocus, [pair.defocus])))  # type: ignore[arg-type]
    expected = within_edges(found[0], pair.infocus, 1000.0, 2.0)
    np.testing.assert_allclose(found[1], expected, rtol=1e-6)
    assert np.abs(found[1] - found[0]).max() > 0.1


def test_on_a_set_in_metres_it_answers_the_mean_of_metres() -> None:
    in_levels = slope(3)
    scale = DepthScale(near=0.5, far=8.0)
    about = Depth(axes=[], unknown=0, grows_with="nearness", unit="metres", scale=scale)
    metres = about.of_unit(in_levels.depth, "levels")
    method = volume_net.VolumeNetMethod(device="cpu")
    answers = []
    for pair in (in_levels, replace(in_levels, depth=metres, about=about)):
        method.restore(dict(method.fit([pair])))  # type: ignore[misc]
        answers.append(method(pair.infocus, pair.defocus))
    (levels, _), (own, sigma) = answers
    # A distance falls ever more slowly with the level: by Jensen's inequality the mean distance is
    # beyond the distance of the mean level.
    beyond = scale.to_metres(own) - scale.to_metres(levels)
    assert beyond.min() > -1e-3
    assert np.median(beyond) > 1e-3
    assert 0.85 < (np.abs(own - in_levels.levels) <= 1.645 * sigma).mean() < 0.95
    # Of metres nothing stays after a fit in levels.
    method.restore(dict(method.fit([in_levels])))  # type: ignore[misc]
    assert np.array_equal(method(in_levels.infocus, in_levels.defocus)[0], levels)


def test_beyond_the_end_of_a_scale_a_spread_stays_what_it_is() -> None:
    # Of levels from 155 on all are the nearest distance.
    scale = DepthScale(near=0.5, far=5.0, near_level=155).to_metres(np.arange(256))
    near, within = np.array([[[0.52]], [[0.05]]], np.float32)
    levels, spread = rescaled(near, within, scale, np.arange(256.0))
    assert levels[0, 0] < 155
    assert spread[0, 0] < 20


@pytest.mark.parametrize("scale", [np.arange(256.0), 1 / np.linspace(0.1, 2, 256)])
def test_another_scale_and_back_is_the_same_depth(scale: np.ndarray) -> None:
    levels, spread = np.array([[[9, 80, 246]], [[0.1, 3, 9]]], np.float32)
    own = rescaled(levels, spread, np.arange(256.0), scale)
    back = rescaled(*own, scale, np.arange(256.0))
    np.testing.assert_allclose(back[0], levels, rtol=1e-3)
    np.testing.assert_allclose(back[1], spread, rtol=0.1)


@pytest.mark.parametrize(
    "depths", [np.ones(1), np.arange(9.0), np.arange(256) % 100, np.ones(256), -np.arange(256.0)]
)
def test_a_damaged_scale_is_refused(depths: np.ndarray) -> None:
    pair, method = slope(3), volume_net.VolumeNetMethod(device="cpu")
    learned = dict(method.fit([pair]))  # type: ignore[misc]
    with pytest.raises(MethodError, match="not what this method learns"):
        method.restore(learned | {"depths": depths})
    for name, damaged in (("finer", -1.0), ("strength", np.nan), ("smoothing", 1e12)):
        with pytest.raises(MethodError, match="out of range") as caught:
            method.restore(learned | {name: damaged})
        assert caught.value.problems[0].fix == "fit the method again"
    del learned["strength"]
    with pytest.raises(MethodError, match="not all that the fit chose"):
        method.restore(learned)
