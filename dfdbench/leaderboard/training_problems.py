"""Whether weights were trained on what a submitted result tests."""

from __future__ import annotations

from dfdbench.audit.leaks import manifest_leaks
from dfdbench.audit.trained_on import scenes_trained_on
from dfdbench.datasets.catalog import find_manifest
from dfdbench.errors import DfdbenchError, Problem


def training_problems(
    trained_on: str | None, weights_sha256: str | None, dataset: str, split: str, where: str
) -> list[Problem]:
    """Return the scenes that weights were trained on and that are tested, as problems.

    Parameters
    ----------
    trained_on : str or None
        What the method says of itself.
    weights_sha256 : str or None
        Of the weights; a method without any learned no scene by heart.
    dataset, split : str
        What is tested; the data set by the name and version of its manifest.
    where : str
        What the problems are about.
    """
    if not trained_on or not weights_sha256:
        return []
    try:
        named = scenes_trained_on(trained_on)
        test = find_manifest(dataset)
        scenes = test.scenes_of(split)
    except DfdbenchError:
        # Training data of one's own cannot be looked into; other checks tell an unknown test.
        return []
    if named is None:
        return []
    leaks = manifest_leaks(*named, test, scenes)
    tested = ", ".join(dict.fromkeys(leak.test for leak in leaks))
    if not leaks:
        return []
    return [
        Problem(
            "the weights were trained on scenes of the test",
            where=where,
            expected=f"a split of {dataset} that shares no scene or texture with {trained_on}",
            got=tested,
            fix="test on another split, or train without these scenes: dfdbench train --fold",
        )
    ]
