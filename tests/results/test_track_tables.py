"""A method over tracks: each number is a run's own average, and none stands for a missing one."""

import numpy as np

from dfdbench.results.frame import scores_of
from dfdbench.results.record import Result
from dfdbench.results.track_tables import track_means, tracks_table
from tests.made_results import limited, make_demo_result


def run_of(label: str, value: float) -> Result:
    result = make_demo_result(lambda pair: value)
    if label == "clean":
        uses = result.method.model_copy(update={"uses": ["recipe"]})
        return result.model_copy(update={"method": uses})
    on_track = {"name": f"demo-1@{label}", "short": f"demo@{label}", "degradation": label}
    fitted = result.method.model_copy(update={"fitted_on": f"demo-1@{label}, split train"})
    dataset = result.dataset.model_copy(update=on_track)
    return result.model_copy(update={"dataset": dataset, "method": fitted})


RUNS = {
    "clean": run_of("clean", 0.125),
    **{f"gain-{number}": run_of(f"gain-{number}", 0.25 * number) for number in (1, 2, 3)},
    **{f"noise-{number}": run_of(f"noise-{number}", 0.5) for number in (1, 2, 3)},
}


def test_a_row_has_clean_the_severities_and_their_mean_without_clean() -> None:
    table = tracks_table(list(RUNS.values()), "thesis")
    assert table.columns == ("track", "clean", "1", "2", "3", "mean of severities")
    assert table.rows[0] == ("gain", "0.1250", "0.2500", "0.5000", "0.7500", "0.5000")
    assert table.rows[1] == ("noise", "0.1250", "0.5000", "0.5000", "0.5000", "0.5000")
    assert table.records[0]["nmae mean"] == 0.25
    assert "demo-1, split test, protocol thesis" in table.title


def test_what_was_told_is_said_of_clean_and_of_tracks() -> None:
    assert tracks_table(list(RUNS.values()), "thesis").notes[:2] == (
        "clean: blur told",
        "on tracks: blur fitted",
    )


def test_a_severity_that_is_incomplete_or_was_not_run_leaves_no_mean() -> None:
    runs = {**RUNS, "gain-2": limited(RUNS["gain-2"], 3)}
    del runs["noise-3"]
    table = tracks_table(list(runs.values()), "thesis")
    assert table.rows[0][2:] == ("0.2500", "–", "0.7500", "–")
    assert table.rows[1][2:] == ("0.5000", "0.5000", "–", "–")
    assert any(note.startswith("gain-2: 3 of 54 pairs") for note in table.notes)
    means = track_means(scores_of(list(runs.values())), "thesis", "nrmse")
    assert np.isnan(means.to_numpy()[0]).tolist() == [False, False, True, False]
