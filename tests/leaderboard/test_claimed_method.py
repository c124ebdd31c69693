import sys
from pathlib import Path
from typing import Any

import pytest

from dfdbench.errors import DfdbenchError, ResultError
from dfdbench.leaderboard.claimed_method import claimed_method, parameters_to_run
from dfdbench.results.record import MethodRecord

RESULT = Path("result.json")
MODULE = """
from pathlib import Path
from subprocess import Popen
from .inner import Network
Path("imported").touch()
class Method: pass
method = Method()
if True:
    def late(infocus, defocus): pass
"""


def record(entry: str, name: str | None = None, **changes: Any) -> MethodRecord:
    blank = MethodRecord(
        name=name or entry,
        entry=entry,
        source_sha256=None,
        parameters={},
        uses=[],
        trained_on=None,
        paper=None,
    )
    return blank.model_copy(update=changes)


@pytest.fixture
def theirs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    # A package of somebody else's; whatever of it is imported leaves a file.
    package = tmp_path / "theirs/deep"
    package.mkdir(parents=True)
    for path in (package.parent / "__init__.py", package / "__init__.py", package / "method.py"):
        path.write_text(MODULE)
    (tmp_path / "bare").mkdir()
    (tmp_path / "bare/method.py").write_text(MODULE)
    (tmp_path / "json").mkdir()
    (tmp_path / "json/__init__.py").write_text(MODULE)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize(
    ("entry", "file"),
    [
        ("theirs.deep.method:Method", "theirs/deep/method.py"),
        ("theirs.deep:method", "theirs/deep/__init__.py"),
        ("theirs:Network", "theirs/__init__.py"),
        ("theirs:late", "theirs/__init__.py"),
        ("bare/method.py:method", "bare/method.py"),
        ("bare.method:method", "bare/method.py"),
    ],
)
def test_a_file_is_found_without_importing_it_or_its_parents(
    theirs: Path, entry: str, file: str
) -> None:
    before = list(sys.path)
    claim = claimed_method(record(entry), RESULT)
    assert claim.file == (theirs / file).resolve()
    assert "ANOTHER FILE" in str(claim)
    same = record(entry, source_sha256=claim.file_sha256)
    assert "the same" in str(claimed_method(same, RESULT))
    assert not (theirs / "imported").exists()
    assert "theirs" not in sys.modules
    assert sys.path == before


@pytest.mark.parametrize(
    "entry",
    [
        "subprocess:Popen",
        "os:system",
        "builtins:eval",
        "json:Method",
        "__main__:x",
        "posix:system",
        "numpy._core._multiarray_umath:array",
        "dfdbench.building.export:export_png",
        "theirs:Popen",
        "theirs:Path",
        "theirs:absent",
        "theirs:subprocess.Popen",
        "theirs:_hidden",
        "theirs:__class__",
        "theirs.absent:Method",
        "absent:Method",
        "absent.py:predict",
        "/etc/passwd.py:predict",
        "theirs:",
        ":predict",
        "theirs",
        "..theirs:Method",
        "theirs deep:Method",
    ],
)
def test_what_is_no_method_is_refused(theirs: Path, entry: str) -> None:
    with pytest.raises(DfdbenchError):
        claimed_method(record(entry), RESULT)
    with pytest.raises(ResultError):
        claimed_method(record(entry, "x.py:y"), RESULT)
    assert not (theirs / "imported").exists()


def test_a_built_in_method_needs_no_consent() -> None:
    claim = claimed_method(record("dfdbench.methods.baselines:Local", "local"), RESULT)
    assert claim.file is None
    claim.require_consent((), RESULT)
    with pytest.raises(DfdbenchError, match="unknown method"):
        claimed_method(record("theirs:Method", "theirs"), RESULT)


def test_what_is_shown_steers_no_terminal(theirs: Path) -> None:
    claim = claimed_method(record("theirs:Method", parameters={"a": "\x1b[2J\u202e"}), RESULT)
    assert str(claim).replace("\n", "").isprintable()
    assert str(claim).isascii()


def test_weights_are_shipped_or_the_reviewers(tmp_path: Path) -> None:
    entry = "dfdbench.methods.learned:UNetMethod"
    shipped = record(entry, "u-net", parameters={"weights": "demo"})
    assert parameters_to_run(shipped, None, RESULT) == {"weights": "demo"}
    for weights in ("mine.safetensors", ["demo"], "../demo", 3):
        own = record(entry, "u-net", parameters={"weights": weights})
        with pytest.raises(ResultError, match="must not choose"):
            parameters_to_run(own, None, RESULT)
    (tmp_path / "mine.safetensors").write_bytes(b"")
    empty = "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855"
    own = own.model_copy(update={"weights_sha256": empty})
    given = parameters_to_run(own, tmp_path / "mine.safetensors", RESULT)
    assert given == {"weights": str(tmp_path / "mine.safetensors")}
