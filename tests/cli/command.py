"""The command line, called as a user calls it."""

import json
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple


class Outcome(NamedTuple):
    status: int
    out: str
    err: str


@dataclass(frozen=True)
class Command:
    """Calls the command line; the first argument may be several words."""

    call: Callable[..., Outcome]

    def __call__(self, words: str, *arguments: str) -> Outcome:
        return self.call(*words.split(), *arguments)

    def fine(self, words: str, *arguments: str) -> Outcome:
        """Call it where nothing may go wrong."""
        done = self(words, *arguments)
        assert done.status == 0, done.err
        return done

    def facts(self, words: str, *arguments: str, status: int = 0) -> Any:
        """Call it for its answer as JSON."""
        done = self(words, *arguments, "--format", "json")
        assert done.status == status, done.err
        return json.loads(done.out)

    def refused(self, says: str, words: str, *arguments: str) -> Outcome:
        """Call it where a mistake is to end it with a message."""
        done = self(words, *arguments)
        assert (done.status, says in done.err, "Traceback" in done.err) == (2, True, False), done
        return done


#: Options of a training that ends after a few small steps.
_CHANGES = ("narrow=64", "crop=16", "crops_per_step=1", "steps=4")
QUICK = [f"--set={change}" for change in (*_CHANGES, "evaluate_every=2", "evaluate_pairs=1")]
QUICK += ["--device=cpu", "--threads=1"]
