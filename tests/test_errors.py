import pickle

from dfdbench.errors import DfdbenchError, ManifestError, Problem, unknown_name


def test_several_problems_are_shown_together() -> None:
    text = str(
        DfdbenchError.of(
            [Problem("a", where="here", expected="1", got="2", fix="do"), Problem("b")]
        )
    )
    assert text.splitlines()[0] == "2 problems:"
    for part in ("1. a", "2. b", "here", "expected  1", "got       2", "fix       do"):
        assert part in text


def test_near_misses_are_named() -> None:
    assert "did you mean Reindeer?" in str(unknown_name("scene", "reindeer", ["Art", "Reindeer"]))
    assert "did you mean" not in str(unknown_name("scene", "zzz", ["Art", "Reindeer"]))


def test_errors_travel_between_processes() -> None:
    error = pickle.loads(pickle.dumps(ManifestError.of([Problem("a", where="b"), Problem("c")])))
    assert isinstance(error, ManifestError)
    assert error.problems == (Problem("a", where="b"), Problem("c"))


def test_what_a_user_handed_in_does_not_fill_the_screen() -> None:
    name = "begin" + "x" * 10_000 + "end"
    error = unknown_name("scene", name, ["Art"], fix=f"or build {name}")
    text = str(error)
    assert len(text) < 3000
    assert text.count("begin") == text.count("xend (10,0") == 2
    assert error.problems[0].got == name
    assert "y" * 5000 in str(Problem("a", expected="y" * 5000)), "our own names are all told"
