from pathlib import Path

import numpy as np
import pytest

from dfdbench.system.array_files import UNREADABLE, load_array


@pytest.mark.parametrize(
    "head",
    [
        "{'descr': '<f4', 'shape': (2,",
        "{'descr': '<f4', 'fortran_order': False, 'shape': (9,) * 9}",
    ],
)
def test_a_head_that_is_no_python_is_one_of_them(tmp_path: Path, head: str) -> None:
    path = tmp_path / "a.npy"
    np.save(path, np.zeros((2, 2), np.float32))
    content = path.read_bytes()
    path.write_bytes(content[:10] + head.encode().ljust(117) + b"\n" + content[128:])
    with pytest.raises(UNREADABLE):
        np.load(path, allow_pickle=False)


def test_an_archive_under_an_arrays_name_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.npy"
    with path.open("wb") as file:
        np.savez(file, depth=np.zeros((2, 2)))
    with pytest.raises(ValueError, match="an archive, and not an array"):
        load_array(path)
