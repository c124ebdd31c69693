from .api import (
    build,
    compare,
    list_datasets,
    list_methods,
    load_method,
    open_run,
    run,
    run_tracks,
    score,
)
from .board.board import Board, leaderboard
from .datasets.captures import Capture
from .datasets.dataset import Captures, Dataset, open_dataset
from .evaluation.predict import predict
from .figures.runs import show
from .report.objects import Comparison, Run

__version__: str
__all__ = [
    "Board",
    "Capture",
    "Captures",
    "Comparison",
    "Dataset",
    "Run",
    "build",
    "compare",
    "leaderboard",
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
