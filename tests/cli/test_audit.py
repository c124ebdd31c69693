import json
import re
import shutil
import tomllib
from pathlib import Path

import jsonschema
import pytest

from dfdbench.blur.law import law_of_fields
from dfdbench.datasets.catalog import find_manifest
from dfdbench.datasets.dataset import Dataset
from dfdbench.datasets.manifest_file import parse_manifest
from dfdbench.results.record import load_result
from tests.cli.command import Command
from tests.conftest import TINY_TOML, store_of


def test_depths_are_counted_and_drawn(dfdbench: Command, uneven: str) -> None:
    whole = dfdbench("audit depths", uneven, "--format", "csv", "--figure", "figures/depths.png")
    lines = whole.out.splitlines()
    assert (lines[0], len(lines)) == ("level,pixels,share", 257)
    # Three: 3 pairs of 4 rows of 32 pixels, of which 11 columns are 36.
    assert lines[37].split(",")[:2] == ["36", str(3 * 4 * 11)]
    assert Path("figures/depths.png").stat().st_size > 10_000
    scene = dfdbench("audit depths", uneven, "--split", "One", "--format", "markdown")
    assert "| 96-111 | 2,760 | 100.0 % | 96-99, 101-111 |" in scene.out
    assert "| 32-47 | 0 | 0 % | all |" in scene.out
    dfdbench.refused("did you mean One", "audit depths", uneven, "--split", "Ome")


@pytest.mark.slow
def test_errors_by_depth_stand_beside_a_constants(dfdbench: Command, uneven: str) -> None:
    for level in ("90", "40"):
        run = f"run --dataset {uneven} --split all --method constant --out runs/{level}"
        dfdbench.fine(run, "--param", f"training_mean={level}")
    runs = "--result runs/90 --result runs/40/result.json --figure errors.png"
    both = dfdbench(f"audit depths {uneven} {runs} --format csv")
    assert Path("errors.png").stat().st_size > 10_000
    heading, *rows = both.out.splitlines()
    assert heading.startswith("levels,of all,constant (training_mean=90),")
    # 11 columns of 36, 11 of 37 and 10 of 38 are answered with 90, and with 40.
    (near,) = [row.split(",") for row in rows if row.startswith("36-38,")]
    assert near[2:4] == ["53.03", "3.03"]
    few = f"run --dataset {uneven} --split all --method constant --limit 1 --out runs/few"
    dfdbench.fine(few, "--param", "training_mean=90")
    partial = " ".join(
        dfdbench(f"audit depths {uneven} --result runs/few --format markdown").out.split()
    )
    assert re.search(r"of known depth of 1 of \d+ pairs together", partial), partial
    dfdbench.fine(few.replace("all", "K2").replace("few", "K2"), "--param", "training_mean=90")
    partial = dfdbench(f"audit coverage {uneven} --result runs/K2 --format markdown").out
    assert re.search(r", only 1 of \d+ pairs, by what", partial), partial
    again = f"audit depths {uneven} --split all --result runs/90"
    dfdbench.refused("--split cannot be given with --result", again)


@pytest.mark.slow
def test_difficulty_has_a_row_a_scene_and_lighting(dfdbench: Command, uneven: str) -> None:
    dfdbench.fine("audit difficulty", uneven, "--split", "all")
    rows = json.loads(Path("results/uneven-difficulty/all/difficulty.json").read_text())["rows"]
    assert len(rows) == 6
    assert all(0 <= row["neighbours"] <= 1 for row in rows)
    harder = dfdbench.facts(f"audit difficulty {uneven} --split all --noise 20")
    for quiet, noisy in zip(rows, harder["rows"], strict=True):
        assert quiet["neighbours"] < noisy["neighbours"]
    assert Path("results/uneven-difficulty/all/difficulty.png").exists()


def test_a_run_of_another_split_has_no_bound(dfdbench: Command, uneven: str) -> None:
    run = f"run --split Two --method constant --dataset {uneven} --out runs/constant"
    dfdbench.fine(run, "--no-figures", "--no-predictions")
    bound = f"audit difficulty {uneven} --result runs/constant --split One --bound"
    dfdbench.refused("no run of split One", bound)


@pytest.mark.slow
def test_the_bound_stands_beside_runs_of_a_store(dfdbench: Command, demo_store: Dataset) -> None:
    demo = str(demo_store.path)
    for name, method in (("good", "s-transform"), ("bad", "constant")):
        dfdbench.fine("run --split Market --dataset", demo, "--method", method, "--out", name)
    shutil.copytree("bad", "more/bad")
    bound = ("audit difficulty", demo, "--split", "Market", "--bound", "--result", "more/bad")
    shown = dfdbench.fine(*bound, "--result", "bad", "--result", "good/result.json", "--out", "out")
    assert "constant, bad" in shown.out
    assert "constant, more/bad" in shown.out
    assert shown.out.index("least error") < shown.out.index("s-transform")
    assert shown.out.index("s-transform") < shown.out.index("constant")
    kept = json.loads(Path("out/bound.json").read_text())
    assert len(law_of_fields(kept["law"]).sigmas) == 256
    rows = kept["rows"]
    assert len(rows) == len(demo_store.pairs("Market"))
    assert all(0 < row["21"] <= row["7"] <= row["1"] for row in rows)
    assert Path("out/bound.png").stat().st_size > 5_000


def test_a_proposed_split_is_a_fragment_of_a_manifest(dfdbench: Command, uneven: str) -> None:
    outcome = dfdbench.fine("audit split", uneven, "--test-scenes", "2", "--criterion", "thesis")
    assert "(published)" in outcome.out
    fragment = Path("results/uneven-splits/test-2/split.toml").read_text()
    manifest = parse_manifest((TINY_TOML + fragment).encode(), "tiny-1.toml")
    assert set(manifest.scenes_of("train-covered")).isdisjoint(manifest.scenes_of("test-covered"))
    assert len(manifest.scenes_of("test-covered")) == 2
    found = dfdbench.facts("audit split", uneven, "--test-scenes", "1")
    assert (found["choices"], found["exhaustive"], found["published"]["rank"]) == (3, True, None)
    assert found["candidates"][-1]["test"] == ["Three"]
    folds = dfdbench("audit split", uneven, "--folds", "3")
    kept = json.loads(Path("results/uneven-splits/folds-3/folds.json").read_text())
    assert (kept["cannot_be_covered"][0]["scene"], kept["seed"]) == ("Three", 0)
    assert "Three: rare in all other scenes: 36-38" in folds.out
    fragment = Path("results/uneven-splits/folds-3/folds.toml").read_text()
    assert len(tomllib.loads(fragment)["folds"]) == 3


def test_a_published_test_that_parts_what_looks_alike_is_not_proposed(
    dfdbench: Command, uneven: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    groups = [("One", "Two"), ("Three",)]
    monkeypatch.setattr("dfdbench.audit.splits.scenes_alike", lambda *given: groups)
    outcome = dfdbench.fine("audit split", uneven, "--test-scenes", "2")
    assert "the published test parts Two from scenes that look alike" in outcome.out
    fragment = Path("results/uneven-splits/test-2/split.toml").read_text()
    manifest = parse_manifest((TINY_TOML + fragment).encode(), "tiny-1.toml")
    assert manifest.scenes_of("test-covered") == ("One", "Two")


def test_what_training_lacks_is_named_and_ends_with_1(dfdbench: Command, uneven: str) -> None:
    outcome = dfdbench("audit coverage", uneven, "--criterion", "thesis")
    assert outcome.status == 1
    row = next(line for line in outcome.out.splitlines() if "36-38" in line)
    assert "missing" in row
    assert "Three 100.0 %" in row
    assert "NOT covered" in outcome.out
    folder = Path("results/uneven-coverage/train-test")
    record = json.loads((folder / "coverage.json").read_text())
    schema = Path(__file__).parents[2] / "dfdbench/results/schemas/coverage-1.json"
    jsonschema.validate(record, json.loads(schema.read_text()))
    assert record["schema_version"] == 1
    # Three: 3 pairs of 4 rows of 32 pixels; 7 pairs in all, one row of each unknown.
    assert record["ranges"][0]["test_pixels"] == 3 * 4 * 32
    assert record["test"]["unknown_pixels"] == 4 * 31 + 3 * 32
    assert record["verdicts"][36:39] == ["missing"] * 3
    assert (folder / "coverage.png").stat().st_size > 10_000
    assert dfdbench.facts("audit coverage", uneven, "--criterion", "thesis", status=1) == record


@pytest.mark.slow
def test_a_covered_test_ends_with_status_0(dfdbench: Command, uneven: str) -> None:
    fine = dfdbench("audit coverage", uneven, "--train", "Two", "--test", "One")
    assert (fine.status, fine.out.splitlines()[-1][:8]) == (0, "covered:")
    dfdbench.fine(f"audit coverage {uneven} --allow 0.2 --criterion density")
    assert dfdbench("audit coverage", uneven, "--fold", "K2").status == 1


def test_each_fold_and_each_scene_have_their_row(dfdbench: Command, uneven: str) -> None:
    folds = dfdbench("audit coverage", uneven, "--each", "fold", "--format", "markdown")
    assert folds.status == 1
    assert "| K2 | Three |" in folds.out
    records = dfdbench.facts("audit coverage", uneven, "--each", "scene", status=1)["records"]
    assert records["Three"]["shares"]["missing"] > 0
    assert records["One"]["shares"]["missing"] == 0


def test_leaks_are_an_error(dfdbench: Command, uneven: str) -> None:
    audit = f"audit coverage {uneven} --train all --test Two"
    outcome = dfdbench.refused("the same scene in training and test", audit)
    kept = json.loads(Path("results/uneven-coverage/all-Two/coverage.json").read_text())
    assert [leak["kind"] for leak in kept["leaks"]] == ["scene"]
    assert kept["covered"] is False
    assert "LEAK: training holds 1 scene of the test" in outcome.out


@pytest.mark.slow
def test_errors_of_a_run_are_told_apart_by_coverage(dfdbench: Command, uneven: str) -> None:
    ran = dfdbench.fine("run --method mymodule:Elsewhere --dataset", uneven, "--split", "K2")
    path = Path("results/uneven-K2/mymodule-Elsewhere/result.json")
    (warning,) = load_result(path).warnings
    assert "tiny-1, all but K2, leaves missing or scarce: 36-38" in warning
    assert "missing or scarce: 36-38" in ran.out
    assert dfdbench("audit coverage", uneven, "--result", str(path)).status == 1
    errors = json.loads((path.parent / "coverage/errors.json").read_text())
    assert errors["verdicts"]["covered"]["mean_absolute_error"] == 0
    assert errors["verdicts"]["missing"]["mean_absolute_error"] == pytest.approx(63, abs=0.1)
    assert errors["excess"] == 1
    assert "gather where training lacks levels" in errors["conclusion"]
    for figure in ("coverage.png", "errors.png", "masks.png"):
        assert (path.parent / "coverage" / figure).stat().st_size > 5_000


def test_a_damaged_store_has_no_verdict(dfdbench: Command, uneven: str) -> None:
    for chunk in (Path(uneven) / "Two/depth").glob("c*"):
        chunk.unlink()
    for verb in ("coverage", "coverage --each scene", "split --folds 2", "difficulty --split all"):
        dfdbench.refused("Two/depth", f"audit {verb}", uneven)
    assert not Path("results").exists()


def test_a_mistake_is_told(dfdbench: Command, uneven: str) -> None:
    dfdbench.refused("no place is named", "audit coverage", uneven, "--out", "")
    for words, told in (
        ("coverage", "no data set is named"),
        ("coverage STORE --fold K1 --train Two", "--train cannot be given with --fold"),
        ("coverage STORE --fold K7", "did you mean K"),
        ("coverage STORE --each fold --test Two", "--test cannot be given with --each"),
        ("coverage STORE --each fold --fold K1", "leave out --fold"),
        ("coverage STORE --result none.json", "cannot read the result"),
        ("coverage STORE --out mymodule.py", "choose another place"),
        ("coverage mymodule.py", "a file, and not a data set"),
        ("coverage STORE --density-factor inf", "(density_factor): expected a finite number"),
        ("split STORE", "ask for either"),
        ("split STORE --test-scenes 3", "--test-scenes 1 or 2"),
        ("split STORE --folds 9", "choose 2 to"),
        ("difficulty STORE --split tset", "did you mean test"),
        ("difficulty STORE --result none", "add --bound"),
    ):
        dfdbench.refused(told, "audit " + words.replace("STORE", uneven))


@pytest.mark.slow
def test_the_thesis_found_the_same(dfdbench: Command, shared_data: Path, tmp_path: Path) -> None:
    """The thesis says that K03 lacks levels 35 to 38: Midd2's; Midd1's wall at 56 comes next."""
    manifest, middlebury = find_manifest("middlebury-default"), str(tmp_path / "middlebury.zarr")
    store_of(manifest, shared_data / "middlebury", tmp_path / "middlebury.zarr")
    fold = dfdbench.facts("audit coverage", middlebury, "--fold", "K03", status=1)
    ranges = sorted(fold["ranges"], key=lambda item: -item["share"])
    largest = [(item["first"], item["last"], next(iter(item["scenes"]))) for item in ranges[:2]]
    assert largest == [(36, 39, "Midd2"), (56, 56, "Midd1")]
    each = dfdbench.facts(f"audit coverage {middlebury} --each scene", status=1)["records"]
    uncovered = sorted(name for name in each if each[name]["shares"]["thesis"] > 0.01)
    assert " ".join(uncovered) == (
        "Art Baby2 Bowling1 Bowling2 Cloth2 Lampshade1 Laundry Midd1 Midd2 Monopoly Reindeer"
    )
    proposed = dfdbench.facts(f"audit split {middlebury} --test-scenes 3")
    assert (proposed["choices"], proposed["covered"]) == (2925, 141)
