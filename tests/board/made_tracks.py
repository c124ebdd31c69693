"""Runs on tracks made by hand, for the tests of what reads them."""

import functools
from collections.abc import Sequence
from typing import Any

from dfdbench.blur.tracks import CLEAN, SUITES
from dfdbench.datasets.manifest import Pair
from dfdbench.results.record import Result
from tests.made_results import edited, make_demo_result

ALL = list(SUITES["tracks-1"])


def _always(value: float, pair: Pair) -> float:
    return value


def make_tracks(
    name: str = "mine", value: float = 0.1, labels: Sequence[str] = ALL, **method: Any
) -> dict[str, Result]:
    """Runs on the demo set and on tracks of it: 0 on clean images, `value` on each track."""
    found = {}
    for number, label in enumerate([CLEAN, *labels]):
        always = functools.partial(_always, 0.0 if label == CLEAN else value)
        result = make_demo_result(always, name, protocols=("valid",))
        dataset: dict[str, Any] = {"fingerprint": f"{number:064x}"}
        own = dict(method)
        if label != CLEAN:
            dataset |= {"name": f"demo-1@{label}", "short": f"demo@{label}", "degradation": label}
            dataset["recipe"] = {"name": "", "parameters": {}}
        elif own.get("fitted_on"):
            own["fitted_on"] = None
        texts = {k: v.format(label=label) for k, v in own.items() if isinstance(v, str)}
        found[label] = edited(result, dataset=dataset, method=own | texts)
    return found
