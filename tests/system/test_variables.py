import pytest

from dfdbench.errors import InputError
from dfdbench.system.variables import require_thread_counts


@pytest.mark.parametrize("text", ["0", "-1", "abc", "1.5", "1" * 9, "1,", "\x1b[2J"])
def test_what_is_no_number_of_threads_is_told_by_the_variable(text: str) -> None:
    names = ["NUMBA_NUM_THREADS", "OMP_NUM_THREADS"]
    with pytest.raises(InputError, match="wrong environment variable") as told:
        require_thread_counts(dict.fromkeys(names, text))
    assert [problem.where for problem in told.value.problems] == names


def test_numbers_and_what_is_not_set_are_fine() -> None:
    require_thread_counts({"OMP_NUM_THREADS": "4,2", "NUMBA_NUM_THREADS": "16"})
    require_thread_counts({"OMP_NUM_THREADS": "", "PATH": "abc"})
