from dfdbench.metrics.metric import METRICS
from dfdbench.metrics.of_protocol import metrics_of, ranked_by
from dfdbench.metrics.protocol import RELEASED


def test_the_trio_is_what_all_but_metres_are_scored_by() -> None:
    for label, protocol in RELEASED.items():
        if not protocol.metrics:
            assert metrics_of(label) == METRICS
            assert ranked_by(label) == ("nrmse", "nmae")
    assert metrics_of("somebody's own") == METRICS


def test_what_ranks_in_metres_is_scored_there_and_smaller_is_better() -> None:
    for label in ("metric", "aligned"):
        for name in ranked_by(label):
            assert not metrics_of(label)[name].larger_is_better
