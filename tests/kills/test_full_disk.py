"""A disk that is full at any write of a build or a run: said, and gone on with where there is room.

The disk is a small tmpfs, which only root may make: elsewhere these tests are skipped.
"""

import shutil
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from dfdbench.datasets.dataset import Dataset
from dfdbench.results.record import load_result
from tests.fuzz.bench import Bench
from tests.fuzz.worker import call

#: Sizes of the disk, from none to almost enough, at which the work is begun.
SIZES = 12
_PAGE = 4096


def _told(*command: str) -> None:
    subprocess.run(command, capture_output=True, check=True)


def _mount(place: Path, size: int) -> None:
    _told("mount", "-t", "tmpfs", "-o", f"size={max(size, _PAGE)}", "tmpfs", str(place))


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[Path]:
    place = tmp_path / "disk"
    place.mkdir()
    try:
        _mount(place, 2**26)
    except (OSError, subprocess.CalledProcessError) as error:
        pytest.skip(f"no file system of one's own can be mounted here: {error}")
    yield place
    _told("umount", str(place))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    bench = Bench(tmp_path / "bench", call)
    return bench.laid_out(tmp_path / "work", ("tiny-1.toml", "site", "tiny.zarr"))


def _fingerprint(place: Path) -> object:
    return Dataset(place).fingerprint


def _scores(place: Path) -> object:
    return [(pair.prediction_sha256, pair.scores) for pair in load_result(place).pairs]


WORK: dict[str, Callable[[Path], object]] = {
    "build tiny-1.toml --source site --workers 1 --store PLACE": _fingerprint,
    "run --method constant --dataset tiny.zarr --no-predictions --out PLACE": _scores,
}


@pytest.mark.slow
@pytest.mark.parametrize("command", WORK)
def test_a_disk_full_at_any_write_is_told_and_gone_on_with(
    command: str, disk: Path, folder: Path
) -> None:
    place, outcome = disk / "made.zarr", WORK[command]
    words = command.replace("PLACE", str(place)).split()
    assert call(folder, words)[0] == 0
    expected, needed = outcome(place), shutil.disk_usage(disk).used
    refused = 0
    for part in range(SIZES):
        _told("umount", str(disk))
        _mount(disk, needed * part // SIZES)
        status, text = call(folder, words)
        if status:
            refused += 1
            assert status == 2, text
            assert "No space left on device" in text
            assert "Traceback" not in text
        # Room is made, as by somebody who was told that there is none.
        _told("mount", "-o", "remount,size=64m", str(disk))
        status, text = call(folder, words)
        assert status == 0, text
        assert outcome(place) == expected
    assert refused >= SIZES // 2
