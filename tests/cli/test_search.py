from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("torch", reason="needs the extra nets")
from dfdbench.datasets.dataset import Dataset
from tests.cli.command import Command

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
    early = dfdbench(*search, "--max-time", "0.001s")
    assert early.status == 0, early.err
    assert "time was up after 0 trainings; the same command goes on" in early.err
    done = dfdbench(*search)
    assert done.status == 0, done.err
    assert {path.name for path in FOLDER.iterdir()} == {
        "best.toml",
        "convergence.png",
        "objective.png",
        "particles",
        "positions.csv",
        "search.json",
        "search.md",
        "widths.png",
    }
    assert "selected on scenes held out of test" in done.out
    assert "| layer | filters | baseline |" in (FOLDER / "search.md").read_text()
    found = str(FOLDER / "best.toml")
    trained = dfdbench(
        "train", "dfd-net", "--dataset", str(tiny_store.path), "--config", found, "--threads", "1"
    )
    assert trained.status == 0, trained.err
    assert dfdbench(*search).out == done.out


def test_users_mistakes_end_with_status_2(dfdbench: Command, tiny_store: Dataset) -> None:
    search = ["thesis", "search", "architecture", "--dataset", str(tiny_store.path), *SMALL]
    assert dfdbench(*search, "--iterations=0").status == 0
    log = FOLDER / "positions.csv"
    before = log.read_text()
    for arguments, message in (
        (["--bounds=width=8:64"], "the folder holds another search"),
        (["--gamma=0.5"], "gamma"),
        (["--variant=author"], "another search"),
        (["--variant=autor", "--out=x"], "did you mean author"),
        (["--bounds=width=8-64"], "width=8:512"),
        (["--bounds=crop=12:64", "--out=x"], "at most 24"),
        (["--as-thesis", "--hold-out=1"], "holds no scenes out"),
        (["--set=crop=16"], "chooses this itself"),
        (["--split=train"], "too few to hold"),
        (["--scheduler=tcp://127.0.0.1:9", "--workers=2"], "own number of workers"),
        (["--max-time=30"], "as 90s, 30m, 1h30m"),
    ):
        done = dfdbench(*search, "--out", str(FOLDER), *arguments)
        assert done.status == 2, (arguments, done.err)
        assert message in done.err, arguments
        assert "Traceback" not in done.err
    assert log.read_text() == before
    rows = before.splitlines()
    cells = rows[1].split(",")
    cells[rows[0].split(",").index("width_8")] = "600"
    log.write_text("\n".join([rows[0], ",".join(cells), *rows[2:]]) + "\n")
    done = dfdbench(*search)
    assert done.status == 2
    assert "width_8 is 600.0, but this search comes to" in done.err
    assert "600" in log.read_text()


def test_a_search_that_found_nothing_ends_with_status_1(
    dfdbench: Command, tiny_store: Dataset
) -> None:
    search = ["thesis", "search", "architecture", "--dataset", str(tiny_store.path), *SMALL]
    done = dfdbench(*search, "--iterations=0", "--set=learning_rate=1e30")
    assert "every training failed: nothing was found" in done.err
    assert done.status == 1
    assert (FOLDER / "search.md").is_file()
