import os
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dfdbench.methods.calling import call

IMAGE = np.zeros((4, 6, 3), np.uint8)


def test_a_method_cannot_spoil_the_process(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def spoiling(infocus: Any, defocus: Any) -> Any:
        os.chdir(tmp_path)
        os.environ["MINE"] = "1"
        os.environ["KEPT"] = "changed"
        del os.environ["GONE"]
        np.set_printoptions(precision=1)
        np.seterr(all="raise")
        warnings.simplefilter("error")
        if infocus.max():
            raise RuntimeError("boom")
        return infocus[..., 0]

    monkeypatch.setenv("KEPT", "as it was")
    monkeypatch.setenv("GONE", "not gone")

    def state() -> tuple[Any, ...]:
        filters = list(warnings.filters)
        return Path.cwd(), dict(os.environ), np.get_printoptions(), np.geterr(), filters

    before = state()
    for image in (IMAGE, IMAGE + np.uint8(1)):
        call(spoiling, image, image)
        assert state() == before
