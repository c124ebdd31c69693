"""`make leaderboard`: it runs what is there and says what it could not run."""

import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from dfdbench.cli.options import values_of
from dfdbench.datasets.catalog import find_manifest
from dfdbench.datasets.dataset import Dataset
from dfdbench.methods.registry import built_in_methods

HERE = Path(__file__).parents[1] / "leaderboard"
ROWS = """
[[sets]]
dataset = "demo"
splits = ["Market"]
methods = ["constant"]

[[sets]]
dataset = "middlebury-default"
splits = ["test"]
methods = ["constant", "local"]

[[tracks]]
dataset = "middlebury-default"
splits = ["test"]
methods = ["constant"]
"""


@pytest.mark.slow
def test_what_is_not_built_is_left_out_by_name(
    demo_store: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stores = tmp_path / "cache/stores"
    stores.mkdir(parents=True)
    (stores / "demo-1.zarr").symlink_to(str(demo_store.path))
    monkeypatch.setenv("DFDBENCH_CACHE", str(tmp_path / "cache"))
    (tmp_path / "leaderboard/results").mkdir(parents=True)
    (tmp_path / "rows.toml").write_text(ROWS)
    done = subprocess.run(
        [sys.executable, str(HERE / "rerun.py"), "rows.toml"],
        cwd=tmp_path, capture_output=True, encoding="utf-8", check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    left_out = [line for line in done.stderr.splitlines() if line.startswith("left out")]
    assert [line.split(": ")[0].split(None, 2)[2] for line in left_out] == [
        "middlebury-default, split test, constant",
        "middlebury-default, split test, local",
        "middlebury-default, split test, constant",
    ]
    assert all("dfdbench build middlebury-default" in line for line in left_out)
    assert (tmp_path / "leaderboard/results/demo-1-Market/constant.json").exists()
    assert "verified     leaderboard/results/demo-1-Market/constant.json" in done.stdout
    assert "constant" in (tmp_path / "leaderboard/README.md").read_text("utf-8")


def test_the_rows_that_are_listed_can_be_run() -> None:
    listed = tomllib.loads((HERE / "rows.toml").read_text("utf-8"))
    assert listed.keys() == {"sets", "tracks"}
    for kind, wanted in [(name, item) for name, items in listed.items() for item in items]:
        manifest = find_manifest(wanted["dataset"])
        assert kind == "sets" or manifest.recipe is not None
        for split in wanted["splits"]:
            assert manifest.pairs(split)
        for method in wanted["methods"]:
            name, *options = method.split()
            assert name in built_in_methods()
            if kind == "tracks" and "--given-blur" in options:
                options.remove("--given-blur")
            assert options[::2] == ["--param"] * (len(options) // 2)
            values_of(options[1::2], "--param")
