import math

import numpy as np
import pytest
from numpy.typing import NDArray

from dfdbench.blur.law import GREYS, BlurLaw
from dfdbench.blur.recipe import LEVELS
from dfdbench.blur.synthesis import blur_by_level
from dfdbench.datasets.captures import Capture
from dfdbench.errors import MethodError
from dfdbench.evaluation.check import made_pair
from dfdbench.methods.choices import Part, choose, energy_of
from dfdbench.methods.fitted import Choosing, Solver
from dfdbench.methods.law_cost import add_energy
from dfdbench.methods.measured_law import Calibration
from dfdbench.methods.readout import AS_USUAL, Chosen, read_out
from dfdbench.methods.registry import load_method
from tests.methods.made_planes import texture

#: A lens that focuses inside the range gives two depths the same blur.
FOCUSED = np.hypot(0.5, 0.016 * (np.arange(LEVELS) - 130))


def mostly_far(number: int) -> Capture:
    """Blocks beyond the focus, and one in ten before it."""
    random = np.random.default_rng(number)
    blocks = random.integers(30, 110, (4, 5))
    blocks[random.random((4, 5)) < 0.1] += 120
    depth = np.kron(blocks, np.ones((40, 40))).astype(np.uint8)
    image = texture(number, 160, 200)
    law = BlurLaw(tuple(FOCUSED.tolist()))
    blurred = blur_by_level(image.astype(np.float64), depth.astype(np.int64), law.kernels())
    noisy = blurred + 0.5 * random.normal(size=image.shape)
    return made_pair(image, np.clip(np.rint(noisy), 0, 255).astype(np.uint8), depth, depth > 0)


def test_a_depth_that_is_shown_e_times_as_often_costs_a_nat_less() -> None:
    shares = np.zeros((2, LEVELS))
    shares[:, :128], shares[:, 128:] = math.e, 1
    energy = energy_of(shares / shares.sum(axis=1, keepdims=True))
    assert energy[220] - energy[20] == pytest.approx(1, abs=0.01)
    assert energy.min() == 0


def test_a_prior_is_chosen_where_it_helps_and_left_off_elsewhere() -> None:
    captures = [mostly_far(number) for number in range(6)]

    def twofold(part: Part, chosen: Chosen) -> NDArray[np.float64]:
        # Each level and its mirror image beyond the focus cost the same, but for what is shown.
        shown, where = np.unique(part.levels, return_inverse=True)
        levels = np.arange(LEVELS)[:, np.newaxis, np.newaxis]
        off = np.minimum(abs(levels - shown), abs(260 - levels - shown))
        energy = chosen.energy if chosen.weight else 1e-6 * np.arange(LEVELS)[::-1]
        answers = read_out(off + energy[:, np.newaxis, np.newaxis], chosen.sharpness)
        return np.asarray(answers[0, where.reshape(part.levels.shape)])

    found = choose(twofold, captures, prior=True, smooth=False)
    assert found.weight > 0
    assert found.energy[200] - found.energy[60] > found.weight
    perfect = choose(lambda part, chosen: part.levels, captures, prior=True, smooth=True)
    assert perfect is AS_USUAL
    assert choose(twofold, captures[:3], prior=True, smooth=True) is AS_USUAL
    assert choose(twofold, captures, prior=False, smooth=False) is AS_USUAL


def test_as_much_is_smoothed_as_noise_wants() -> None:
    captures = [mostly_far(number) for number in range(6)]

    def noisy(part: Part, chosen: Chosen) -> NDArray[np.float64]:
        random = np.random.default_rng((int(part.levels.sum()), chosen.smoothing))
        # The mean of as many pixels as a window of 7 times the factor has, and a bias by its side.
        noise = random.normal(size=part.levels.shape) * 60 / chosen.smoothing
        return part.levels + noise + 3 * chosen.smoothing

    found = choose(noisy, captures, prior=False, smooth=True)
    assert (found.smoothing, found.weight, found.sharpness) == (4, 0, 0)
    assert found.as_dict() == {"smoothing": 4}
    assert Chosen.taken_from(found.as_learned()).as_dict() == found.as_dict()


@pytest.mark.parametrize("walls", [2, 6])
def test_a_few_bare_walls_do_not_outweigh_all_else(walls: int) -> None:
    flat = np.zeros((40, 40, 3), np.uint8)
    depths = [np.full((40, 40), number, np.uint8) for number in range(100, 112)]
    captures = [made_pair(flat, flat, depth, depth > 0) for depth in depths]

    def solve(part: Part, chosen: Chosen) -> NDArray[np.float64]:
        # Smoothing mends bare walls, where all is far off, and harms the others a little.
        smoothed, usual = (20, 120) if part.levels[0, 0] < 100 + walls else (13, 10)
        return part.levels + np.float64(smoothed if chosen.smoothing > 1 else usual)

    found = choose(solve, captures, prior=False, smooth=True)
    assert found.smoothing == (1 if walls == 2 else 4)


class Wide(Choosing):
    def _solve(self, infocus: NDArray[np.uint8], images: object) -> NDArray[np.float32]:
        return np.full(infocus.shape[:2], self.window_in(infocus)[0], np.float32)


def test_a_window_wider_than_the_usual_parts_is_tried_on_wider_ones() -> None:
    flat, depth = np.zeros((210, 220, 3), np.uint8), np.full((210, 220), 90, np.uint8)
    captures = [made_pair(flat, flat, depth, depth > 0)] * 4
    assert Wide(201, prior=True)._with_choices({}, captures)["smoothing"] == 1
    with pytest.raises(MethodError, match="larger than the image, 211 of 210 x 211"):
        Wide(211, prior=True)._with_choices({}, captures)


def test_what_a_level_costs_is_added_up_to_the_limit() -> None:
    costs = np.array([[[0, 5, 60, 90]]], np.uint16)
    # More than 16 bits hold must not begin anew at 0.
    assert add_energy(costs, np.array([40.4, 0, 0, 65537]), 90) == 5
    assert costs.tolist() == [[[35, 0, 55, 90]]]


@pytest.mark.parametrize("name", ["graph-cuts", "graph-cuts-rounded"])
def test_a_cut_takes_the_depth_that_occurs_where_nothing_is_seen(name: str) -> None:
    law = BlurLaw(tuple(FOCUSED.tolist()), noise=(1.0,) * GREYS)
    method = load_method(name, {"recipe": None}, {}).predict
    assert isinstance(method, Solver)
    method.calibrations = (Calibration(law, FOCUSED, np.ones(LEVELS, np.int64), np.ones(LEVELS)),)
    bare = np.full((20, 25, 3), 120, np.uint8)
    method.chosen = Chosen(np.abs(np.arange(LEVELS) - 77.0), weight=1.0)
    np.testing.assert_allclose(method(bare, bare), 77, atol=2)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["local", "sgm", "rational-filters", "favaro-soatto"])
def test_a_method_that_knows_which_depths_occur_takes_the_right_one_of_two(name: str) -> None:
    training = [mostly_far(number) for number in range(8)]
    fitted = {} if name == "favaro-soatto" else {"recipe": None}
    errors = []
    for prior in (False, True):
        method = load_method(name, {**fitted, "prior": prior}, {})
        method.fit(training)
        tests = [mostly_far(number) for number in (20, 21)]
        off = [np.abs(method(pair.infocus, pair.defocus) - pair.levels) for pair in tests]
        errors.append(float(np.mean(off)))
    without, known = errors
    # Ten in a hundred blocks are before the focus, where the prior is wrong.
    assert known < 0.85 * without, errors
