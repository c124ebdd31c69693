from functools import cache

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from dfdbench.blur.formation import move
from dfdbench.blur.law import BlurLaw
from dfdbench.blur.light import decode, encode
from dfdbench.blur.recipe import LEVELS
from dfdbench.blur.synthesis import blur_by_level
from dfdbench.datasets.captures import Capture
from dfdbench.errors import MethodError
from dfdbench.evaluation.check import made_pair
from dfdbench.methods.calibration import KERNEL_SIZE, calibrate, parts_of
from dfdbench.methods.fitted import Calibrated
from dfdbench.methods.measured_law import Calibration
from dfdbench.methods.registry import load_method
from tests.methods.made_planes import pair_of, plane, texture

DEPTHS = np.arange(LEVELS)
RISING = 3.0 - 2.4 * DEPTHS / 255
# A lens that focuses inside the range: both nearer and farther is blurred more.
FOCUSED = np.hypot(0.5, 0.014 * (DEPTHS - 140))


def scene(number: int, shape: tuple[int, int] = (160, 200)) -> tuple[NDArray, NDArray]:  # type: ignore[type-arg]
    random = np.random.default_rng(number)
    image = random.integers(30, 226, (*shape, 3)).astype(np.uint8)
    image = np.asarray(cv2.GaussianBlur(image, (0, 0), 0.8), np.uint8)
    blocks = random.integers(5, 251, (shape[0] // 40, shape[1] // 40))
    return image, np.kron(blocks, np.ones((40, 40))).astype(np.uint8)


def pairs(
    law: BlurLaw, count: int = 6, shift: float = 0, noise: float = 0, darkest: float = 1
) -> list[Capture]:
    made = []
    for number, bright in enumerate(np.linspace(darkest, 1, count)):
        image, depth = scene(number)
        image = np.rint(bright * image).astype(np.uint8)
        light = decode(image) if law.linear else image.astype(np.float64)
        blurred = blur_by_level(light, depth.astype(np.int64), law.kernels())
        if shift:
            blurred = move(blurred, shift * np.sin(number), shift * np.cos(number))
        gain = law.gain if law.even else 1 + 0.05 * np.sin(number)
        blurred = gain * blurred + law.offset
        grey = encode(blurred) if law.linear else blurred
        images = [image, grey]
        if noise:
            random = np.random.default_rng(100 + number)
            images = [each + noise * random.normal(size=image.shape) for each in images]
        infocus, defocus = (np.clip(np.rint(i), 0, 255).astype(np.uint8) for i in images)
        made.append(made_pair(infocus, defocus, depth, depth > 0))
    return made


@cache
def found_of(law: BlurLaw) -> Calibration:
    """What is found of a law, for all tests that ask: it takes seconds."""
    return calibrate(pairs(law, 4))


# Nearly a disk, or focused inside the range.
OTHERS = [
    pytest.param(curve, exponent, marks=pytest.mark.slow)
    for curve, exponent in ((FOCUSED, 8.0), (RISING, 8.0), (FOCUSED, 2.0))
]


@pytest.mark.parametrize(("curve", "exponent"), [(RISING, 2.0), *OTHERS])
def test_the_widths_and_the_shape_are_found(curve: NDArray[np.float64], exponent: float) -> None:
    found = found_of(BlurLaw(tuple(curve.tolist()), exponent))
    assert found.law.exponent == exponent
    assert (found.law.linear, found.law.registered, found.law.even) == (False, True, True)
    seen = found.pixels > 0
    assert 20 < seen.sum() < 200
    # Levels that the pairs lack lie on the curve too.
    error = np.abs(np.array(found.law.sigmas) - curve)
    assert error[10:246].max() < 0.12
    assert np.sqrt(np.mean(error[seen] ** 2)) < 0.03
    assert max(found.law.noise) < 1


@pytest.mark.slow
def test_gain_and_offset_are_found(monkeypatch: pytest.MonkeyPatch) -> None:
    given = pairs(BlurLaw(tuple(RISING.tolist()), gain=0.9, offset=12.0))
    found = calibrate(given).law
    monkeypatch.setattr("numba.config.NUMBA_NUM_THREADS", 1)
    assert calibrate(given).law == found
    assert (found.gain, found.offset) == pytest.approx((0.9, 12.0), abs=0.3)
    assert found.gain == pytest.approx(0.9, abs=0.01)
    assert np.abs(np.array(found.sigmas) - RISING)[10:246].max() < 0.1


@pytest.mark.slow
@pytest.mark.parametrize(("gain", "offset", "linear"), [(0.8, 0.0, True), (0.95, 5.0, False)])
def test_light_gain_and_offset_are_found_in_scenes_of_unlike_brightness(
    gain: float, offset: float, linear: bool
) -> None:
    law = BlurLaw(tuple(RISING.tolist()), gain=gain, offset=offset, linear=linear)
    found = calibrate(pairs(law, noise=0.5, darkest=0.4)).law
    assert (found.linear, found.even, found.registered) == (linear, True, True)
    assert (found.gain, found.offset) == pytest.approx((gain, offset), abs=0.1)
    assert np.abs(np.array(found.sigmas) - RISING)[10:246].max() < 0.1


@pytest.mark.slow
def test_pairs_that_are_moved_or_brightened_each_its_own_way_are_told() -> None:
    moved = calibrate(pairs(BlurLaw(tuple(RISING.tolist())), shift=0.6)).law
    assert (moved.registered, moved.even) == (False, True)
    bright = calibrate(pairs(BlurLaw(tuple(RISING.tolist()), even=False))).law
    assert (bright.registered, bright.even) == (True, False)
    for law in (moved, bright):
        assert np.abs(np.array(law.sigmas) - RISING)[10:246].max() < 0.15


@pytest.mark.slow
def test_light_and_noise_are_told_from_grey_levels_without() -> None:
    law = BlurLaw(tuple(RISING.tolist()), exponent=32.0, linear=True)
    assert calibrate(pairs(law)).law.linear
    noisy = calibrate(pairs(BlurLaw(tuple(RISING.tolist())), noise=4)).law
    assert not noisy.linear
    # In the middle of the range: the rarest grey levels are those that noise took there.
    assert noisy.noise[8] == pytest.approx(4, rel=0.15)
    assert noisy.registered


def test_a_bare_surface_does_not_bend_the_curve_at_its_end() -> None:
    law = BlurLaw(tuple(RISING.tolist()))
    seen = [made_pair(p.infocus, p.defocus, p.levels, p.levels > 40) for p in pairs(law, count=2)]
    # Nearly flat: of what little there is, rounding leaves a pattern that fits another width.
    noise = np.random.default_rng(0).normal(size=(160, 200, 3))
    bare = np.rint(100.3 + 0.7 * cv2.GaussianBlur(noise, (0, 0), 1)).astype(np.uint8)
    depth = np.full(bare.shape[:2], 20, np.uint8)
    blurred = blur_by_level(bare.astype(np.float64), depth.astype(np.int64), law.kernels())
    seen.append(made_pair(bare, np.rint(blurred).astype(np.uint8), depth, depth > 0))
    assert np.abs(np.array(calibrate(seen).law.sigmas) - RISING)[:60].max() < 0.1


@pytest.mark.slow
@pytest.mark.parametrize("name", ["local", "graph-cuts", "graph-cuts-rounded"])
def test_a_method_that_is_fitted_finds_depth_where_no_line_would(name: str) -> None:
    law = BlurLaw(tuple(FOCUSED.tolist()), exponent=8.0)
    method = load_method(name, {"recipe": None}, {})
    assert isinstance(method.predict, Calibrated)
    with pytest.raises(MethodError, match=r"knows no blur yet.*\n.*or call fit\(captures\)"):
        method.predict(*scene(9)[:1] * 2)
    assert method.learner is not None
    method.predict.restore(dict(found_of(law).as_learned()))
    (made,) = pairs(law, 1)
    # The same blur on both sides of the focus: either level is right.
    found = FOCUSED[np.asarray(method.predict(made.infocus, made.defocus)).astype(int)]
    assert np.median(np.abs(found - FOCUSED[made.levels])) < 0.03
    assert load_method(name, {}, {}).learner is None


def test_pixels_near_a_jump_the_border_or_the_unknown_or_too_bright_do_not_count() -> None:
    depth = np.full((80, 120), 90, np.uint8)
    depth[:, 60:] = 160
    made = pair_of(texture(0, 80, 120), depth)
    valid = made.valid.copy()
    valid[40, 30] = False
    ((part,),) = parts_of([made_pair(made.infocus, made.defocus, depth, valid)])
    margin = KERNEL_SIZE // 2
    assert not part.counts[:margin].any()
    assert not part.counts[:, -margin:].any()
    assert not part.counts[:, 55:65].any()
    assert not part.counts[36:45, 26:35].any()
    assert part.counts[20:30, 20:50].all()
    assert part.counts[20:60, 70:100].all()
    # Nor do pixels that may be cut off above.
    bright = np.maximum(made.defocus, 254)
    ((part,),) = parts_of([made_pair(made.infocus, bright, made.levels, made.valid)])
    assert not part.counts.any()


def test_some_pairs_stand_for_many_and_a_part_for_a_large_one() -> None:
    looked_at = []

    class Pairs(list[Capture]):
        def __getitem__(self, index):  # type: ignore[no-untyped-def]
            looked_at.append(index)
            return super().__getitem__(index)

    (parts,) = parts_of(Pairs([plane(100, seed, 40, 400) for seed in range(40)]))
    assert len(parts) == len(looked_at) == 16
    assert (looked_at, looked_at[0], looked_at[-1]) == (sorted(looked_at), 0, 39)
    assert {part.infocus.shape for part in parts} == {(40, 320, 1)}
