from __future__ import annotations

import pytest

pytest.importorskip("torch", reason="needs the extra nets")
import torch

from dfdbench.datasets.store import Store
from dfdbench.errors import InputError, UnknownNameError
from dfdbench.methods.networks.architectures import DfDNet
from dfdbench.training.reduction.counts import (
    TAPPED_LAYERS,
    Counts,
    count_clusters,
    counts_table,
    samples_of,
)
from tests.methods.networks.test_architectures import SMALL


def test_a_sample_is_the_first_pair_of_each_scene(tiny_store: Store) -> None:
    assert [pair.scene for pair in samples_of(tiny_store, "test")] == ["Two", "Three"]
    assert samples_of(tiny_store, "test")[0] == tiny_store.pairs("test")[0]
    with pytest.raises(UnknownNameError, match="test"):
        samples_of(tiny_store, "tset")


@pytest.mark.slow
def test_layers_are_counted_and_equal_filters_once(tiny_store: Store) -> None:
    torch.manual_seed(1)
    network = DfDNet(SMALL).eval()
    with torch.no_grad():
        # All filters of layer 34 alike: one is as good as all.
        network.down_2.weight[:] = network.down_2.weight[:1]  # type: ignore[index, operator]
        network.down_2.bias.zero_()  # type: ignore[operator]
    samples = samples_of(tiny_store, "test")
    seen: list[tuple[int, int]] = []
    counts = count_clusters(network, tiny_store, samples, on_map=lambda *done: seen.append(done))
    assert counts.found[34] == (1, 1)
    assert dict(counts.filters) == dict(zip(TAPPED_LAYERS, (*SMALL[:-1], SMALL[-2]), strict=True))
    for layer, filters in counts.filters.items():
        assert all(1 <= count <= filters for count in counts.found[layer] + counts.noise[layer])
    assert counts.noise[34][0] > 1
    assert counts.samples == tuple(pair.id for pair in samples)
    assert seen[-1] == (36, 36)
    assert count_clusters(network, tiny_store, samples) == counts


def test_a_sample_too_small_is_named(tiny_store: Store) -> None:
    wide = DfDNet((*[4] * 6, 50, 4, 50, *[4] * 8, 256)).eval()  # 6 x 7 pixels on the third level
    with pytest.raises(InputError, match=r"Two/.*, layer 34"):
        count_clusters(wide, tiny_store, samples_of(tiny_store, "test"))


def test_the_table_has_the_form_of_d_1_with_noise_below_and_says_what_it_is_not() -> None:
    found = dict.fromkeys(TAPPED_LAYERS, (33, 44, 47))
    noise = dict.fromkeys(TAPPED_LAYERS, (46, 56, 51))
    counts = Counts(dict.fromkeys(TAPPED_LAYERS, 128), found, noise, ("a", "b", "c"))
    table = counts_table(counts, "T")
    assert table.columns == ("layer", *map(str, TAPPED_LAYERS))
    rows = {row[0]: set(row[1:]) for row in table.rows}
    assert rows == {
        "filters": {"128"},
        "min": {"33"},
        "mean": {"41"},
        "max": {"47"},
        "noise, min": {"46"},
        "noise, mean": {"51"},
        "noise, max": {"56"},
    }
    assert "no zero point" in table.notes[1]
    assert "a, b, c" in table.notes[0]
