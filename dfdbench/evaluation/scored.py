"""Score depth maps that were made elsewhere, as a run's are scored; nothing is run."""

from collections.abc import Callable
from pathlib import Path

from pydantic import ValidationError

from dfdbench.datasets.dataset import Dataset
from dfdbench.errors import InputError
from dfdbench.evaluation.pair import blank_record, record_of
from dfdbench.evaluation.plan import protocols_on, require_what_was_built
from dfdbench.evaluation.prediction_files import PredictionFiles, find_predictions
from dfdbench.evaluation.run import RunDone, compose
from dfdbench.methods.method import Prediction
from dfdbench.metrics.protocol import Unit
from dfdbench.results.record import RESULT, SCORED, MethodRecord, PairResult, save_result
from dfdbench.results.run_folder import keep_prediction, keep_store_place, open_run_folder
from dfdbench.system.files import writing_folder


def score_predictions(
    predictions: Path,
    store: Dataset,
    split: str,
    folder: Path,
    name: str,
    unit: Unit = "levels",
    on_pair: Callable[[int, int], None] | None = None,
) -> RunDone:
    """Score a folder of depth maps, and write what a run writes.

    Parameters
    ----------
    predictions : Path
        The depth maps, see `dfdbench.evaluation.prediction_files.find_predictions`.
    store : Dataset
        The data set.
    split : str
        Which pairs.
    folder : Path
        Where result and depth levels go; what lies there is set aside.
    name : str
        What made them, as tables call it.
    unit : {"levels", "metres"}
        What they hold.
    on_pair : callable, optional
        Called with (pairs done, pairs to do).

    Returns
    -------
    RunDone
        Its result says ``scored``, has no source hash and no seconds.

    Raises
    ------
    InputError
        For a name that is none.
    StoreError
        Where the store has lost what was built.
    ResultError
        With all that is wrong with the files, before anything is written; where the folder cannot
        be written.
    """
    method = _method_record(name, unit)
    require_what_was_built(store, split)
    found = find_predictions(predictions, store, split, unit)
    with writing_folder(folder, "run"):
        identity = {"scored": name, "fingerprint": store.fingerprint, "split": split, "unit": unit}
        set_aside = open_run_folder(folder, identity, goes_on=False)
        keep_store_place(folder, store.path)
        records: dict[str, PairResult] = {}
        for number, pair in enumerate(found.files, 1):
            images = store.read(pair)
            depth = found.read(pair, store.shape_of(pair.scene))
            record = record_of(store, images, Prediction(depth, 0.0), protocols_on(store))
            records[pair.id] = record.model_copy(update={"seconds": None})
            keep_prediction(folder, store.manifest, pair, depth)
            if on_pair:
                on_pair(number, len(found.files))
        pairs = [
            records.get(pair.id) or blank_record(pair, "missing")
            for pair in store.manifest.pairs(split)
        ]
        result = compose(store, split, method, pairs, warnings=_warnings(found))
        save_result(result, folder / RESULT)
    return RunDone(result, folder, 0, set_aside)


def _method_record(name: str, unit: Unit) -> MethodRecord:
    try:
        return MethodRecord(
            name=name,
            entry=SCORED,
            source_sha256=None,
            parameters={},
            uses=[],
            trained_on=None,
            paper=None,
            scored=unit,
        )
    except ValidationError as error:
        what = f"no name for a method, which is one line of text: {name!r:.80}"
        raise InputError(what, fix="--method NAME") from error


def _warnings(found: PredictionFiles) -> list[str]:
    warnings = []
    if found.others:
        warnings.append(f"{found.others} files are of other pairs of the set, and were not scored")
    if found.highest <= 1 and found.about.kind == "levels":
        warnings.append("no depth map rises above level 1; levels go from 0 to 255")
    if found.beyond and found.about.scale is not None:
        ends = f"{found.about.scale.near:g} to {found.about.scale.far:g} m"
        warnings.append(f"{found.beyond:.1%} of all pixels lie beyond {ends} and count as the end")
    return warnings
