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


#: The first release of each that works, and what is wrong with older ones.
FIRST = {
    "fsspec": "2024.12",  # no asynchronous access to memory://
    "imagehash": "4.3.1",  # imports six without asking for it
    "matplotlib": "3.10",  # no `orientation` of box plots
    "opencv-python-headless": "5.0",  # an aligned stack gets other shifts and another fingerprint
    "pandas": "3.0",  # `stack` loses the columns' name; 2 beside None becomes 2.0
    "rich": "14.3",  # progress prints an empty line where there is no terminal
    "typer": "0.26",  # refuses Literal; the help does not say what an argument is
    "xarray": "2026.9",  # writes bool as int8 into zarr, which no run reads
    "zarr": "3.1.6",  # a store that wraps another cannot be opened read-only
}


def test_no_library_may_be_older_than_the_first_that_works() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    lowest = dict(words.split(">=") for words in project["dependencies"])
    assert {name: lowest[name] for name in FIRST} == FIRST


def test_an_absent_library_of_an_extra_names_it_and_other_modules_are_not_hidden() -> None:
    with pytest.raises(InputError, match=r"dfdbench\[nets\]"), needed():
        raise ModuleNotFoundError("No module named 'torch'", name="torch")
    with pytest.raises(ModuleNotFoundError), needed():
        raise ModuleNotFoundError("No module named 'numpyy'", name="numpyy")
