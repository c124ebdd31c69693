"""The command line starts quickly: what only looks imports none of the heavy libraries."""

import pytest

from dfdbench.cli import Verb
from tests.process import python

HEAVY = ("scipy", "numba", "matplotlib", "xarray", "zarr", "dask", "torch", "skimage", "pandas")

PROGRAM = f"""
import os, sys
from dfdbench.cli import main
sys.argv = ["dfdbench", *sys.argv[1:]]
try:
    main()
except SystemExit as end:
    assert not end.code, end.code
heavy = [*{HEAVY!r}, *os.environ["TOO"].split()]
print("imported:", *(name for name in heavy if name in sys.modules))
"""


@pytest.mark.parametrize(
    ("line", "too"),
    [
        ("--version", "numpy pydantic rich"),
        ("--help", "numpy pydantic rich"),
        ("audit --help", "numpy pydantic rich"),
        ("build --help", ""),
        ("run --help", ""),
        ("list", "numpy"),
        ("info demo", "numpy"),
        ("info demo --pairs test", "numpy"),
    ],
)
def test_what_only_looks_imports_nothing_heavy(line: str, too: str) -> None:
    done = python("-c", PROGRAM, *line.split(), TOO=too)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1] == "imported:"


@pytest.mark.parametrize(
    ("verb", "told"),
    [("run", "stopped; the same command goes on from here\n"), ("report", "stopped\n")],
)
def test_ctrl_c_anywhere_in_a_verb_is_told(
    verb: str, told: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from dfdbench.cli import app

    def stopped(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(Verb, "load", stopped)
    with pytest.raises(SystemExit) as ended:
        app([verb], prog_name="dfdbench")
    assert (ended.value.code, capsys.readouterr().err) == (130, told)


@pytest.mark.parametrize(("verb", "near"), [("bild", ". Did you mean build?"), ("no-such", "")])
def test_an_unknown_verb_is_told_with_the_near_one(
    verb: str, near: str, capsys: pytest.CaptureFixture[str]
) -> None:
    from dfdbench.cli import app

    with pytest.raises(SystemExit) as ended:
        app([verb, "demo"], prog_name="dfdbench")
    assert ended.value.code == 2
    assert f"No such command '{verb}'{near}" in capsys.readouterr().err
