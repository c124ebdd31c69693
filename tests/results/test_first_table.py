from dfdbench.results.first_table import first_protocol


def test_captured_sets_are_shown_without_their_unknown_pixels() -> None:
    assert first_protocol("mine", "", "clean") == "valid"
    # What the thesis printed stays where it is, and a track names no recipe either.
    assert first_protocol("realworld", "", "clean") == "thesis"
    assert first_protocol("demo@camera-2", "", "camera-2") == "thesis"
    assert first_protocol("middlebury", "text", "clean") == "thesis"
