import errno
from pathlib import Path

import pytest

from dfdbench.errors import ResultError
from dfdbench.system.work_folder import writing_folder


def test_a_second_writer_is_told_and_the_first_goes_on(tmp_path: Path) -> None:
    folder = tmp_path / "deep" / "run"
    with writing_folder(folder, "search"):
        with (
            pytest.raises(ResultError, match="another search is writing this folder"),
            writing_folder(folder, "search"),
        ):
            pass
        folder.mkdir()
    with writing_folder(folder, "search"):
        pass
    assert [path.name for path in folder.parent.iterdir()] == ["run"]


def test_what_the_disk_does_not_take_is_told_with_what_to_do(tmp_path: Path) -> None:
    with (
        pytest.raises(ResultError, match=r"cannot write the run(.|\n)*goes on where it stopped"),
        writing_folder(tmp_path / "run", "run"),
    ):
        raise OSError(errno.ENOSPC, "No space left on device")
