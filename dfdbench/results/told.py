"""What a result says its method was told of the blur: the column *told*.

What it is told on a track is made in `dfdbench.blur.formation`.
"""

from __future__ import annotations

from dfdbench.blur.tracks import CLEAN
from dfdbench.results.record import Result
from dfdbench.results.wording import NOT_TOLD

TOLD_NOTE = (
    "Told, beside the two images: the recipe that made the blur, another recipe, a fit to training "
    "pairs, weights and the data they were trained on, the training scenes' mean depth, or nothing."
)


def _is_lens(recipe: object) -> bool:
    return recipe == "rig" or (isinstance(recipe, dict) and "focal_length" in recipe)


def told(result: Result) -> str:
    """Return what a run's method was told, in a few words.

    Parameters
    ----------
    result : Result
        The run.

    Notes
    -----
    It goes by what the method's constructor asked for and by what the method says of itself: a
    function that has the blur written into it is told nothing as far as this can know.
    """
    method, dataset = result.method, result.dataset
    if method.scored:
        return NOT_TOLD
    parts = []
    if _is_lens(method.parameters.get("recipe")):
        parts.append("lens told")
    elif method.parameters.get("recipe") is not None:
        same = method.parameters["recipe"] == dataset.recipe["name"]
        parts.append("blur told" if same else "another blur told")
    elif method.fitted_on:
        parts.append("blur fitted")
    elif "recipe" in method.uses:
        parts.append("blur told")
    if "training_mean" in method.uses:
        parts.append("mean depth")
    elif method.trained_on:
        parts.append(f"trained on {method.trained_on.partition(',')[0]}")
    return ", ".join(parts) or "nothing"


def knew_blur(result: Result) -> bool:
    """Return whether a method was handed a blur on a track, where nobody tells it.

    It is what the record says: that the method's constructor was offered one, or that whoever ran
    it gave one, which may be the true one as well. Such a result has no rank.
    """
    method = result.method
    given = method.parameters.get("recipe") is not None
    return result.dataset.degradation != CLEAN and (given or "recipe" in method.uses)
