from typing import Any

from dfdbench.blur.recipe import RECIPES
from dfdbench.results.wording import given_to, method_label
from tests.made_results import edited, make_demo_result


def test_a_row_says_what_its_method_was_told() -> None:
    told: list[tuple[dict[str, Any], str]] = [
        ({}, "nothing"),
        ({"uses": ["recipe"]}, "the blur"),
        # What is handed over on a track is that there is no recipe.
        ({"uses": ["recipe"], "fitted_on": "demo-1@law-2, split train"}, "training pairs"),
        ({"entry": "dfdbench.methods.sgm:X", "fitted_on": "demo-1, split train"}, "blur fitted"),
        ({"parameters": {"recipe": "published"}}, "the blur"),
        ({"parameters": {"recipe": RECIPES["published"].as_dict()}}, "the blur"),
        ({"parameters": {"recipe": "text"}}, "another blur"),
        ({"uses": ["training_mean"], "trained_on": "demo-1, split train"}, "mean depth"),
        ({"trained_on": "demo-1, split train"}, "trained on demo-1"),
        # The recipe's name alone, which networks ask for to warn, is not the recipe.
        ({"uses": ["recipe_name"], "trained_on": "my own"}, "trained on my own"),
        ({"uses": ["recipe"], "trained_on": "demo-1, split train"}, "the blur, trained on demo-1"),
    ]
    for method, said in told:
        assert given_to(edited(make_demo_result(lambda pair: 0.1), method=method)) == said


def test_a_blur_law_of_thousands_of_characters_has_a_short_label() -> None:
    laws = ([0.1] * 1000, [0.1] * 1001, "a" * 40)
    made = make_demo_result(lambda pair: 0.1)
    labels = [
        method_label(edited(made, method={"parameters": {"recipe": law}}).method) for law in laws
    ]
    assert [len(label) < 60 for label in labels] == [True] * 3
    assert labels[0][:25] == labels[1][:25]
    assert len(set(labels)) == 3
    assert "a" * 40 in labels[2]
