"""Methods made for the tests of what calls them."""

from typing import Any

import numpy as np

from dfdbench.methods.method import Method


class Counting:
    """Answers with the red channel; may fail on chosen calls."""

    def __init__(self, fail_at: int | None = None, stop_at: int | None = None) -> None:
        self.calls = 0
        self.warmed = 0
        self.fail_at, self.stop_at = fail_at, stop_at

    def warm_up(self, infocus: Any, defocus: Any) -> None:
        self.warmed += 1

    def __call__(self, infocus: Any, defocus: Any) -> Any:
        self.calls += 1
        if self.calls == self.stop_at:
            raise KeyboardInterrupt
        if self.calls == self.fail_at:
            raise RuntimeError("out of memory")
        return infocus[..., 0].astype(np.float32) / 2


def method(predict: Any, source: str = "0" * 64) -> Method:
    return Method("counting", "tests:Counting", predict, {}, (), source)


def grey(infocus: Any, defocus: Any) -> Any:
    return infocus[..., 0]
