"""The tests of a file run on one of pytest-xdist's workers, or set-up is made on each of them."""

import os

import pytest


def test_the_tests_of_a_file_stay_together(request: pytest.FixtureRequest) -> None:
    if "PYTEST_XDIST_WORKER" not in os.environ:
        pytest.skip("one process runs all tests here: `make test` has two")
    # What the scheduler goes by; a version of pytest once lost it without a word.
    assert request.node.nodeid.endswith("@tests/test_workers.py")
