import hashlib
import json
import math

import numpy as np
import pytest

from dfdbench.errors import UnknownNameError
from dfdbench.metrics.of_protocol import protocols_of
from dfdbench.metrics.protocol import PROTOCOLS, RELEASED, find_protocol, require_scored, score
from dfdbench.metrics.scores import nmae, nrmse, ssim


def test_the_released_definitions_never_change() -> None:
    # A change would be a new version of the protocol, with a line of its own. The hashes are of
    # what results record: a field added to all protocols would make them other ones as well.
    texts = {label: json.dumps(p.as_dict(), sort_keys=True) for label, p in RELEASED.items()}
    hashes = {label: hashlib.sha256(text.encode()).hexdigest() for label, text in texts.items()}
    assert hashes == {
        "thesis": "d77b16d91f97ea9f8f7b9a7711d45c1a38c9148409810b8e5f040d040275887b",
        "thesis-networks-2": "d06468007dae6608dc02122ae795196d6b7b5ef367cadff58297326ec9d1ea91",
        "valid": "71b74df0acd97c903374a774a33ce6fb1a6655dd2fc3314980dbdf9b8489ef9a",
        "metric": "30c6dfb2cabca02ee99e89b4caec52760a5a8715e2adf0a86e99edad74e4fe16",
        "aligned": "d1d10a6201c8c83f11d73deac02fd7770494c90b73a96097723608f5d507e2b5",
    }


def test_runs_score_under_all_protocols_of_their_depth() -> None:
    assert list(PROTOCOLS) == ["thesis", "thesis-networks-2", "valid"]
    assert list(protocols_of(in_metres=False)) == list(PROTOCOLS)
    assert list(protocols_of(in_metres=True)) == [*PROTOCOLS, "metric", "aligned"]
    assert list(RELEASED) == [*PROTOCOLS, "metric", "aligned"]
    assert find_protocol("thesis-networks") == find_protocol("thesis-networks-2")


def test_a_result_without_a_protocol_says_so() -> None:
    require_scored("valid", ["thesis", "valid"], "mine")
    with pytest.raises(UnknownNameError, match="unknown protocol of mine"):
        require_scored("valid", ["thesis"], "mine")
    with pytest.raises(UnknownNameError, match="not scored in metres") as raised:
        require_scored("aligned", ["thesis"], "mine")
    assert "whose manifest says how levels become metres" in str(raised.value)


@pytest.mark.parametrize(
    ("shape", "crop", "top", "left"),
    [
        ((370, 463), 352, 8, 48),
        ((370, 427), 352, 8, 32),
        ((630, 630), 624, 0, 0),
        ((240, 320), 224, 8, 48),
        # Smaller than the square along one axis or both: whole, after the cut.
        ((100, 463), 352, 0, 48),
        ((20, 31), 352, 0, 0),
    ],
)
def test_the_networks_window_is_that_of_their_scoring_code(
    shape: tuple[int, int], crop: int, top: int, left: int
) -> None:
    protocol = PROTOCOLS["thesis-networks-2"]
    valid = np.ones(shape, bool)
    depth, exact = np.zeros(shape, np.uint8), np.zeros(shape, np.float32)
    assert score(protocol, depth, valid, exact, crop)["nrmse"] == 0
    inside = np.ones(shape, bool)
    height, width = (min(crop, extent - extent % 16) for extent in shape)
    inside[top : top + height, left : left + width] = False
    # Errors outside the window do not count; inside it every corner does.
    assert score(protocol, depth, valid, inside * np.float32(255), crop)["nrmse"] == 0
    for y, x in ((0, 0), (height - 1, width - 1)):
        one = exact.copy()
        one[top + y, left + x] = 255
        expected = (1 / (height * width)) ** 0.5
        assert score(protocol, depth, valid, one, crop)["nrmse"] == pytest.approx(expected)


def test_fewer_than_16_rows_leave_the_networks_nothing_to_score() -> None:
    depth, valid = np.zeros((15, 40), np.uint8), np.ones((15, 40), bool)
    scores = score(PROTOCOLS["thesis-networks-2"], depth, valid, depth.astype(np.float32), 352)
    assert all(math.isnan(value) for value in (scores["nrmse"], scores["nmae"], scores["ssim"]))


def test_each_protocol_scores_as_it_says() -> None:
    random = np.random.default_rng(2)
    depth = random.integers(0, 200, (40, 50)).astype(np.uint8)
    valid = depth > 20
    test = random.uniform(0, 255, (40, 50)).astype(np.float32)
    thesis = score(PROTOCOLS["thesis"], depth, valid, test, 16)
    assert thesis["nrmse"] == nrmse(depth, test)
    assert thesis["nmae"] == nmae(depth, test)
    assert thesis["ssim"] == ssim(depth, test)
    cut = score(PROTOCOLS["thesis-networks-2"], depth, valid, test, 16)
    crop = (slice(8, 24), slice(16, 32))  # of 32 rows and 48 columns
    assert cut["nrmse"] == nrmse(depth[crop], test[crop], data_range=255)
    assert cut["ssim"] == ssim(depth[crop], test[crop])
    known = score(PROTOCOLS["valid"], depth, valid, test, 16)
    assert known["nmae"] == nmae(depth, test, data_range=255, mask=valid)
    assert known["ssim"] == ssim(depth, test, mask=valid)


def test_a_crop_larger_than_the_image_takes_it_whole() -> None:
    depth = np.arange(512, dtype=np.uint8).reshape(16, 32)
    test = depth[::-1].astype(np.float32)
    valid = np.ones(depth.shape, bool)
    scores = score(PROTOCOLS["thesis-networks-2"], depth, valid, test, 624)
    assert scores["nrmse"] == nrmse(depth, test, data_range=255)


def test_a_flat_board_is_undefined_only_where_its_own_range_divides() -> None:
    # k35 of the real-world set is such a board: Eq. 3.11 cannot give Table 7.1's 0.0036.
    depth, valid = np.full((20, 20), 90, np.uint8), np.ones((20, 20), bool)
    test = np.full((20, 20), 91, np.float32)
    assert math.isnan(score(PROTOCOLS["thesis"], depth, valid, test, 16)["nrmse"])
    assert score(PROTOCOLS["thesis-networks-2"], depth, valid, test, 16)["nrmse"] == pytest.approx(
        1 / 255
    )


def test_an_unknown_protocol_shows_the_near_miss() -> None:
    with pytest.raises(UnknownNameError, match="did you mean thesis") as caught:
        find_protocol("thesys")
    named = "one of: aligned, metric, thesis, thesis-networks, valid"
    assert caught.value.problems[0].expected == named
