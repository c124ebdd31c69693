import pickle

import pytest

from dfdbench.errors import (
    DfdbenchError,
    InputError,
    ManifestError,
    Problem,
    is_lack_of_memory,
    refuse_alone,
    refuse_both,
    unknown_name,
)


def test_of_more_problems_than_anyone_reads_the_first_are_shown() -> None:
    error = DfdbenchError.of(Problem(f"no image {number}") for number in range(1000))
    lines = str(error).splitlines()
    shown = lines[0], lines[200], lines[201:]
    assert shown == ("1000 problems:", "200. no image 199", ["and 800 more"])
    assert len(error.problems) == 1000


def test_errors_travel_between_processes() -> None:
    error = pickle.loads(pickle.dumps(ManifestError.of([Problem("a", where="b"), Problem("c")])))
    assert isinstance(error, ManifestError)
    assert error.problems == (Problem("a", where="b"), Problem("c"))


def test_a_name_that_nobody_could_read_is_cut_and_our_lists_are_not() -> None:
    name = "begin" + "x" * 10_000 + "end"
    error = unknown_name("scene", name, [f"k{number}" for number in range(500)], f"or build {name}")
    text = str(error)
    assert len(text) < 4000
    assert text.count("begin") == text.count("xend (10,008 characters)") == 2
    assert "k0, k1, k10," in text
    assert "k99, got" in text
    # Who handles the error has the whole name.
    assert error.problems[0].got == name


def test_an_empty_text_was_given_and_false_was_not() -> None:
    refuse_both({"--check": False, "--train": None}, {"--mirror": (), "--test": "all"})
    with pytest.raises(InputError, match="--split cannot be given with --fold"):
        refuse_both({"--fold": ""}, {"--split": "test"})
    with pytest.raises(InputError, match=r"Fix: leave out --source$"):
        refuse_both({"demo": True}, {"--source": "here"})
    refuse_alone({"--split": None}, {"--dataset": None})
    refuse_alone({"--split": "test"}, {"--dataset": None, "--result": ""})


def test_text_of_somebody_elses_file_steers_no_terminal() -> None:
    text = str(DfdbenchError("wrong\x1b[2J", got="a\rb\x9b1m\x00", where="file\n  fix  none"))
    assert text == "wrong\\x1b[2J (file\n  fix  none): got a\\rb\\x9b1m\\x00"


def test_a_lack_of_memory_is_told_from_other_errors() -> None:
    wrapped = OSError("could not load the library")
    assert not is_lack_of_memory(wrapped)
    for error in (
        MemoryError(),
        RuntimeError("can't start new thread"),
        ImportError("cv2.abi3.so: failed to map segment from shared object"),
        OSError(12, "Cannot allocate memory"),
    ):
        assert is_lack_of_memory(error)
        wrapped.__cause__ = error
        assert is_lack_of_memory(wrapped)


def test_numbers_have_no_near_misses() -> None:
    assert str(unknown_name("step", "126", ["132", "136"])).endswith("one of: 132, 136, got 126")
