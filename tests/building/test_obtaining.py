from pathlib import Path

import pytest

from dfdbench.building import obtaining
from dfdbench.datasets.catalog import find_manifest
from dfdbench.errors import InputError

MIDDLEBURY, REALWORLD = find_manifest("middlebury"), find_manifest("realworld")


@pytest.mark.parametrize("mirror", ["/data/middlebury", "ftp://mirror.example", "https:///folder"])
def test_a_mirror_is_an_address(tmp_path: Path, mirror: str) -> None:
    with pytest.raises(InputError, match=f"not an address.*{mirror}"):
        obtaining.obtain(MIDDLEBURY, mirrors=["https://right.example", mirror], cache=tmp_path)


@pytest.mark.parametrize("pair", ["135", "a-b", "-135-129", "135-129-141"])
def test_what_is_no_pair_of_steps_is_told(tmp_path: Path, pair: str) -> None:
    with pytest.raises(InputError, match=rf"not a pair of voltage steps.*, got {pair}$"):
        obtaining.voltage_pair_sets(REALWORLD, ["135-129", pair], None, tmp_path)
