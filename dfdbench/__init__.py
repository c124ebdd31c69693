"""Dataset builder and benchmark suite for depth from defocus."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    from dfdbench.datasets.pair_images import PairImages
    from dfdbench.datasets.pair_sequence import PairSequence
    from dfdbench.datasets.store import Store
    from dfdbench.results.saved_run import SavedRun
    from dfdbench.system.location import Place

__all__ = ["__version__", "evaluate", "open", "open_run", "show"]

if TYPE_CHECKING:
    __version__: str

# What these need is imported inside them, so that `import dfdbench` stays quick: the command line
# starts with it, and only after it can Ctrl-C be told without a traceback.


def __getattr__(name: str) -> str:
    if name != "__version__":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from dfdbench.system.version import PACKAGE_VERSION

    return PACKAGE_VERSION


def open(
    name: str, split: str = "all", store: Place | None = None, cache: Path | None = None
) -> PairSequence:
    """Open a built data set's pairs; each is read when it is asked for.

    See `dfdbench.datasets.pair_sequence.open_pairs`, which this is.
    """
    from dfdbench.datasets.pair_sequence import open_pairs

    return open_pairs(name, split, store, cache)


def evaluate(
    predict: str | Callable[..., Any], dataset: str | Store, split: str = "test", **options: Any
) -> SavedRun:
    """Run a method on a split of a built data set, as ``dfdbench run`` does.

    See `dfdbench.evaluation.evaluate.evaluate`, which this is, for what it takes and gives.
    """
    from dfdbench.evaluation.evaluate import evaluate as run

    return run(predict, dataset, split, **options)


def open_run(path: Path | str, dataset: str | None = None) -> SavedRun:
    """Open what ``dfdbench run`` left: its result, its pairs' images and depth maps.

    See `dfdbench.results.saved_run.open_run`, which this is.
    """
    from dfdbench.results.saved_run import open_run as open_saved

    return open_saved(path, dataset)


def show(pair: PairImages, prediction: NDArray[Any] | None = None) -> Figure:
    """Draw a pair's images and ground truth, and a prediction with its error where one is given.

    See `dfdbench.figures.pairs.show`, which this is.
    """
    from dfdbench.figures.pairs import show as draw

    return draw(pair, prediction)
