from functools import partial
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import dfdbench
from dfdbench.datasets.dataset import Dataset
from dfdbench.errors import DfdbenchError, InputError
from dfdbench.report.objects import Transfer
from tests.conftest import TINY_TOML
from tests.evaluation.made_methods import write_mean
from tests.made_results import make_result


@pytest.fixture
def dark_store(tiny_folder: Path, tmp_path: Path) -> Dataset:
    """The tiny set with other depths, all below 64."""
    for path in tiny_folder.rglob("disp*.png"):
        Image.fromarray(np.asarray(Image.open(path)) // 4).save(path)
    manifest = tmp_path / "dark-1.toml"
    manifest.write_text(TINY_TOML.replace('"tiny"', '"dark"'))
    return dfdbench.build(str(manifest), tiny_folder, store=tmp_path / "dark.zarr")


@pytest.mark.parametrize(("other", "told"), [(0.18, "0.90 times"), (None, "lacks a mean")])
def test_the_worst_is_a_foreign_fit(other: float | None, told: str) -> None:
    scores = {("a", "a"): 0.1, ("b", "a"): 0.09, ("a", "b"): other, ("b", "b"): 0.2}
    place = ("a", 1, 1, 0)
    results = {pair: make_result({place: score}) for pair, score in scores.items()}
    assert told in Transfer(results, "thesis", Path()).as_table().notes[0]


@pytest.mark.slow
def test_a_fit_costs_elsewhere(tiny_store: Dataset, dark_store: Dataset, tmp_path: Path) -> None:
    run = partial(dfdbench.run_transfer, write_mean(tmp_path), [tiny_store, dark_store])
    found = run(out=tmp_path / "runs")
    assert list(found.table().index) == list(found.table().columns) == ["tiny", "dark"]
    means = found.table().to_numpy()
    # Off by the difference of the means, and by more than where it was fitted.
    assert (means > np.diag(means) + 0.1).tolist() == [[False, True], [True, False]]
    assert found.worst() == pytest.approx((means / np.diag(means)).max())
    assert f"{found.worst():.2f} times" in found.as_table().notes[0]
    assert [path.name for path in found.draw()] == ["transfer.png"]
    again = run(out=tmp_path / "runs")
    # Nothing is run twice: even the times are the same.
    assert again.results == found.results


def test_refusals_say_why(tiny_store: Dataset, dark_store: Dataset, tmp_path: Path) -> None:
    mean = write_mean(tmp_path)
    for wrong in ([tiny_store, tiny_store], [tiny_store]):
        with pytest.raises(InputError, match=f"each named once; got {len(wrong)}"):
            dfdbench.run_transfer("local", wrong)
    stores = [tiny_store, dark_store]
    for method, protocol, split, said in (
        ("constant", "valid", "test", "has no fit on tiny"),
        (mean, "nope", "test", "unknown protocol"),
        (mean, "valid", "nope", "nope"),
    ):
        with pytest.raises(DfdbenchError, match=said):
            dfdbench.run_transfer(method, stores, split, protocol=protocol, out=tmp_path / "runs")
        # Nothing was run for it.
        assert not (tmp_path / "runs").exists()
