"""The command line as a fixture, for the tests of each family of verbs."""

from tests.cli.test_command_line import dfdbench

__all__ = ["dfdbench"]
