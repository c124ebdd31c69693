from pathlib import Path

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from dfdbench.errors import ResultError
from dfdbench.leaderboard.folder import (
    FINGERPRINTS,
    MARKER,
    PUBLISHED,
    README,
    REPRODUCED,
    RESULTS,
    UNDEFINED,
    file_stems,
    known_fingerprints,
    known_undefined,
    place_of,
    require_leaderboard,
    result_files,
)
from tests.made_results import make_result


@pytest.mark.parametrize("name", [RESULTS, PUBLISHED])
def test_results_or_printed_tables_make_a_leaderboard(tmp_path: Path, name: str) -> None:
    with pytest.raises(ResultError, match="no leaderboard here"):
        require_leaderboard(tmp_path)
    (tmp_path / name).mkdir()
    require_leaderboard(tmp_path)
    (tmp_path / README).write_text(f"# Ours\n{MARKER}\n")
    require_leaderboard(tmp_path)
    (tmp_path / README).write_bytes(b"# Somebody's \xff")
    with pytest.raises(ResultError, match="left as it is"):
        require_leaderboard(tmp_path)


@pytest.mark.parametrize("name", [RESULTS, PUBLISHED])
def test_no_folder_of_a_leaderboard_is_a_link_to_elsewhere(tmp_path: Path, name: str) -> None:
    elsewhere, folder = tmp_path / "elsewhere", tmp_path / "leaderboard"
    (elsewhere / "demo-1-test").mkdir(parents=True)
    folder.mkdir()
    (folder / name).symlink_to(elsewhere)
    with pytest.raises(ResultError, match="no link"):
        require_leaderboard(folder)


def test_what_lies_behind_a_link_does_not_go_unseen(tmp_path: Path) -> None:
    elsewhere, results = tmp_path / "elsewhere", tmp_path / "leaderboard" / RESULTS
    elsewhere.mkdir()
    (elsewhere / "local.json").write_text("{}")
    (results / "demo-1-test").mkdir(parents=True)
    (results / "demo-1-test" / "valid").symlink_to(elsewhere)
    paths, (problem,) = result_files(results.parent)
    assert not paths
    assert problem.where.endswith("demo-1-test/valid")


def test_results_lie_by_data_set_split_and_protocol(tmp_path: Path) -> None:
    dataset = make_result({("a", 1, 1, 0): 0.1}).dataset
    assert place_of(dataset, "valid", tmp_path) == tmp_path / "results/tiny-1-test/valid"


@example(label="m (x=.reproduced)", fingerprint="")
@given(label=st.text(max_size=120), fingerprint=st.text("0123456789abcdef", max_size=64))
@settings(max_examples=50)
def test_a_file_name_holds_what_every_file_system_does(label: str, fingerprint: str) -> None:
    for stem in file_stems(label, fingerprint):
        assert 0 < len(stem) <= 89
        assert stem.isascii()
        assert stem == Path(stem).name
        assert not stem.startswith(".")
        assert not stem.endswith(REPRODUCED)


def test_names_that_make_one_file_name_are_told_apart() -> None:
    (plain, first), (other, second) = (file_stems(label, "0" * 64) for label in ("net/a", "net?a"))
    assert plain == other == "net_a"
    assert first != second
    # The same method on other data too.
    assert file_stems("net/a", "1" * 64)[1] != first


def test_what_must_be_so_is_read_and_nothing_where_nothing_is_said(tmp_path: Path) -> None:
    assert known_fingerprints(tmp_path) == {}
    assert known_undefined(tmp_path, "f", "thesis") == {}
    (tmp_path / FINGERPRINTS).write_text('{"demo-1": ["f"]}')
    (tmp_path / UNDEFINED).write_text('{"f": {"thesis": {"k35/exposure_ms10": ["nrmse"]}}}')
    assert known_fingerprints(tmp_path) == {"demo-1": ["f"]}
    assert known_undefined(tmp_path, "f", "thesis") == {"k35/exposure_ms10": {"nrmse"}}
    assert known_undefined(tmp_path, "f", "valid") == known_undefined(tmp_path, "g", "thesis") == {}


@pytest.mark.parametrize("content", ["", "[]", '{"demo-1": "f"}', '{"demo-1": [1]}'])
def test_a_list_that_cannot_be_read_is_told(tmp_path: Path, content: str) -> None:
    (tmp_path / FINGERPRINTS).write_text(content)
    with pytest.raises(ResultError, match="cannot read the list") as caught:
        known_fingerprints(tmp_path)
    assert caught.value.problems[0].where.startswith(str(tmp_path / FINGERPRINTS))
    assert "pydantic" not in str(caught.value)
