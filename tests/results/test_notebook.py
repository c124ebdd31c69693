from dfdbench.datasets.store import Store
from dfdbench.evaluation.evaluate import evaluate
from tests.made_results import make_result


def test_a_result_shows_its_means_under_the_protocol_that_it_has() -> None:
    text = make_result({("One", 1, 1, 0): 0.2, ("Two", 1, 1, 0): 0.1}, "<mine>")._repr_html_()
    assert "&lt;mine&gt; on tiny-1, split test, protocol thesis" in text
    assert ">0.1500</td>" in text
    assert "<img" not in text


def test_a_run_shows_its_worst_pairs_worst_first(tiny_store: Store) -> None:
    run = evaluate(lambda infocus, defocus: defocus.mean(axis=2), tiny_store)
    text = run._repr_html_()
    worst = run.to_frame()["nrmse"].nlargest(3).index
    places = [text.index(f"{pair}, in-focus") for pair in worst]
    assert places == sorted(places)
    assert text.count("<img") == 3 * 4
    assert "prediction: NRMSE" in text
