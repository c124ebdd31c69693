from .api import (
    Comparison,
    Run,
    build,
    compare,
    list_datasets,
    list_methods,
    load_method,
    open_dataset,
    open_run,
    run,
    run_tracks,
    score,
)
from .evaluation.predict import predict
from .figures.pairs import show

__version__: str
__all__ = [
    "Comparison",
    "Run",
    "build",
    "compare",
    "list_datasets",
    "list_methods",
    "load_method",
    "open_dataset",
    "open_run",
    "predict",
    "run",
    "run_tracks",
    "score",
    "show",
]
