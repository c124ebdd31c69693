"""A result and a run as a notebook shows them: its table of means, its worst pairs."""

from __future__ import annotations

from dfdbench.datasets.notebook import depth_map, gallery, thumbnails
from dfdbench.metrics.protocol import metrics_of
from dfdbench.results.first_table import shown_protocol
from dfdbench.results.record import Result
from dfdbench.results.run_tables import run_score_table
from dfdbench.results.saved_run import SavedRun
from dfdbench.results.summary import ranked, summarise
from dfdbench.results.wording import score_text
from dfdbench.tables.table import as_html

_WORST = 3


def result_html(result: Result) -> str:
    """Return a result as a notebook shows it: means by lighting, under the first protocol."""
    return as_html(run_score_table(summarise(result, shown_protocol(result))))


def run_html(run: SavedRun) -> str:
    """Return a run as a notebook shows it: its means, and its worst pairs where there are any."""
    protocol = shown_protocol(run.result)
    rows = []
    for pair in ranked(run.result, protocol)[::-1][:_WORST]:
        if (found := run.images(pair)) is None:
            continue
        images, prediction = found
        (infocus, _), *others = thumbnails(images)
        scores = ", ".join(
            f"{metric.title} {score_text(pair.score(protocol, name))}"
            for name, metric in metrics_of(protocol).items()
        )
        depth = depth_map(prediction, images.valid | True, f"prediction: {scores}")
        rows.append([(infocus, f"{pair.id}, in-focus"), *others, depth])
    worst = f"<p><b>worst pairs</b></p>{gallery(rows)}" if rows else ""
    return result_html(run.result) + worst
