from pathlib import Path

import pytest

from dfdbench.errors import InputError
from dfdbench.results.output_place import output_place


@pytest.fixture
def work(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    for file in ("set.zarr/zarr.json", "run/run.json", "photos/one.png", "alone.json"):
        (tmp_path / file).parent.mkdir(exist_ok=True)
        (tmp_path / file).write_text("{}")
    (tmp_path / "link").symlink_to("set.zarr")
    (tmp_path / "loop").symlink_to("loop")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_places_that_hold_something_are_refused_and_others_are_free(work: Path) -> None:
    before = sorted(work.rglob("*"))
    for place, why in (
        ("link/report", "a built data set"),
        ("photos/../run/figures", "a run"),
        ("alone.json", "one of its inputs"),
        ("s3://bucket/report", "on this machine only"),
        (" ", "no place is named"),
    ):
        with pytest.raises(InputError, match=why):
            output_place(place, "photos", None, Path("alone.json"))
        assert sorted(work.rglob("*")) == before
    for place in ("new", "photos-2/report.html", ".", "loop"):
        assert output_place(place, "photos", "alone.json") == Path(place)


def test_a_command_that_replaces_its_folder_may_name_it_but_not_one_inside(work: Path) -> None:
    assert output_place("run", replaces=True) == Path("run")
    assert output_place("set.zarr", replaces=True) == Path("set.zarr")
    with pytest.raises(InputError, match="a run"):
        output_place("run/new", replaces=True)
    with pytest.raises(InputError, match="one of its inputs"):
        output_place("photos", "photos/one.png", replaces=True)
