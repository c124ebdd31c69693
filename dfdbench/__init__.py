"""Dataset builder and benchmark suite for depth from defocus."""

from __future__ import annotations

from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from dfdbench.datasets.pair_sequence import PairSequence
    from dfdbench.system.location import Place

__all__ = ["__version__", "open"]

__version__ = version("dfdbench")


def open(
    name: str, split: str = "all", store: Place | None = None, cache: Path | None = None
) -> PairSequence:
    """Open a built data set's pairs; each is read when it is asked for.

    See `dfdbench.datasets.pair_sequence.open_pairs`, which this is.
    """
    # Imported here, so that `import dfdbench` stays quick.
    from dfdbench.datasets.pair_sequence import open_pairs

    return open_pairs(name, split, store, cache)
