from dfdbench.results.wording import method_label
from tests.made_results import make_demo_result


def test_a_label_has_the_name_and_the_parameters() -> None:
    assert (
        method_label(make_demo_result(lambda p: 0, parameters={"a": 1, "b": "x"}).method)
        == "mine (a=1, b=x)"
    )
