from dataclasses import replace

import numpy as np
import pytest
from scipy.sparse import diags, identity, kron
from scipy.sparse.linalg import spsolve

from dfdbench.datasets.captures import Capture
from dfdbench.errors import MethodError
from dfdbench.methods.choices import cut_out
from dfdbench.methods.readout import Choice
from dfdbench.methods.s_transform import STransform
from dfdbench.methods.wls import WeightedLeastSquares, measured
from tests.methods.made_planes import pair_of, slope, texture


def with_choice(choice: Choice, contrast: float = 3.0) -> WeightedLeastSquares:
    method = WeightedLeastSquares(contrast)
    method.chosen = choice
    return method


def test_it_is_near_the_least_squares_that_it_stands_for() -> None:
    pair = slope(3, 48, 64)
    variance, weight = measured(pair.infocus, pair.defocus, 1.0, 5)
    found = with_choice(Choice(1.0, 5, 30.0)).variance(pair.infocus, pair.defocus)
    # One sum over the whole image at once, of which the quotient is an approximation.
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
    assert strengths[1] > strengths[0] > 0


def test_one_group_tells_nothing_of_others_so_nothing_is_chosen() -> None:
    captures = [replace(each, group="den") for each in rooms(4.0, range(4))]
    learned = WeightedLeastSquares().fit(captures)
    usual = WeightedLeastSquares().chosen.as_dict()
    assert {name: learned[name] for name in usual} == usual


def test_fine_texture_gets_little_smoothing_and_a_wide_window_also_beside_small_captures() -> None:
    captures = []
    for seed in range(8):
        random = np.random.default_rng(seed)
        depth = np.repeat(random.integers(120, 250, (1, 4)), 40, 1).repeat(120, 0).astype(np.uint8)
        grain = np.rint(120 + random.normal(0, 8, (120, 160, 3))).astype(np.uint8)
        captures.append(noisy(pair_of(grain, depth), seed, 1.0))
    learned = WeightedLeastSquares().fit(captures)
    assert learned["smoothing"] < 2.5
    assert learned["window"] > 9
    again = WeightedLeastSquares().fit([*captures, slope(1, 8, 30)])
    assert again["window"] == learned["window"]


def test_a_window_that_the_fit_chose_is_reduced_on_small_images() -> None:
    wide, narrow = with_choice(Choice(0.5, 31, 100.0)), with_choice(Choice(0.5, 19, 100.0))
    pair = slope(2, 20, 60)
    found = [each.variance(pair.infocus, pair.defocus) for each in (wide, narrow)]
    assert np.array_equal(found[0], found[1])


def test_the_choice_is_made_on_parts_of_large_captures() -> None:
    pair = pair_of(texture(0, 40, 1500), np.full((40, 1500), 40, np.uint8))
    parts = [cut_out(pair, turn, 640) for turn in range(3)]
    assert [part.infocus.shape for part in parts] == [(40, 640, 3)] * 3
    columns = [pair.infocus[:, start : start + 640] for start in (0, 430, 860)]
    assert all(np.array_equal(part.infocus, own) for part, own in zip(parts, columns, strict=True))


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("smoothing", 1e5),
        ("window", 0),
        ("window", 8),
        ("strength", -5.0),
        ("strength", 1e300),
        ("depth", np.ones(3)),
        ("measure", np.arange(256.0)[::-1]),
        ("window", None),
    ],
)
def test_a_damaged_fit_is_refused(name: str, value: object) -> None:
    learned = {"smoothing": 2.5, "window": 9, "strength": 1000.0}
    learned |= {"measure": np.arange(256.0), "depth": np.arange(256.0)}  # type: ignore[dict-item]
    method = WeightedLeastSquares()
    method.restore(dict(learned))
    learned[name] = value  # type: ignore[assignment]
    with pytest.raises(MethodError, match="not what this method learns"):
        method.restore({key: each for key, each in learned.items() if each is not None})
