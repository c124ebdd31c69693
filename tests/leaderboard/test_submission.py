import json
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest

from dfdbench.errors import ResultError
from dfdbench.leaderboard.folder import FINGERPRINTS, file_stems
from dfdbench.leaderboard.submission import future_problems, load_submission, submit
from dfdbench.results.record import Submission
from dfdbench.results.record_file import seal_of
from tests.made_results import limited, make_demo_result, make_result

WHEN = datetime(2026, 1, 2, 3, 4, 5, tzinfo=UTC)


def write(folder: Path, **changes: Any) -> Path:
    return submit(make_demo_result(lambda pair: 0.1 * pair.at["view"], **changes), folder, WHEN)[0]


def test_a_submission_is_a_sealed_file_a_protocol(tmp_path: Path) -> None:
    result = make_demo_result(lambda pair: 0.1, protocols=("thesis", "valid"))
    paths = submit(result, tmp_path, WHEN)
    assert [str(path.relative_to(tmp_path)) for path in paths] == [
        "results/demo-1-test/thesis/mine.json",
        "results/demo-1-test/valid/mine.json",
    ]
    loaded = load_submission(paths[1], tmp_path)
    assert loaded.protocol_names == ("valid",)
    assert set(loaded.pairs[0].scores) == {"valid"}
    assert loaded.submission is not None
    assert loaded.submission.submitted == "2026-01-02T03:04:05Z"


def test_a_later_run_of_the_same_method_takes_its_place(tmp_path: Path) -> None:
    assert write(tmp_path) == write(tmp_path)


def test_a_partial_run_takes_no_complete_ones_place(tmp_path: Path) -> None:
    whole = make_demo_result(lambda pair: 0.1, protocols=("thesis", "valid"))
    partial = limited(whole, 2)
    first = submit(partial, tmp_path, WHEN)
    assert submit(partial, tmp_path, WHEN) == first
    # Complete under one protocol is enough: nothing at all is written.
    kept = submit(make_demo_result(lambda pair: 0.1, protocols=("valid",)), tmp_path, WHEN)
    before = [path.read_bytes() for path in (*first, *kept)]
    with pytest.raises(ResultError, match="partial run") as raised:
        submit(partial, tmp_path)
    assert "2 pairs" in str(raised.value)
    assert [path.read_bytes() for path in (*first, *kept)] == before
    submit(whole, tmp_path, WHEN)
    assert all(load_submission(path, tmp_path).complete for path in first)


def test_names_that_make_one_file_name_do_not_replace_each_other(tmp_path: Path) -> None:
    paths = {write(tmp_path, name=name) for name in ("a|b", "a<b", 'a"b', "a🐟b", "../a b")}
    assert len(paths) == 5
    assert all(path.parent == tmp_path / "results/demo-1-test/thesis" for path in paths)
    assert {load_submission(path, tmp_path).method.name for path in paths} >= {"a🐟b", "../a b"}


def test_other_parameters_and_other_data_make_another_file(tmp_path: Path) -> None:
    first = write(tmp_path)
    assert write(tmp_path, parameters={"recipe": "text"}).name == "mine-recipe=text.json"
    assert write(tmp_path, fingerprint="3" * 64) != first


def edit_score(content: dict[str, Any]) -> None:
    content["pairs"][0]["scores"]["thesis"]["ssim"] += 0.01
    content["pairs"][1]["scores"]["thesis"]["ssim"] -= 0.01


def edit_average(content: dict[str, Any]) -> None:
    content["averages"]["thesis"]["nrmse"] = 0.01


def edit_seconds(content: dict[str, Any]) -> None:
    content["pairs"][0]["seconds"] = 0.001


def drop_pair(content: dict[str, Any]) -> None:
    del content["pairs"][0]
    content["dataset"]["expected"] = content["dataset"]["evaluated"] = len(content["pairs"])
    values = [pair["scores"]["thesis"] for pair in content["pairs"]]
    content["averages"]["thesis"] = {
        metric: sum(value[metric] for value in values) / len(values) for metric in values[0]
    }


def move_pair(content: dict[str, Any]) -> None:
    content["pairs"][0]["coordinates"]["exposure"] = 2


def other_fingerprint(content: dict[str, Any]) -> None:
    content["dataset"]["fingerprint"] = "9" * 64


def other_manifest(content: dict[str, Any]) -> None:
    content["dataset"]["manifest_sha256"] = "9" * 64


def other_protocol(content: dict[str, Any]) -> None:
    content["protocols"][0]["divisor"] = "255"


def no_submission(content: dict[str, Any]) -> None:
    del content["submission"]


def unknown_data(content: dict[str, Any]) -> None:
    content["dataset"]["name"] = "demmo-1"


@pytest.mark.parametrize("sealed_anew", [False, True])
@pytest.mark.parametrize(
    ("tamper", "told"),
    [
        (drop_pair, r"1 pair missing from the split(.|\n)*Kitchen/view1/illumination1/exposure0"),
        (move_pair, "coordinates are not those of its name"),
        (other_fingerprint, "fingerprint of other data than demo-1"),
        (other_manifest, "hash of another manifest"),
        (other_protocol, "not a released protocol"),
        (unknown_data, "unknown data set"),
        (edit_average, "average does not follow"),
    ],
)
def test_what_was_tampered_with_is_refused_with_its_reason(
    tmp_path: Path, tamper: Callable[[dict[str, Any]], None], told: str, sealed_anew: bool
) -> None:
    (tmp_path / FINGERPRINTS).write_text(json.dumps({"demo-1": ["2" * 64]}))
    path = write(tmp_path)
    content = json.loads(path.read_text())
    tamper(content)
    if sealed_anew:
        content["submission"]["seal"] = seal_of(content)
    path.write_text(json.dumps(content))
    expected = told if sealed_anew else f"{told}|edited after it was sealed"
    with pytest.raises(ResultError, match=expected):
        load_submission(path, tmp_path)


@pytest.mark.parametrize("tamper", [edit_score, edit_seconds])
def test_an_edit_that_keeps_the_averages_breaks_the_seal(
    tmp_path: Path, tamper: Callable[[dict[str, Any]], None]
) -> None:
    path = write(tmp_path)
    content = json.loads(path.read_text())
    tamper(content)
    path.write_text(json.dumps(content))
    with pytest.raises(ResultError, match="edited after it was sealed"):
        load_submission(path, tmp_path)


def test_another_layout_of_the_same_content_keeps_the_seal(tmp_path: Path) -> None:
    path = write(tmp_path)
    path.write_text(json.dumps(json.loads(path.read_text()), sort_keys=True))
    load_submission(path, tmp_path)


def test_an_edited_file_is_told_neither_the_seal_nor_only_half(tmp_path: Path) -> None:
    path = write(tmp_path)
    content = json.loads(path.read_text())
    dropped = content["pairs"].pop()["id"]
    path.write_text(json.dumps(content))
    with pytest.raises(ResultError, match="edited after it was sealed") as raised:
        load_submission(path, tmp_path)
    assert seal_of(content) not in str(raised.value)
    assert dropped in str(raised.value)


def test_a_file_bears_its_methods_name(tmp_path: Path) -> None:
    path = write(tmp_path)
    longer = file_stems("mine", "2" * 64)[1]
    for stem in ("foo", "copy", "mine-12345678"):
        with pytest.raises(ResultError, match="name is not its method's"):
            load_submission(path.rename(path.with_stem(stem)), tmp_path)
        path.with_stem(stem).rename(path)
    load_submission(path.rename(path.with_stem(longer)), tmp_path)


def test_a_file_without_protocols_is_refused(tmp_path: Path) -> None:
    path = write(tmp_path)
    content = json.loads(path.read_text())
    content |= {"protocols": [], "averages": {}}
    content["pairs"] = [{**pair, "scores": {}} for pair in content["pairs"]]
    content["submission"]["seal"] = seal_of(content)
    path.write_text(json.dumps(content))
    with pytest.raises(ResultError, match="wrong folder"):
        load_submission(path, tmp_path)


def test_a_plain_result_and_a_wrong_folder_are_refused(tmp_path: Path) -> None:
    path = write(tmp_path)
    moved = path.parent.with_name("valid") / path.name
    moved.parent.mkdir()
    moved.write_text(path.read_text())
    with pytest.raises(ResultError, match="wrong folder"):
        load_submission(moved, tmp_path)
    content = json.loads(path.read_text())
    no_submission(content)
    path.write_text(json.dumps(content))
    with pytest.raises(ResultError, match="--submit"):
        load_submission(path, tmp_path)


def test_a_run_on_a_set_of_ones_own_is_not_submitted(tmp_path: Path) -> None:
    with pytest.raises(ResultError, match="unknown data set"):
        submit(make_result({("a", 1, 1, 0): 0.1}), tmp_path)
    assert not list(tmp_path.rglob("*.json"))


def edited(folder: Path, edit: Callable[[dict[str, Any]], object]) -> Path:
    """A submission that was edited and sealed anew."""
    path = write(folder)
    content = json.loads(path.read_text())
    edit(content)
    content["submission"]["seal"] = seal_of(content)
    path.write_text(json.dumps(content))
    return path


def set_field(place: str, value: Any) -> Callable[[dict[str, Any]], None]:
    def edit(content: dict[str, Any]) -> None:
        *above, last = place.split(".")
        for name in above:
            content = content[name]
        content[last] = value

    return edit


def scores_as(change: Callable[[float], object]) -> Callable[[dict[str, Any]], None]:
    def edit(content: dict[str, Any]) -> None:
        for pair in content["pairs"]:
            pair["scores"]["thesis"]["ssim"] = change(pair["scores"]["thesis"]["ssim"])

    return edit


@pytest.mark.parametrize(
    ("edit", "told"),
    [
        (scores_as(str), "valid number"),
        (scores_as(lambda _: True), "valid number"),
        (set_field("averages.thesis.nrmse", "0.1"), "valid number"),
        (set_field("seed", True), "valid integer"),
        (set_field("schema_version", True), "another version"),
        (set_field("schema_version", 1.0), "another version"),
        (set_field("averages.other", {"nrmse": -5.0}), "not scored"),
        (set_field("averages.thesis.foo", 1.0), "nothing that was scored"),
        (set_field("dataset.recipe.parameters", {"sigma_min": 5.0}), "not the blur recipe"),
        (set_field("dataset.recipe.more", 1), "not the blur recipe"),
        (set_field("environment.cpu_count", -5), "cpu_count"),
        (set_field("environment.cpu_count", 10**4000), "cpu_count"),
        (set_field("method.parameters", {"x" * 1001: 1}), "too long to be shown"),
        (set_field("method.parameters", {"x": 10**4000}), "too long to be shown"),
        (set_field("method.parameters", {"x": [0.125] * 9999}), "too long to be shown"),
        (set_field("method.paper", "x" * 1001), "too long to be shown"),
        (set_field("method.paper", "\ud800"), "lone surrogate"),
        (set_field("method.parameters", {"\udfff": 1}), "lone surrogate"),
        (set_field("method.paper", "a\x1b[31m"), "cannot be seen"),
        (set_field("method.trained_on", "a\u202eb"), "cannot be seen"),
        (set_field("method.name", "local\u200b:Local"), "cannot be seen"),
        (set_field("method.parameters", {"a\u2028": 1}), "cannot be seen"),
        (set_field("environment.gpu", "\x9b31m"), "cannot be seen"),
        (set_field("dataset.options", {"x": ["\x07"]}), "cannot be seen"),
        (set_field("submission.submitted", "9999-12-31T23:59:59Z"), "in the future"),
        (set_field("submission.submitted", "２０２６-01-01T00:00:00Z"), "submitted"),
    ],
)
def test_what_no_run_would_write_is_refused_though_it_is_sealed(
    tmp_path: Path, edit: Callable[[dict[str, Any]], None], told: str
) -> None:
    path = edited(tmp_path, edit)
    with pytest.raises(ResultError, match=told):
        load_submission(path, tmp_path)


def test_whole_numbers_are_scores_too(tmp_path: Path) -> None:
    def edit(content: dict[str, Any]) -> None:
        scores_as(lambda _: 1)(content)
        content["averages"]["thesis"]["ssim"] = 1

    load_submission(edited(tmp_path, edit), tmp_path)


def test_a_clock_may_be_a_day_ahead_and_no_more() -> None:
    submission = Submission(submitted="2026-01-02T03:04:05Z", seal="0" * 64)
    for days, problems in ((0, 0), (1, 0), (2, 1)):
        found = list(future_problems(submission, "a.json", WHEN - timedelta(days=days)))
        assert len(found) == problems


def test_text_that_cannot_be_shown_is_not_submitted(tmp_path: Path) -> None:
    with pytest.raises(ResultError, match="cannot be seen"):
        submit(make_demo_result(lambda pair: 0.1, "mine\u200b"), tmp_path, WHEN)
    assert not list(tmp_path.rglob("*.json"))


def test_methods_that_read_alike_have_files_of_their_own(tmp_path: Path) -> None:
    given: list[tuple[str, dict[str, Any]]] = [
        ("mine", {"w": 9}),
        ("mine", {"w": "9"}),
        ("mine (w=9)", {}),
        ("mine", {"w": "9, v=1"}),
        ("mine", {"w": 9, "v": 1}),
        ("mine", {"x": ".reproduced"}),
    ]
    paths = {write(tmp_path, name=name, parameters=parameters) for name, parameters in given}
    assert len(paths) == len(given)
    assert not any(path.name.endswith(".reproduced.json") for path in paths)
    for path in paths:
        load_submission(path, tmp_path)
