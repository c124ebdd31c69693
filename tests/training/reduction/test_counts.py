import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from torch import Tensor

from dfdbench.datasets.dataset import Dataset
from dfdbench.errors import InputError
from dfdbench.methods.networks.architectures import DfDNet
from dfdbench.methods.networks.choices import LAYERS
from dfdbench.training.reduction import counts as counting
from tests.methods.networks.test_architectures import SMALL


@pytest.mark.slow
def test_layers_are_counted_and_equal_filters_once(tiny_store: Dataset) -> None:
    torch.manual_seed(1)
    network = DfDNet(SMALL).eval()
    with torch.no_grad():
        # All filters of layer 34 alike: one is as good as all.
        network.down_2.weight[:] = network.down_2.weight[:1]  # type: ignore[index, operator]
        network.down_2.bias.zero_()  # type: ignore[operator]
    samples = counting.samples_of(tiny_store, "test")
    counts = counting.count_clusters(network, tiny_store, samples)
    assert counts.found[34] == [1, 1]
    assert dict(counts.filters) == dict(zip(counting.TAPS, (*SMALL[:-1], SMALL[-2]), strict=True))
    for layer, filters in counts.filters.items():
        assert all(1 <= n <= filters for n in [*counts.found[layer], *counts.noise[layer]])
    assert counts.noise[34][0] > 1
    assert counts.samples == tuple(pair.id for pair in samples)
    assert counting.count_clusters(network, tiny_store, samples) == counts


def test_samples_are_the_first_pairs_of_scenes_and_one_too_small_is_named(
    tiny_store: Dataset,
) -> None:
    samples = counting.samples_of(tiny_store, "test")
    assert [pair.scene for pair in samples] == ["Two", "Three"]
    assert samples[0] == tiny_store.pairs("test")[0]
    wide = DfDNet((*[4] * 6, 50, 4, 50, *[4] * 8, 256)).eval()  # 6 x 7 pixels on the third level
    with pytest.raises(InputError, match=r"Two/.*, layer 34"):
        counting.count_clusters(wide, tiny_store, samples)


def test_the_table_has_the_form_of_d_1_with_noise_below_and_says_what_it_is_not() -> None:
    found = dict.fromkeys(counting.TAPS, (33, 44, 47))
    noise = dict.fromkeys(counting.TAPS, (46, 56, 51))
    counts = counting.Counts(dict.fromkeys(counting.TAPS, 128), found, noise, ("a", "b", "c"))
    table = counting.counts_table(counts, "T")
    assert table.columns == ("layer", *map(str, counting.TAPS))
    rows = {row[0]: set(row[1:]) for row in table.rows}
    noise_rows = {"noise, min": {"46"}, "noise, mean": {"51"}, "noise, max": {"56"}}
    assert rows == {"filters": {"128"}, "min": {"33"}, "mean": {"41"}, "max": {"47"}} | noise_rows
    assert "no zero point" in table.notes[1]


@torch.inference_mode()
def by_hand(made: DfDNet, both: NDArray[np.uint8]) -> dict[int, Tensor]:
    """Fig. 5.5 and 6.2, step by step, on the image cut to multiples of 4."""
    pixels = both[:24, :32].transpose(2, 0, 1).copy()
    at = {52: made.entry(made.pixels(torch.from_numpy(pixels)[None].float()))}
    at[48] = made.encode_1.first(at[52])
    at[45] = at[52] + made.encode_1.second(at[48])
    at[42] = made.down_1(at[45])
    at[40] = made.encode_2.first(at[42])
    at[37] = at[42] + made.encode_2.second(at[40])
    at[34] = made.down_2(at[37])
    at[32] = made.bottom.first(at[34])
    at[29] = at[34] + made.bottom.second(at[32])
    at[27] = made.up_2(at[29])
    at[24] = made.merge_2(torch.cat((at[27], at[37]), 1))
    at[20] = made.decode_2.first(at[24])
    at[17] = at[24] + made.decode_2.second(at[20])
    at[15] = made.up_1(at[17])
    at[12] = made.merge_1(torch.cat((at[15], at[45]), 1))
    at[8] = made.decode_1.first(at[12])
    at[5] = at[12] + made.decode_1.second(at[8])
    at[2] = made.activate(made.normalize(at[5]))
    return at


def test_each_layer_is_tapped_where_the_thesis_says() -> None:
    torch.manual_seed(4)
    made = DfDNet(SMALL).eval()
    both = np.random.default_rng(0).integers(0, 256, (26, 33, 6)).astype(np.uint8)
    expected, found = by_hand(made, both), counting.tap(made, both[..., :3], both[..., 3:])
    assert list(found) == list(counting.TAPS) == [*LAYERS[:-1], 2]
    for layer, maps in expected.items():
        vectors = maps[0].flatten(1).double()
        assert found[layer][1] == vectors.shape[1]
        assert found[layer][0] == pytest.approx((vectors @ vectors.T).numpy(), rel=1e-6)
    # Nothing is left hanging on the network.
    assert not any(module._forward_hooks for module in made.modules())


def on_vectors(vectors: counting.Matrix, seed: int, tuning: counting.Tuning) -> NDArray[np.intp]:
    """The map as its definition has it: neurons are vectors, distances are taken one by one."""
    count = len(vectors)
    centred = vectors - vectors.mean(0)
    values, components = np.linalg.eigh(centred @ centred.T)
    first = components[:, -1] * np.sign(components[np.abs(components[:, -1]).argmax(), -1])
    direction = centred.T @ first / np.sqrt(values[-1])
    deviation = np.sqrt(values[-1] / count)
    neurons = np.linspace(-2.5, 2.5, count)[:, None] * deviation * direction

    def closest() -> NDArray[np.intp]:
        return np.array([((neurons - vector) ** 2).sum(1).argmin() for vector in centred])

    random = np.random.default_rng(seed)
    for epoch in range(200):
        won = closest()
        counted = random.random(count) >= 0.1
        late = 1.0 if tuning == "neighbours" else 0.0
        radius = 1 + (2 - 1) * (1 - epoch / 100) if epoch < 100 else late
        moved = neurons.copy()
        for neuron in range(count):
            shares = (np.abs(won - neuron) <= radius).astype(float) + (won == neuron)
            shares *= counted
            if shares.any():
                moved[neuron] = shares @ centred / shares.sum()
        neurons = moved
    return closest()


def different(won: NDArray[np.intp]) -> int:
    return len(np.unique(won))


@pytest.mark.parametrize("tuning", ["own", "neighbours"])
def test_on_products_it_is_the_map_on_vectors(tuning: counting.Tuning) -> None:
    random = np.random.default_rng(5)
    vectors = random.standard_normal((6, 40))[random.integers(0, 6, 24)]
    vectors = 7 + vectors + 0.3 * random.standard_normal((24, 40))
    expected = on_vectors(vectors, 3, tuning)
    assert counting.winners(vectors @ vectors.T, 3, tuning).tolist() == expected.tolist()
    assert 2 < different(expected) < 24


@pytest.mark.slow
def test_a_count_has_no_zero_point() -> None:
    # The reference: 46 to 56 of 128, 83 to 107 of 256, where nothing is redundant; and groups
    # whose members differ by a hundredth are split, so that a count is no number of groups.
    random = np.random.default_rng(0)
    for filters, lowest, highest in ((128, 42, 58), (256, 80, 107)):
        found = []
        for seed in range(6):
            vectors = random.standard_normal((filters, 2000))
            found.append(different(counting.winners(vectors @ vectors.T, seed)))
        assert lowest <= np.mean(found) <= highest
    groups = random.standard_normal((20, 2000))[np.arange(128) % 20]
    alike = groups + 0.01 * random.standard_normal(groups.shape)
    assert different(counting.winners(alike @ alike.T)) > 40


def test_noise_is_drawn_as_vectors_would_be() -> None:
    random = np.random.default_rng(2)
    grams = np.array([counting.noise_gram(4, 50, random) for _ in range(3000)])
    assert grams.mean(0) == pytest.approx(50 * np.eye(4), abs=0.8)
    # Of a Wishart distribution: n off the diagonal, 2 n on it.
    assert grams.var(0) == pytest.approx(50 * (np.eye(4) + 1), rel=0.15)


def test_a_place_and_equal_inputs_do_not_matter() -> None:
    vectors = np.random.default_rng(3).standard_normal((16, 200))
    won = counting.winners(vectors @ vectors.T)
    moved = vectors + 1000
    assert counting.winners(moved @ moved.T).tolist() == won.tolist()
    assert counting.winners(np.ones((5, 5))).tolist() == [0] * 5


def test_twenty_groups_of_equal_outputs_among_128_are_found_and_no_more() -> None:
    for seed in range(4):
        random = np.random.default_rng(seed)
        group = random.permutation(np.arange(128) % 20)
        vectors = random.standard_normal((20, 2000))[group]
        won = counting.winners(vectors @ vectors.T, seed)
        assert different(won) == 20
        assert all(different(won[group == number]) == 1 for number in range(20))
