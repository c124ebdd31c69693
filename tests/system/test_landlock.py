import json
import subprocess
import sys
from pathlib import Path

import pytest

from dfdbench.system.landlock import without

TRY = """
import json, os, sys
from dfdbench.system.landlock import read_only_from
read, listed, tried = json.loads(sys.argv[1])
hidden = read_only_from(read, listed)
def can(place):
    try:
        return bool(os.listdir(place) if os.path.isdir(place) else open(place).read())
    except PermissionError:
        return False
print(json.dumps([hidden, *map(can, tried)]))
"""


def tree(folder: Path) -> Path:
    for name in ("shown/deep/a", "shown/b", "secret/truth", "beside"):
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(name)
    return folder


def test_a_folder_that_holds_what_is_hidden_is_taken_apart(tmp_path: Path) -> None:
    folder = tree(tmp_path)
    (folder / "link").symlink_to(folder / "secret")
    read, listed = without([folder], [folder / "secret/truth", Path("/elsewhere")])
    assert read == [str(folder / "beside"), str(folder / "shown")]
    assert listed == [str(folder), str(folder / "secret")]
    assert without([folder / "secret/truth", folder / "secret"], [folder / "secret"]) == ([], [])
    assert without([folder / "link"], [folder / "secret"]) == ([], [])
    assert without([folder / "shown", folder / "no"], []) == (
        [str(folder / "shown"), str(folder / "no")],
        [],
    )


@pytest.mark.skipif(sys.platform != "linux", reason="Landlock is Linux's")
def test_what_is_not_named_cannot_be_read_any_more(tmp_path: Path) -> None:
    folder = tree(tmp_path)
    (folder / "shown/way").symlink_to(folder / "secret/truth")
    names = ("shown/b", "shown/deep/a", "beside", "secret", "secret/truth", "shown/way")
    tried = [str(folder / name) for name in names]
    given = json.dumps([[str(folder / "shown"), "/no/such"], [str(folder / "secret")], tried])
    python = [sys.executable, "-c", TRY, given]
    done = subprocess.run(python, capture_output=True, text=True, check=True)
    hidden, *can = json.loads(done.stdout)
    if not hidden:
        pytest.skip("this system has no Landlock")
    assert dict(zip(names, can, strict=True)) == {
        "shown/b": True,
        "shown/deep/a": True,
        "beside": False,
        "secret": True,
        "secret/truth": False,
        "shown/way": False,
    }
