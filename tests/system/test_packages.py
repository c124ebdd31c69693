import tomllib
from pathlib import Path

import pytest

import dfdbench
from dfdbench.errors import InputError
from dfdbench.system.packages import PACKAGE_VERSION, needed

ROOT = Path(__file__).parents[2]


def test_the_version_is_that_of_the_project_and_of_the_face() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    assert dfdbench.__version__ == PACKAGE_VERSION == project["version"]


def test_an_absent_library_of_an_extra_names_it_and_other_modules_are_not_hidden() -> None:
    with pytest.raises(InputError, match=r"dfdbench\[nets\]"), needed():
        raise ModuleNotFoundError("No module named 'torch'", name="torch")
    with pytest.raises(ModuleNotFoundError), needed():
        raise ModuleNotFoundError("No module named 'numpyy'", name="numpyy")
