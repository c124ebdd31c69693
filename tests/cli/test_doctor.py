import json
from pathlib import Path

import pytest

import dfdbench as package
from dfdbench.system.extras import EXTRAS
from tests.cli.command import Command


def test_it_tells_versions_extras_and_what_lies_in_the_cache(
    dfdbench: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("NUMBA_NUM_THREADS", "1")
    (tmp_path / "stores" / "mine-1.zarr").mkdir(parents=True)
    (tmp_path / "stores/mine-1.zarr/chunk").write_bytes(bytes(2_500_000))
    found = dfdbench("doctor", "--format", "json", "--cache", str(tmp_path))
    assert found.status == 0, found.err
    told = {row["what"]: row["found"] for row in json.loads(found.out)[0]["rows"]}
    assert told["dfdbench"].startswith(package.__version__)
    assert told["built"] == "mine-1"
    assert told["cache"].startswith(f"{tmp_path}: 2.5 MB, ")
    assert "torch" in told["extra nets"]
    assert told["trains on cpu in"].split(":")[0] in ("float32", "bf16")
    assert told["NUMBA_NUM_THREADS"] == "1"
    assert Path(told["compiled code"]).is_dir()


def test_a_cache_that_is_not_there_yet_is_none_the_worse(dfdbench: Command, tmp_path: Path) -> None:
    found = dfdbench("doctor", "--cache", str(tmp_path / "a" / "b"))
    assert (found.status, "nothing" in found.out) == (0, True)
    assert not (tmp_path / "a").exists()


def test_an_extra_that_is_absent_says_how_to_have_it(
    dfdbench: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(EXTRAS, "none", ("there_is_no_such_module",))
    assert "absent: pip install 'dfdbench[none]'" in dfdbench("doctor").out
