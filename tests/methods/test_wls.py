from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.sparse import diags, identity, kron
from scipy.sparse.linalg import spsolve

from dfdbench.datasets.captures import Capture
from dfdbench.errors import MethodError
from dfdbench.methods.s_transform import STransform
from dfdbench.methods.wls import Choice, WeightedLeastSquares, measured
from tests.methods.made_planes import pair_of, slope, texture


def with_choice(choice: Choice, contrast: float = 3.0) -> WeightedLeastSquares:
    method = WeightedLeastSquares(contrast)
    method.chosen = choice
    return method


def test_it_is_near_the_least_squares_that_it_stands_for() -> None:
    pair = slope(3, 48, 64)
    variance, weight = measured(pair.infocus, pair.defocus, 1.0, 5)
    found = with_choice(Choice(1.0, 5, 30.0)).variance(pair.infocus, pair.defocus)
    # The sum that its docstring states, over the whole image at once.
    guide = pair.infocus.astype(float)
    normal = diags(weight.ravel() / weight.mean())
    for axis, (before, after) in enumerate(((48, 64), (64, 48))):
        tie = np.exp(-np.abs(np.diff(guide, axis=axis)).mean(2) / 3.0)
        step = diags([-np.ones(before - 1), np.ones(before - 1)], [0, 1], (before - 1, before))
        one = identity(after)
        steps = kron(step, one) if axis == 0 else kron(one, step)
        normal = normal + 30.0 * steps.T @ diags(tie.ravel()) @ steps
    exact = spsolve(normal.tocsc(), (weight / weight.mean() * variance).ravel()).reshape(48, 64)
    taken = np.abs(variance - exact).mean()
    assert np.abs(found - exact).mean() < 0.35 * taken


def test_bare_surfaces_take_the_depth_around_them() -> None:
    image = texture(1, 120, 120)
    image[40:80, 40:80] = image[40:80, 40:80].mean((0, 1))
    pair = pair_of(image, np.full((120, 120), 90, np.uint8))
    bare, around = (slice(52, 68),) * 2, (slice(10, 30),) * 2
    alone, lent = (
        with_choice(Choice(2.5, 9, strength)).variance(pair.infocus, pair.defocus)
        for strength in (0.0, 1000.0)
    )
    true = np.median(alone[around])
    assert np.abs(alone[bare] - true).mean() > 0.5 * true
    assert np.abs(lent[bare] - true).mean() < 0.1 * true


def test_an_edge_of_the_image_stops_it() -> None:
    image = texture(2, 100, 120) // 2
    image[:, 60:] += 120
    depth = np.full((100, 120), 200, np.uint8)
    depth[:, 60:] = 60
    pair = pair_of(image, depth)
    edged, blind = (
        with_choice(Choice(2.5, 9, 3000.0), contrast).variance(pair.infocus, pair.defocus)
        for contrast in (3.0, 250.0)
    )
    step = [float(each[:, 85:].mean() - each[:, :35].mean()) for each in (edged, blind)]
    assert step[0] > 1.5 * step[1] > 0


def noisy(pair: Capture, seed: int, sigma: float) -> Capture:
    noise = np.random.default_rng(seed).normal(0, sigma, pair.images.shape)
    images = np.clip(np.rint(pair.images + noise), 0, 255).astype(np.uint8)
    return replace(pair, images=images)


def rooms(sigma: float, seeds: range) -> list[Capture]:
    """Boards of a few depths with little texture, photographed with noise."""
    found = []
    for seed in seeds:
        random = np.random.default_rng(seed)
        image, depth = 0.3 * (texture(seed, 120, 160) - 120.0), np.zeros((120, 160), np.uint8)
        for left in range(0, 160, 40):
            depth[:, left : left + 40] = random.integers(20, 240)
            image[:, left : left + 40] += random.integers(60, 200)
        found.append(noisy(pair_of(np.clip(image, 0, 255).astype(np.uint8), depth), seed, sigma))
    return found


def test_the_fit_smooths_as_much_as_the_noise_asks_for() -> None:
    strengths = []
    for sigma in (0.0, 4.0):
        method, plain = WeightedLeastSquares(), STransform()
        for each in (method, plain):
            assert each.fit is not None
            each.restore(each.fit(rooms(sigma, range(6))))
        strengths.append(method.chosen.strength)
        test = rooms(sigma, range(20, 24))
        ours, theirs = (
            np.mean([np.abs(each(p.infocus, p.defocus) - p.levels).mean() for p in test])
            for each in (method, plain)
        )
        assert ours < 0.85 * theirs
    assert strengths[1] >= strengths[0] > 0


def test_one_group_tells_nothing_of_others_so_nothing_is_chosen() -> None:
    captures = [replace(each, group="den") for each in rooms(4.0, range(4))]
    learned = WeightedLeastSquares().fit(captures)
    usual = WeightedLeastSquares().chosen.as_dict()
    assert {name: learned[name] for name in usual} == usual


def test_large_captures_are_fitted_by_a_part() -> None:
    pair = slope(1, 40, 60)
    wide = np.asarray(cv2.copyMakeBorder(pair.infocus, 0, 0, 0, 1400, cv2.BORDER_REFLECT), np.uint8)
    captures = [pair_of(wide, np.full(wide.shape[:2], 40 * n, np.uint8)) for n in range(1, 4)]
    assert WeightedLeastSquares().fit(captures)["strength"] >= 0


def test_a_fit_without_its_choices_is_refused() -> None:
    method = WeightedLeastSquares()
    learned = method.fit([slope(1)])
    with pytest.raises(MethodError, match="wls: window"):
        method.restore({name: value for name, value in learned.items() if name != "window"})
