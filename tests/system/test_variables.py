import os
import subprocess
import sys

import pytest

from dfdbench.errors import InputError
from dfdbench.system.variables import require_sound_start


@pytest.mark.parametrize("text", ["0", "-1", "abc", "1.5", "1" * 9, "1,", "\x1b[2J"])
def test_what_is_no_number_of_threads_is_told_by_the_variable(text: str) -> None:
    names = ["NUMBA_NUM_THREADS", "OMP_NUM_THREADS"]
    with pytest.raises(InputError, match="not a number of threads") as said:
        require_sound_start(dict.fromkeys(names, text))
    assert [problem.where for problem in said.value.problems] == names


@pytest.mark.parametrize("text", ["abc", "-1", "1e9", "1.5"])
def test_a_date_that_is_none_is_told(text: str) -> None:
    with pytest.raises(InputError, match="SOURCE_DATE_EPOCH"):
        require_sound_start({"SOURCE_DATE_EPOCH": text})


def test_numbers_and_what_is_not_set_are_fine() -> None:
    require_sound_start({"OMP_NUM_THREADS": "4,2", "NUMBA_NUM_THREADS": "16"})
    require_sound_start({"OMP_NUM_THREADS": "", "PATH": "abc", "SOURCE_DATE_EPOCH": "1700000000"})


def test_python_without_assertions_is_refused_and_not_a_traceback() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "dfdbench", "list"],
        env={**os.environ, "PYTHONOPTIMIZE": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2
    assert "unset PYTHONOPTIMIZE" in done.stderr
    assert "Traceback" not in done.stderr
