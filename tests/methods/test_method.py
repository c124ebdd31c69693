import hashlib
from pathlib import Path

from dfdbench.methods.method import Method


def raising(*_: object) -> None:
    raise RuntimeError("boom")


def test_files_that_parameters_name_are_hashed(module: Path) -> None:
    folder = module.with_name("prior")
    (folder / "in").mkdir(parents=True)
    (folder / "in" / "a.txt").write_text("a")
    given = {"prior": "prior", "more": ["mine.py", {"deep": "mine.py"}], "window": 9, "word": "x"}

    def hashes() -> dict[str, str]:
        return Method("m", "m:m", raising, given).files_sha256

    first = hashes()
    assert set(first) == {"prior", "more.0", "more.1.deep"}
    digest = hashlib.sha256(module.read_bytes()).hexdigest()
    assert first["more.0"] == first["more.1.deep"] == digest
    (folder / "in" / "a.txt").rename(folder / "in" / "b.txt")
    renamed = hashes()
    (folder / "in" / "b.txt").write_text("b")
    assert len({first["prior"], renamed["prior"], hashes()["prior"]}) == 3
    assert hashes()["more.0"] == digest
