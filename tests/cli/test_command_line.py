import sys
from pathlib import Path

import pytest

from tests.cli.command import Command
from tests.conftest import TINY_TOML
from tests.process import shell


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ("info midlebury", "did you mean middlebury"),
        ("info middlebury --pairs tst", "did you mean test"),
        ("info ./", "not a data set built by dfdbench"),
        ("build realworld@camera-1", "has no tracks"),
        ("build demo@law-1 --recipe text", "leave out --recipe"),
        ("build middlebury --offline", "--source DIR"),
        ("build realworld", "dfdbench build realworld --source DIR"),
        ("build demo --offline", "not fetched here"),
        ("build demo --store nosuch://x/y.zarr", "cannot reach places"),
        ("build demo --store memory://x/y.zarr", "in memory"),
        ("build demo --scheduler nonsense://x", "not a scheduler's address"),
        ("build tiny-1.toml --source . --mirror http://x", "--mirror"),
        ("build tiny-1.toml --mirror http://x --offline", "asks nobody"),
        ("build tiny-1.toml --cache tiny-1.toml", "cannot keep the download"),
        ("run --method constant --dataset demo@law-1", "dfdbench build demo@law-1"),
        ("run --method mymodule:predict", "dfdbench build demo"),
        ("run --method local --protocol thesys", "did you mean thesis"),
        ("check-method nosuch:thing", "no module named nosuch"),
        ("check-method local --param window=4", "odd"),
        ("verify nothing.zarr", "no such store"),
        ("cache --cache tiny-1.toml", "no folder"),
    ],
)
def test_a_mistake_ends_with_a_message_and_status_2(
    dfdbench: Command, words: str, told: str
) -> None:
    Path("tiny-1.toml").write_text(TINY_TOML)
    assert dfdbench.refused(told, words).err.startswith("error: ")


def test_a_closed_pipe_is_no_mistake() -> None:
    outcome = shell(f"{sys.executable} -m dfdbench info middlebury --pairs all | head -1")
    assert (outcome.stdout, outcome.stderr) == ("Art/view1/illumination1/exposure0\n", "")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
def test_a_full_disk_is_told() -> None:
    outcome = shell(f"{sys.executable} -m dfdbench list > /dev/full")
    assert outcome.returncode == 2
    assert outcome.stderr.startswith("error: No space left on device")
    assert "Traceback" not in outcome.stderr


@pytest.mark.parametrize("verb", ["list --cache", "info", "report"])
def test_a_name_too_long_for_the_file_system_is_told(dfdbench: Command, verb: str) -> None:
    dfdbench.refused("too long", verb, "x" * 300 + ".toml")
