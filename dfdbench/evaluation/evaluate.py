"""A run from Python: a method, a data set and a split in, its scores and depth maps out."""

from __future__ import annotations

import shutil
import tempfile
import weakref
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

from dfdbench.datasets.dataset import Dataset, open_dataset
from dfdbench.errors import InputError, MethodError
from dfdbench.evaluation.loading import depth_warnings, load_for, load_here
from dfdbench.evaluation.plan import RunOptions
from dfdbench.evaluation.run import run_method
from dfdbench.methods.method import Method
from dfdbench.methods.registry import entry_of
from dfdbench.results.output_place import output_place
from dfdbench.results.record_file import RESULT
from dfdbench.results.saved_run import SavedRun


def evaluate(
    predict: str | Callable[..., Any],
    dataset: str | Dataset,
    split: str = "test",
    *,
    parameters: Mapping[str, Any] = MappingProxyType({}),
    limit: int | None = None,
    seed: int = 0,
    out: Path | str | None = None,
    cache: Path | None = None,
    on_pair: Callable[[int, int], None] | None = None,
) -> SavedRun:
    """Run a method on a split of a built data set; this is ``dfdbench.evaluate``.

    It does what ``dfdbench run`` does, by the same code: a prediction a pair, scores under every
    protocol, a fit first where the method has one.

    Parameters
    ----------
    predict : str or callable
        A registered name, ``module:attribute``, ``file.py:attribute``; or the thing itself: a
        function of two RGB images, uint8 of shape (y, x, 3), that returns depth levels 0 to 255,
        shape (y, x), a class of such objects, or one of them. It may stand in a notebook.
    dataset : str or Dataset
        A data set's name, a store's path or URL, or an open store.
    split : str
        A split, a fold, a scene, or ``"all"``.
    parameters : mapping
        Handed to the method: to a class when it is constructed, to a function at each call.
    limit : int, optional
        Only the first pairs, so many; there are no averages then.
    seed : int
        For methods that draw random numbers.
    out : Path or str, optional
        A folder that keeps result and depth maps as `dfdbench run --out` does; a run that was
        stopped goes on there, unless the method is a thing that only this process knows, which
        is run anew. By default they lie in a temporary folder, as long as what is returned lives.
    cache : Path, optional
        The cache folder in which the data set is looked for.
    on_pair : callable, optional
        Called with (pairs done, pairs to do).

    Returns
    -------
    SavedRun
        ``result``, the scores; ``to_frame()``, a pandas table of them, one row per pair;
        ``images(pair)``, a pair's images and depth.

    Raises
    ------
    StoreError
        Where the data set is not built.
    UnknownNameError
        Where there is no such method, data set or split.
    InputError
        If `limit` is less than 1, `dataset` is neither a name nor a store, or `out` is a place
        that holds something else.
    MethodError
        Where the method cannot be loaded or fitted. What it raises on a pair is noted in that
        pair's record instead.

    Examples
    --------
    >>> run = evaluate(lambda infocus, defocus: 255 - infocus.mean(2), "demo")  # doctest: +SKIP
    >>> run.to_frame().groupby("scene")["nrmse"].mean()  # doctest: +SKIP
    """
    if limit is not None and limit < 1:
        raise InputError("no number of pairs", where="limit", expected="1 or more", got=str(limit))
    if not isinstance(dataset, str | Dataset):
        raise InputError(
            "not a data set",
            where="dataset",
            expected="a name, a path, or an open store",
            got=repr(dataset)[:80],
            fix="evaluate(method, captures.dataset, split)",
        )
    store = dataset if isinstance(dataset, Dataset) else open_dataset(dataset, cache=cache)
    store.manifest.scenes_of(split)
    method, found_again = _load(store, predict, parameters, seed)
    if out is None:
        folder = Path(tempfile.mkdtemp(prefix="dfdbench-"))
    else:
        folder = output_place(out, str(store.path), option="out", replaces=True)
    try:
        done = run_method(
            store,
            method,
            split,
            folder,
            RunOptions(limit, fresh=not found_again, seed=seed),
            warnings=depth_warnings(method, store, split),
            on_pair=on_pair,
        )
        run = SavedRun(folder / RESULT, done.result, store, "")
    except BaseException:
        if out is None:
            shutil.rmtree(folder, ignore_errors=True)
        raise
    if out is None:
        weakref.finalize(run, shutil.rmtree, folder, ignore_errors=True)
    return run


def _load(
    store: Dataset, predict: str | Callable[..., Any], parameters: Mapping[str, Any], seed: int
) -> tuple[Method, bool]:
    """Return the method, and whether it could be found again under its name."""
    if not isinstance(predict, str):
        try:
            entry_of(predict)
        except MethodError:
            return load_here(store, predict, parameters, seed), False
    return load_for(store, predict, parameters, seed), True
