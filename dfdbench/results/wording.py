"""Format a run's facts for cells: method, what it was given, parameters, scores, time, machine."""

import json
import math
from hashlib import sha256
from pathlib import Path
from typing import Any

from dfdbench.blur.tracks import CLEAN
from dfdbench.metrics.protocol import SURE, metrics_of
from dfdbench.results.record import MethodRecord, PairResult, Result
from dfdbench.system.text import TRAININGS
from dfdbench.tables.table import counted

NOTHING = "–"
#: The most characters of a parameter's value that a label shows in full.
_MOST = 40
#: Shown for depth maps made elsewhere, instead of facts that only a run knows.
NOT_KNOWN = "not known"
SECONDS_NOTE = (
    "Seconds: the median over pairs. Compare them only on one machine; a dash means that pairs ran "
    "several at once or on several machines."
)


def method_label(method: MethodRecord) -> str:
    """Return a method's name with the parameters that were set.

    Different names or parameters give different labels. Text that looks like a number, for example,
    is quoted, as on the command line. Of a long value there is the beginning and a hash.

    Examples
    --------
    >>> record = MethodRecord(
    ...     name="local", entry="m:Local", source_sha256=None, parameters={"window": 9}, uses=[],
    ...     trained_on=None, paper=None)
    >>> method_label(record)
    'local (window=9)'
    """
    settings = _settings(method)
    return f"{method.title} ({settings})" if settings else method.title


def training_text(method: MethodRecord) -> str:
    """Return what a method was trained and fitted on, in a few words.

    Examples
    --------
    >>> record = MethodRecord(
    ...     name="local", entry="m:Local", source_sha256=None, parameters={}, uses=[],
    ...     trained_on=None, paper=None, fitted_on="demo-1, split train")
    >>> training_text(record)
    'fitted on demo-1, split train'
    """
    if method.scored:
        return NOT_KNOWN
    fitted = f"fitted on {method.fitted_on}" if method.fitted_on else None
    return "; ".join(text for text in (method.trained_on, fitted) if text) or "nothing"


def seconds_text(seconds: float | None) -> str:
    """Format seconds to the millisecond.

    Examples
    --------
    >>> seconds_text(0.23456), seconds_text(0.00001)
    ('0.235', '< 0.001')
    """
    if seconds is None:
        return NOTHING
    return "< 0.001" if seconds < 0.001 else f"{seconds:.3f}"


def machine_of(result: Result) -> str:
    """Return the machine that a result was made on, in a few words.

    Marketing marks in the processor's name are left out. For depth maps that were made elsewhere
    and only scored here, the machine is not known.
    """
    if result.method.scored:
        return NOT_KNOWN
    environment = result.environment
    cpu = environment.cpu.replace("(R)", "").replace("(TM)", "")
    machine = f"{' '.join(cpu.split())}, {environment.cpu_count} cores"
    return f"{environment.gpu}; {machine}" if environment.gpu else machine


def parameters_of(result: Result) -> str:
    """Return the parameters that were set, as one would type them, long values cut."""
    return _settings(result.method) or "defaults"


def _settings(method: MethodRecord) -> str:
    return ", ".join(f"{plain(name)}={_brief(v)}" for name, v in method.parameters.items())


def _brief(value: object) -> str:
    # A blur law has thousands of characters; its hash tells it from another that begins like it.
    text = plain(value)
    return text if len(text) <= _MOST else f"{text[:20]}...{sha256(text.encode()).hexdigest()[:8]}"


def plain(value: object) -> str:
    """Return a parameter's value as one would type it.

    Examples
    --------
    >>> plain("rgb"), plain(9), plain("9"), plain("a, b=1")
    ('rgb', '9', '"9"', '"a, b=1"')
    """
    if isinstance(value, str) and not _is_taken_for_other(value):
        return value
    return json.dumps(value, ensure_ascii=False)


def _is_taken_for_other(text: str) -> bool:
    if not text.strip() or text != text.strip() or text[0] in "[{" or set(text) & set('",=()'):
        return True
    try:
        json.loads(text)
    except ValueError:
        return False
    return True


def titled_scores(pair: PairResult, protocol: str, nothing: str = NOTHING) -> list[tuple[str, str]]:
    """Return a pair's scores under a protocol, as titles of metrics with their texts."""
    metrics = metrics_of(protocol).items()
    return [(each.title, score_text(pair.score(protocol, name), nothing)) for name, each in metrics]


def score_text(value: float | None, nothing: str = NOTHING) -> str:
    """Format a score with four digits, as the thesis does; None and NaN become a dash.

    Examples
    --------
    >>> score_text(0.12345), score_text(math.nan), score_text(None, "undefined")
    ('0.1235', '–', 'undefined')
    """
    return nothing if value is None or math.isnan(value) else f"{value:.4f}"


def interval_text(interval: tuple[float, float] | None) -> str:
    """Format an interval of scores; None becomes a dash.

    Examples
    --------
    >>> interval_text((0.1, 0.25)), interval_text(None)
    ('0.1000 to 0.2500', '–')
    """
    return NOTHING if interval is None else " to ".join(map(score_text, interval))


# What a fit learns, if it is not the blur.
_LEARNED = {"positional-prior": "depth by place"}
GIVEN_NOTE = (
    "Given, besides the images: the recipe that made the blur, another recipe, a fit to training "
    "pairs, weights and the data they were trained on, the training scenes' mean depth, or nothing."
)


def given_to(result: Result) -> str:
    """Return what a run's method was given besides the images, in a few words.

    Parameters
    ----------
    result : Result
        The run.

    Notes
    -----
    This depends on what the method's constructor asked for and on what the method says about
    itself. If a function has the blur hard-coded, we cannot tell, and return ``nothing``.
    """
    method, dataset = result.method, result.dataset
    if method.scored:
        return NOT_KNOWN
    parts = []
    recipe = method.parameters.get("recipe")
    if recipe == "rig" or (isinstance(recipe, dict) and "focal_length" in recipe):
        parts.append("the lens")
    elif recipe is not None:
        same = recipe in (dataset.recipe["name"], dataset.recipe.get("parameters"))
        parts.append("the blur" if same else "another blur")
    elif method.fitted_on:
        # We do not know what somebody else's fit measures.
        ours = "blur fitted" if method.entry.startswith("dfdbench.") else "training pairs"
        parts.append(_LEARNED.get(method.name, ours))
    elif "recipe" in method.uses:
        parts.append("the blur")
    if "training_mean" in method.uses:
        parts.append("mean depth")
    elif "training_median" in method.uses:
        parts.append("median depth")
    elif method.trained_on:
        names = [part.partition(",")[0] for part in method.trained_on.split(TRAININGS)]
        parts.append(f"trained on {' and '.join(dict.fromkeys(names))}")
    return ", ".join(parts) or "nothing"


def knew_blur(method: MethodRecord, degradation: str) -> bool:
    """Return whether a method was given a blur on a track; ``clean`` is not a track.

    The record says whether the method's constructor was offered one, or whoever ran it gave one,
    which may also be the true one. Such a result has no rank.
    """
    given = method.parameters.get("recipe") is not None
    return degradation != CLEAN and (given or "recipe" in method.uses)


def without_folders(value: Any) -> Any:
    """Return a parameter or an entry as results show it: for a file only its name."""
    if isinstance(value, list):
        return [without_folders(part) for part in value]
    if isinstance(value, dict):
        return {name: without_folders(part) for name, part in value.items()}
    is_file = isinstance(value, str) and Path(value).is_absolute()
    return Path(value).name if is_file else value


def without_answers(count: int) -> str:
    """Say what it means for a run that so many pairs lack answers."""
    pairs = f"{counted(count, 'pair')} without an answer for every pixel"
    return f"{pairs}: no mean and no rank except under protocol {SURE}"
