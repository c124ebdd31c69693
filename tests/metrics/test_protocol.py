import hashlib
import json
import math

import numpy as np
import pytest

from dfdbench.datasets.depth_scale import DepthScale
from dfdbench.errors import InputError, UnknownNameError
from dfdbench.metrics.metric import (
    METRICS,
    abs_rel,
    aligned,
    boundary_f1,
    rmse_metres,
    share_within,
)
from dfdbench.metrics.protocol import (
    PROTOCOLS,
    RELEASED,
    find_protocol,
    metrics_of,
    protocols_of,
    ranked_by,
    require_scored,
    score,
)
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
        "metric": "0012b05343cb9359b65c1ccb90bd74f7699fec81cbf19bb5e1900040f379f36d",
        "aligned": "ec137b5392c266f88e2b4b5e30d27925bb392523f4e9daf011ee6a37674fc8cf",
        "sure": "b5ff683fd7e517c76355af3571037405b7ed8b03218f290d5089340c6858f660",
    }


def test_runs_score_under_all_protocols_of_their_depth() -> None:
    assert list(protocols_of(in_metres=False)) == list(PROTOCOLS)
    # How sure a method is has scores only where one says so.
    assert list(RELEASED) == [*PROTOCOLS, "metric", "aligned", "sure"]
    assert find_protocol("thesis-networks") == find_protocol("thesis-networks-2")


def test_the_networks_window_is_that_of_their_scoring_code() -> None:
    protocol = PROTOCOLS["thesis-networks-2"]
    for shape, crop, top, left in (
        ((370, 463), 352, 8, 48),
        ((370, 427), 352, 8, 32),
        ((630, 630), 624, 0, 0),
        ((240, 320), 224, 8, 48),
        # Smaller than the square along one axis or both: whole, after the cut.
        ((100, 463), 352, 0, 48),
        ((20, 31), 352, 0, 0),
    ):
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
    # Fewer than 16 rows leave nothing to score.
    scores = score(protocol, depth[:15], valid[:15], exact[:15], 352)
    assert {"nrmse", "nmae", "ssim"} <= {name for name in scores if math.isnan(scores[name])}


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


def test_a_flat_board_is_undefined_only_where_its_own_range_divides() -> None:
    # k35 of the real-world set is such a board: Eq. 3.11 cannot give Table 7.1's 0.0036.
    depth, valid = np.full((20, 20), 90, np.uint8), np.ones((20, 20), bool)
    test = np.full((20, 20), 91, np.float32)
    assert math.isnan(score(PROTOCOLS["thesis"], depth, valid, test, 16)["nrmse"])
    networks = score(PROTOCOLS["thesis-networks-2"], depth, valid, test, 16)
    assert networks["nrmse"] == pytest.approx(1 / 255)


def test_a_protocol_that_is_not_there_is_told() -> None:
    with pytest.raises(UnknownNameError, match="did you mean thesis") as caught:
        find_protocol("thesys")
    assert caught.value.problems[0].got == "thesys"
    named = "one of: aligned, metric, sure, thesis, thesis-networks, valid"
    with pytest.raises(UnknownNameError, match=named):
        find_protocol("brightness")
    require_scored("valid", ["thesis", "valid"], "mine")
    for label, told in (
        ("valid", "unknown protocol of mine"),
        ("aligned", "aligned needs depth in metres"),
        ("sure", "neither says how sure it is"),
    ):
        with pytest.raises(UnknownNameError, match=told):
            require_scored(label, ["thesis"], "mine")


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
        "delta_105": share_within(true, found, mask=valid, factor=1.05),
        "delta_115": share_within(true, found, mask=valid, factor=1.15),
        "delta_125": share_within(true, found, mask=valid, factor=1.25),
        "boundary_f1": boundary_f1(true, found, mask=valid),
    }
    moved = aligned(true, found, 4.0, valid)
    fitted = score(RELEASED["aligned"], depth, valid, test, 16, SCALE)
    assert list(fitted) == ["abs_rel", "delta_105", "delta_115", "delta_125", "boundary_f1"]
    assert fitted["abs_rel"] == abs_rel(true, moved, mask=valid)
    assert fitted["delta_115"] == share_within(true, moved, mask=valid, factor=1.15)
    changed = np.where(valid, test, 255).astype(np.float32)
    assert score(RELEASED["metric"], depth, valid, changed, 16, SCALE) == metric
    assert score(RELEASED["aligned"], depth, valid, changed, 16, SCALE) == fitted


def test_levels_linear_in_inverse_depth_are_aligned_whatever_their_scale() -> None:
    depth = np.arange(1, 241, dtype=np.uint8).reshape(12, 20)
    half = (depth / 2 + 100).astype(np.float32)
    scores = score(RELEASED["aligned"], depth, depth > 0, half, 16, SCALE)
    assert scores["abs_rel"] == pytest.approx(0, abs=1e-6)
    assert scores["delta_125"] == 1
    assert score(RELEASED["metric"], depth, depth > 0, half, 16, SCALE)["abs_rel"] > 0.1
    with pytest.raises(InputError, match="how levels become metres"):
        score(RELEASED["metric"], depth, depth > 0, half, 16)


def test_depth_in_metres_is_divided_by_the_range_of_the_set() -> None:
    random = np.random.default_rng(5)
    depth, test = random.uniform(SCALE.near, SCALE.far, (2, 20, 30))
    valid = depth < 3
    whole = SCALE.far - SCALE.near
    scores = score(PROTOCOLS["valid"], depth, valid, test, 16, SCALE, unit="metres")
    assert scores == {
        "nrmse": nrmse(depth, test, data_range=whole, mask=valid),
        "nmae": nmae(depth, test, data_range=whole, mask=valid),
        "ssim": ssim(depth, test, data_range=whole, mask=valid),
    }
    # The thesis scores unknown pixels too: as the farthest.
    filled = np.where(valid, depth, SCALE.far)
    thesis = score(PROTOCOLS["thesis"], depth, valid, test, 16, SCALE, unit="metres")
    assert thesis["nrmse"] == nrmse(filled, test)
    metric = score(RELEASED["metric"], depth, valid, test, 16, SCALE, unit="metres")
    assert metric["abs_rel"] == abs_rel(depth, test, mask=valid)


def test_the_trio_is_what_all_but_metres_are_scored_by() -> None:
    for label, protocol in RELEASED.items():
        if not protocol.metrics:
            assert metrics_of(label) == METRICS
            assert ranked_by(label) == ("nrmse", "nmae")
    assert metrics_of("somebody's own") == METRICS
    # The share in intervals ranks nobody.
    assert ranked_by("sure") == ("nrmse_50", "ause")


def test_what_is_left_out_counts_only_where_it_is_asked_how_sure_a_method_is() -> None:
    depth = (np.arange(400).reshape(20, 20) / 2).astype(np.float32)
    test, sigma = depth + np.float32(2), np.full_like(depth, 2)
    test[:5] = sigma[:5] = np.nan
    for protocol in PROTOCOLS.values():
        found = score(protocol, depth, depth >= 0, test, 16)
        assert all(map(math.isnan, found.values())), protocol.label
    found = score(RELEASED["sure"], depth, depth >= 0, test, 16, sigma=sigma)
    assert found["density"] == 0.75
    assert found["nrmse_50"] == pytest.approx(2 / 255)
    assert math.isnan(found["nrmse_90"])
    assert (found["ause"], found["within_90"]) == (0, 1)
    in_metres = score(RELEASED["sure"], depth, depth >= 0, test, 16, SCALE, "metres", sigma)
    assert in_metres["nrmse_50"] == pytest.approx(2 / (SCALE.far - SCALE.near))
