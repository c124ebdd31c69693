from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from dfdbench.building.fetching import checksums
from dfdbench.datasets.manifest import Manifest
from dfdbench.errors import SourceError


def test_a_lock_file_is_read_back_and_sha256sum_reads_it(tmp_path: Path) -> None:
    names = {"Art/disp1.png": b"one", "Art/Illum1/Exp0/view1.png": b"two"}
    for name, content in names.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_bytes(content)
    known = {name: checksums.sha256(content) for name, content in names.items()}
    checksums.write_checksums(tmp_path / "a.lock", known)
    assert checksums.parse_checksums((tmp_path / "a.lock").read_text(), "a.lock") == known
    check = ["sha256sum", "--check", "--strict", "a.lock"]
    assert subprocess.run(check, cwd=tmp_path, capture_output=True, check=False).returncode == 0


def test_every_bad_line_is_named() -> None:
    text = "0" * 64 + "  good\nbad\n" + "0" * 63 + "  short\n"
    with pytest.raises(SourceError) as caught:
        checksums.parse_checksums(text, "a.lock")
    assert [problem.where for problem in caught.value.problems] == [
        "a.lock, line 2",
        "a.lock, line 3",
    ]


def test_the_manifest_counts_more_than_a_lock_file(tiny_manifest: Manifest, tmp_path: Path) -> None:
    manifest = tiny_manifest.model_copy(update={"checksums": {"a": "1" * 64}})
    checksums.write_checksums(
        tmp_path / checksums.lock_name(manifest), {"a": "2" * 64, "b": "3" * 64}
    )
    assert checksums.known_checksums(manifest, tmp_path) == {"a": "1" * 64, "b": "3" * 64}
    assert checksums.known_checksums(manifest) == {"a": "1" * 64}


def test_another_file_is_refused_and_an_unknown_one_passes() -> None:
    known = {"a": checksums.sha256(b"one")}
    checksums.check_checksum("a", b"one", known, "here")
    checksums.check_checksum("b", b"anything", known, "here")
    with pytest.raises(SourceError, match="not the file of this data set") as caught:
        checksums.check_checksum("a", b"two", known, "here/a")
    assert checksums.sha256(b"one") in str(caught.value)
    assert checksums.sha256(b"two") in str(caught.value)


def test_a_lock_file_that_is_no_text_is_told(tiny_manifest: Manifest, tmp_path: Path) -> None:
    (tmp_path / "tiny-1.lock").write_bytes(b"0" * 64 + b"  One/\xed\xa0.png\n")
    with pytest.raises(SourceError, match="cannot read the lock file"):
        checksums.known_checksums(tiny_manifest, tmp_path)
