from dfdbench.datasets.captured_files import fill, places_in


def test_what_stands_in_braces_is_filled_and_nothing_else() -> None:
    # As text, never as a format: a manifest must not reach into objects.
    assert places_in("{scene.__class__}/{0}") == ("scene.__class__", "0")
    assert fill("{scene.__class__}", {"scene": "desk"}) == "{scene.__class__}"
    assert fill("{scene}/{image}.JPG", {"scene": "a", "image": "{scene}"}) == "a/{scene}.JPG"
