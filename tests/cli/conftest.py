"""The command line as a fixture, for the tests of each family of verbs."""

from tests.test_cli import dfdbench

__all__ = ["dfdbench"]
