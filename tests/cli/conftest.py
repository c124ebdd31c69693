"""The command line as a fixture, for the tests of each family of verbs."""

import shutil
import sys
from pathlib import Path

import numpy as np
import pytest

from dfdbench.cli import main
from tests.cli.command import Command, Outcome
from tests.conftest import TINY_TOML, served_by, store_of, write_png
from tests.once import made_once
from tests.site import Site


@pytest.fixture
def dfdbench(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> Command:
    """Calls the command line in a folder of the test's own, where `mymodule` lies."""
    (tmp_path / "work").mkdir()
    shutil.copy(Path(__file__).with_name("mymodule.py"), tmp_path / "work")
    monkeypatch.chdir(tmp_path / "work")
    # Of the best and of the worst pairs one is drawn, which takes a third of the time.
    monkeypatch.setattr("dfdbench.figures.runs._PANELS", 1)

    def command(*arguments: str) -> Outcome:
        monkeypatch.setattr(sys, "argv", ["dfdbench", *arguments])
        status = 0
        try:
            main()
        except SystemExit as exit_:
            status = int(exit_.code or 0)
        captured = capsys.readouterr()
        return Outcome(status, captured.out, captured.err)

    return Command(command)


@pytest.fixture
def tiny_toml(tmp_path: Path) -> str:
    path = tmp_path / "tiny-1.toml"
    path.write_text(TINY_TOML)
    return str(path)


@pytest.fixture
def site(site: Site, dfdbench: Command) -> Site:
    """The server, with the manifest that names it in the folder of the command line."""
    Path("tiny-1.toml").write_text(served_by(site))
    return site


@pytest.fixture(scope="session")
def uneven_set(tiny_set: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    def make(folder: Path) -> None:
        site = Path(shutil.copytree(tiny_set / "site", folder / "site"))
        for number, scene in enumerate(("One", "Two", "Three")):
            for view in (1, 5):
                depth = np.full((24, 30 + number), 100, np.uint8)
                if scene == "Three":
                    depth[:4] = 36 + np.arange(32) % 3
                depth[-1] = 0
                write_png(site / scene / f"disp{view}.png", depth)
        store_of(TINY_TOML, site, folder / "uneven.zarr")

    return made_once(tmp_path_factory, "uneven", make) / "uneven.zarr"


@pytest.fixture
def uneven(uneven_set: Path, tmp_path: Path) -> str:
    """One trains with 100; Two and Three test with 100, and Three with some 36 to 38 besides."""
    return str(shutil.copytree(uneven_set, tmp_path / "uneven.zarr"))
