from __future__ import annotations

import pytest

from dfdbench.errors import InputError
from dfdbench.system.extras import needed


def test_an_absent_library_of_an_extra_names_it() -> None:
    with pytest.raises(InputError, match=r"dfdbench\[nets\]"), needed():
        raise ModuleNotFoundError("No module named 'torch'", name="torch")


def test_other_absent_modules_are_not_hidden() -> None:
    with pytest.raises(ModuleNotFoundError), needed():
        raise ModuleNotFoundError("No module named 'numpyy'", name="numpyy")
