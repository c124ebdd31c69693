import math

import numpy as np
import pytest

from dfdbench.errors import UnknownNameError
from dfdbench.metrics import nmae, nrmse, ssim
from dfdbench.protocol import PROTOCOLS, find_protocol, score


def test_the_released_definitions_never_change() -> None:
    # A change would be version 2 of the protocol, with a line of its own.
    definitions = {(p.name, p.version): (p.pixels, p.divisor, p.crop) for p in PROTOCOLS.values()}
    assert definitions == {
        ("thesis", 1): ("all", "own-range", "whole"),
        ("thesis-networks", 1): ("all", "255", "network"),
        ("valid", 1): ("known", "255", "whole"),
    }


def test_each_protocol_scores_as_it_says() -> None:
    random = np.random.default_rng(2)
    depth = random.integers(0, 200, (40, 50)).astype(np.uint8)
    valid = depth > 20
    test = random.uniform(0, 255, (40, 50)).astype(np.float32)
    thesis = score(PROTOCOLS["thesis"], depth, valid, test, 16)
    assert thesis.nrmse == nrmse(depth, test)
    assert thesis.nmae == nmae(depth, test)
    assert thesis.ssim == ssim(depth, test)
    networks = score(PROTOCOLS["thesis-networks"], depth, valid, test, 16)
    crop = (slice(12, 28), slice(17, 33))
    assert networks.nrmse == nrmse(depth[crop], test[crop], data_range=255)
    assert networks.ssim == ssim(depth[crop], test[crop])
    known = score(PROTOCOLS["valid"], depth, valid, test, 16)
    assert known.nmae == nmae(depth, test, data_range=255, mask=valid)
    assert known.ssim == ssim(depth, test, mask=valid)


def test_a_crop_larger_than_the_image_takes_it_whole() -> None:
    depth = np.arange(600, dtype=np.uint8).reshape(20, 30)
    test = depth[::-1].astype(np.float32)
    valid = np.ones(depth.shape, bool)
    scores = score(PROTOCOLS["thesis-networks"], depth, valid, test, 624)
    assert scores.nrmse == nrmse(depth, test, data_range=255)


def test_a_flat_board_is_undefined_only_where_its_own_range_divides() -> None:
    # k35 of the real-world set is such a board: Eq. 3.11 cannot give Table 7.1's 0.0036.
    depth, valid = np.full((20, 20), 90, np.uint8), np.ones((20, 20), bool)
    test = np.full((20, 20), 91, np.float32)
    assert math.isnan(score(PROTOCOLS["thesis"], depth, valid, test, 16).nrmse)
    assert score(PROTOCOLS["thesis-networks"], depth, valid, test, 16).nrmse == pytest.approx(
        1 / 255
    )


def test_an_unknown_protocol_shows_the_near_miss() -> None:
    with pytest.raises(UnknownNameError, match="did you mean thesis"):
        find_protocol("thesys")
