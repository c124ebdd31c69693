import os
from pathlib import Path

import pytest

from dfdbench.datasets.dataset import Dataset
from tests.cli.command import QUICK, Command
from tests.conftest import make_published
from tests.methods.made_weights import save_small

pytest.importorskip("torch", reason="needs the extra nets")


def test_users_mistakes_end_with_status_2(dfdbench: Command, tiny_store: Dataset) -> None:
    store = ["--dataset", str(tiny_store.path)]
    for values, message in (("", "not a list"), ("16,17", "multiple of 4"), ("16,64", "24")):
        sizes = ("thesis experiment patch-size", *store, QUICK[0], "--values", values)
        dfdbench.refused(message, *sizes)
    assert not Path("training").exists()
    dfdbench.refused("did you mean noise", "thesis experiment nose", *store)
    for level in "04":
        reduce = ("thesis reduce --weights demo --level", level, *store)
        dfdbench.refused("Invalid value for '--level'", *reduce)


@pytest.mark.slow
def test_voltage_pairs_are_built_and_trained_into_one_table(dfdbench: Command) -> None:
    make_published(Path("site"), ("k33", "k37"))
    command = ["thesis", "experiment", "voltage-pairs", "--values", "135-129,141-129", *QUICK]
    dfdbench.refused("--source DIR", *command)
    for values, told in (
        ("135", "as 141-129,140-130"),
        ("135-129,135-150", "135,150 are not two steps of 127 to 143"),
    ):
        dfdbench.refused(told, f"thesis experiment voltage-pairs --values {values} --source site")
    assert "--source DIR" in dfdbench(*command).err  # nothing was built before it was said
    done = dfdbench.fine(*command, "--source", "site", "--format", "csv")
    folder = Path("training/realworld-1-experiments/voltage-pairs-dfd-net")
    assert {"135-129-seed0", "141-129-seed0"} < {path.name for path in folder.iterdir()}
    assert "135-129" in done.out
    assert "141-129" in done.out
    stores = Path(os.environ["DFDBENCH_CACHE"], "stores")
    for pair in ([135, 129], [141, 129]):
        store = Dataset(stores / "realworld-1-{}-{}.zarr".format(*pair))
        assert store.attributes["options"] == {"pair": pair}
    # The set that `build` makes is never taken for an experiment's.
    assert not (stores / "realworld-1.zarr").exists()
    assert "realworld-1, split train-pruned" in (folder / "135-129-seed0/weights.md").read_text()
    again = dfdbench(*command, "--format", "csv")  # the sets lie in the cache
    assert (again.status, again.out) == (0, done.out), again.err


FEW = ["--set=crop=16", "--set=crops_per_step=1", "--set=steps=2", "--set=evaluate_pairs=1"]
HERE = ["--device=cpu", "--threads=1"]


@pytest.mark.slow
def test_reduced_networks_are_trained_and_compared(dfdbench: Command, tiny_store: Dataset) -> None:
    weights, dataset = str(save_small(Path("mine.safetensors"))), str(tiny_store.path)
    reduce = f"thesis reduce --weights {weights} --dataset {dataset} --rounds H"
    done = dfdbench.fine(reduce, *FEW, *HERE)
    assert "noise, mean" in done.out
    folder = Path("training/tiny-reduction/mine")
    assert str(folder) in done.err
    assert (folder / "B-03-03H.toml").exists()
    assert "no zero point" in (folder / "counts.md").read_text()
    own = f"{reduce} --config {folder / 'original.toml'}"
    dfdbench.refused("would write into one of its inputs", own, *FEW, *HERE)
    command = ["thesis experiment reduction --dataset", dataset, "--rows", str(folder), *HERE]
    command += ["--values", "original,B-01-01", "--repeats", "2"]
    trained = dfdbench.fine(*command, "--format", "csv")
    kept = Path("training/tiny-experiments/reduction-dfd-net")
    lines = trained.out.splitlines()
    assert [line.split(",")[0] for line in lines[1:]] == ["original", "B-01-01"] * 2
    assert lines[-1].endswith("thesis-networks-2")
    folders = {f"{name}-seed{seed}" for name in ("original", "B-01-01") for seed in (0, 1)}
    assert {path.name for path in kept.iterdir() if path.is_dir()} == folders
    assert (kept / "reduction.png").exists()
    dfdbench.fine(f"train dfd-net --config {folder / 'B-01-01.toml'} --dataset {dataset}", *HERE)


SMALL = [
    "--split=test", "--particles=2", "--iterations=1", "--steps=2", "--score-pairs=1",
    "--set=narrow=64", "--set=crops_per_step=1", "--set=expansion=one", "--config=quick",
    "--bounds=crop=12:16", "--bounds=kernel=1:3", "--bounds=width=8:128",
    "--device=cpu", "--threads=1",
]  # fmt: skip
FOLDER = Path("training/tiny-search/thesis-quick")


@pytest.mark.slow
def test_search_then_train_what_was_found(dfdbench: Command, tiny_store: Dataset) -> None:
    search = ["thesis", "search", "architecture", "--dataset", str(tiny_store.path), *SMALL]
    early = dfdbench.fine(*search, "--max-time", "0.001s")
    assert "time was up after 0 trainings; the same command goes on" in early.err
    done = dfdbench.fine(*search)
    assert " ".join(sorted(path.name for path in FOLDER.iterdir())) == (
        "best.toml convergence.png objective.png particles positions.csv search.json search.md "
        "widths.png"
    )
    assert "selected on scenes held out of test" in done.out
    assert "| layer | filters | baseline |" in (FOLDER / "search.md").read_text()
    found = str(FOLDER / "best.toml")
    dfdbench.fine(f"train dfd-net --dataset {tiny_store.path} --config {found} --threads 1")
    assert dfdbench(*search).out == done.out


def test_users_mistakes_end_with_status_2_search(dfdbench: Command, tiny_store: Dataset) -> None:
    search = ["thesis", "search", "architecture", "--dataset", str(tiny_store.path), *SMALL]
    assert dfdbench(*search, "--iterations=0").status == 0
    log = FOLDER / "positions.csv"
    before = log.read_text()
    for arguments, message in (
        (["--bounds=width=8:64"], "the folder holds another search"),
        (["--gamma=0.5"], "gamma"),
        (["--variant=autor", "--out=x"], "did you mean author"),
        (["--bounds=width=8-64"], "width=8:512"),
        (["--as-thesis", "--hold-out=1"], "--hold-out cannot be given with --as-thesis"),
    ):
        dfdbench.refused(message, *search, "--out", str(FOLDER), *arguments)
    assert log.read_text() == before
    rows = before.splitlines()
    cells = rows[1].split(",")
    cells[rows[0].split(",").index("width_8")] = "600"
    log.write_text("\n".join([rows[0], ",".join(cells), *rows[2:]]) + "\n")
    dfdbench.refused("width_8 is 600.0, but this search comes to", *search)
    assert "600" in log.read_text()
    # One that found nothing ends with 1.
    done = dfdbench(*search, "--iterations=0", "--set=learning_rate=1e30", "--out=nothing")
    assert "every training failed: nothing was found" in done.err
    assert done.status == 1
    assert Path("nothing/search.md").is_file()
