from dfdbench.results.first_table import first_protocol


def test_sets_with_printed_tables_are_headed_by_the_thesis_others_and_tracks_by_known_pixels() -> (
    None
):
    assert first_protocol("middlebury") == first_protocol("realworld") == "thesis"
    assert first_protocol("middlebury-default") == first_protocol("mine") == "valid"
    assert first_protocol("demo@camera-2") == first_protocol("realworld-synthetic@law-1") == "valid"
