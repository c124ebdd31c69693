from pathlib import Path

import numpy as np
import pytest

from dfdbench.system.array_files import load_array


def test_an_archive_under_an_arrays_name_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.npy"
    with path.open("wb") as file:
        np.savez(file, depth=np.zeros((2, 2)))
    with pytest.raises(ValueError, match="an archive, and not an array"):
        load_array(path)
