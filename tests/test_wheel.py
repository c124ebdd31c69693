"""The wheel, as somebody installs it who has no checkout."""

import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from dfdbench import __version__

ROOT = Path(__file__).parents[1]
#: Where a file of the checkout lies in the wheel, by how its path begins.
PACKAGES = {
    "dfdbench/": "dfdbench/",
    "manifests/": "dfdbench/manifests/",
    "leaderboard/": "dfdbench/rows/",
}
BUILT_FROM = ("pyproject.toml", "setup.py", "MANIFEST.in", "README.md", "LICENSE")


def sources() -> list[str]:
    """The files that git knows and that are there; outside a checkout, all that are no leavings."""
    listed = subprocess.run(
        ["git", "ls-files", "--", *PACKAGES], cwd=ROOT, capture_output=True, text=True, check=False
    )
    if listed.returncode == 0 and listed.stdout:
        return [name for name in listed.stdout.splitlines() if (ROOT / name).is_file()]
    found = (path for folder in PACKAGES for path in (ROOT / folder).rglob("*") if path.is_file())
    return [path.relative_to(ROOT).as_posix() for path in found if path.suffix != ".pyc"]


def python(*arguments: str | Path, cwd: Path) -> str:
    """Run Python's or the command's words outside the checkout; return what they print."""
    environment = {k: v for k, v in os.environ.items() if not k.startswith(("PYTHONPATH", "GIT_"))}
    done = subprocess.run(arguments, cwd=cwd, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def clean_tree(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the sources alone: what an earlier build left in the checkout must not help."""
    reason = "no setuptools of version 77 or newer to build with: install dfdbench[test]"
    pytest.importorskip("setuptools", minversion="77", reason=reason)
    tree = tmp_path_factory.mktemp("tree")
    for name in (*BUILT_FROM, *sources()):
        target = tree / name
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, target)
    return tree


@pytest.fixture(scope="module")
def wheel(clean_tree: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("wheel")
    words = ("--no-deps", "--no-index", "--no-build-isolation", "--disable-pip-version-check")
    python(sys.executable, "-m", "pip", "wheel", *words, "-w", folder, clean_tree, cwd=clean_tree)
    (wheel,) = folder.glob("*.whl")
    return wheel


@pytest.fixture(scope="module")
def elsewhere(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A virtual environment with the wheel, and with our third-party packages in reach."""
    folder = tmp_path_factory.mktemp("elsewhere") / "venv"
    python(sys.executable, "-m", "venv", "--without-pip", folder, cwd=wheel.parent)
    (own,) = folder.glob("lib/python*/site-packages")
    # Python runs no .pth file of a folder that a .pth file names: our editable install stays away.
    packages = [path for path in sys.path if path.endswith(("site-packages", "dist-packages"))]
    (own / "third_party.pth").write_text("\n".join(packages), encoding="utf-8")
    pip = (sys.executable, "-m", "pip", "--python", folder / "bin" / "python", "install")
    words = ("--no-deps", "--no-index", "--disable-pip-version-check")
    python(*pip, *words, wheel, cwd=wheel.parent)
    return folder


@pytest.mark.slow
def test_the_wheel_holds_every_file_and_no_other(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        held = {name for name in archive.namelist() if ".dist-info/" not in name}
    assert {"dfdbench/py.typed", "dfdbench/manifests/demo-1.toml"} <= held
    assert held == {
        inside + name.removeprefix(folder)
        for name in sources()
        for folder, inside in PACKAGES.items()
        if name.startswith(folder)
    }


@pytest.mark.slow
def test_the_installed_wheel_works_without_the_checkout(elsewhere: Path, tmp_path: Path) -> None:
    shutil.copytree(ROOT / "leaderboard", tmp_path / "board")
    where = "import dfdbench, dfdbench.manifests as m; print(dfdbench.__file__, m.__file__)"
    imported = python(elsewhere / "bin" / "python", "-c", where, cwd=tmp_path).split()
    assert all(Path(file).is_relative_to(elsewhere) for file in imported)

    def dfdbench(*words: str) -> str:
        return python(elsewhere / "bin" / "dfdbench", *words, cwd=tmp_path)

    assert dfdbench("--version").split() == ["dfdbench", __version__]
    assert "realworld-synthetic" in dfdbench("list")
    assert "162" in dfdbench("info", "demo")
    assert "162 pairs" in dfdbench("build", "demo")
    assert "NRMSE" in dfdbench("run", "--method", "constant", "--dataset", "demo")
    assert (tmp_path / "results/demo-1-test/constant/result.json").is_file()
    assert "README up to date" in dfdbench("leaderboard", "--folder", "board", "--check")


@pytest.mark.parametrize(("extras", "asked"), [("", "."), ("nets", ".[nets]")])
def test_the_container_names_no_empty_extra(extras: str, asked: str) -> None:
    """`pip install '.[]'` is refused."""
    (line,) = (row for row in (ROOT / "Dockerfile").open(encoding="utf-8") if "pip install" in row)
    words = f"echo {line.split()[-2]}"
    done = subprocess.run(["sh", "-c", words], env={"EXTRAS": extras}, capture_output=True)
    assert done.stdout.decode().strip() == asked
