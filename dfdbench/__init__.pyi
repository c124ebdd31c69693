from .api import (
    build,
    compare,
    list_datasets,
    list_methods,
    load_method,
    open_run,
    run,
    run_tracks,
    run_transfer,
    score,
    tune,
)
from .board.board import Board, leaderboard
from .datasets.captures import Capture
from .datasets.dataset import Captures, Dataset, open_dataset
from .evaluation.predict import predict
from .figures.runs import show
from .methods.networks.onnx_export import export_onnx
from .report.objects import Comparison, Run, Transfer

__version__: str
__all__ = [
    "Board",
    "Capture",
    "Captures",
    "Comparison",
    "Dataset",
    "Run",
    "Transfer",
    "__version__",
    "build",
    "compare",
    "export_onnx",
    "leaderboard",
    "list_datasets",
    "list_methods",
    "load_method",
    "open_dataset",
    "open_run",
    "predict",
    "run",
    "run_tracks",
    "run_transfer",
    "score",
    "show",
    "tune",
]
