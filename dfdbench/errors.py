"""Errors that say what is wrong, where, and what the user can do."""

import difflib
import errno
import re
import unicodedata
from collections.abc import Callable, Iterable, Mapping
from dataclasses import KW_ONLY, dataclass
from typing import Self

# Longer than any name or path that somebody would want to read.
_LONG_WORD = re.compile(r"\S{300,}")
# Nobody reads more; the attribute `problems` has them all.
_MOST_SHOWN = 200
_NO_MEMORY = re.compile(
    "can't start new thread|failed to map segment|not enough memory|cannot allocate memory", re.I
)


@dataclass(frozen=True)
class Problem:
    """One thing that is wrong, and what the user can do about it.

    Parameters
    ----------
    what : str
        The problem in a few words.
    where : str
        The file, field or pair concerned.
    expected, got : str
        What was expected and what was found, if `what` does not say so.
    fix : str
        What the user can do about it.

    Notes
    -----
    As text it is one sentence, and a second one for the fix. Very long words are cut in the
    middle, and control characters are spelt out.

    Examples
    --------
    >>> print(Problem("unknown scene", where="splits.test", got="Boks", fix="did you mean Books?"))
    unknown scene (splits.test): got Boks
    Fix: did you mean Books?
    """

    what: str
    _: KW_ONLY
    where: str = ""
    expected: str = ""
    got: str = ""
    fix: str = ""

    def __str__(self) -> str:
        found = [f"expected {self.expected}"] * bool(self.expected)
        found += [f"got {self.got}"] * bool(self.got)
        place = f" ({self.where})" if self.where else ""
        facts = ": " + ", ".join(found) if found else ""
        text = self.what + place + facts + (f"\nFix: {self.fix}" if self.fix else "")
        return _LONG_WORD.sub(_cut, spelt_out(text))


def spelt_out(text: str) -> str:
    r"""Return text with invisible characters as escapes; tabs and line ends stay.

    We show text that others wrote: control characters would move the cursor, direction marks would
    reorder the text, and zero-width spaces would make two names look the same.

    Examples
    --------
    >>> print(spelt_out("local\u200b \x1b[2J"))
    local\u200b \x1b[2J
    """
    return text if text.isprintable() else "".join(map(_spelt, text))


def _spelt(letter: str) -> str:
    shown = letter.isprintable() or letter in "\t\n" or unicodedata.category(letter) == "Zs"
    return letter if shown else letter.encode("unicode_escape").decode()


def writable(text: str) -> str:
    r"""Return a text with lone surrogates, which no file can hold, spelt out.

    Examples
    --------
    >>> print(writable("depth \ud800"))
    depth \ud800
    """
    return text.encode("utf-8", "backslashreplace").decode("utf-8")


class DfdbenchError(Exception):
    """A mistake that a user can fix; it carries every problem that was found.

    Parameters
    ----------
    what : str
        The problem in a few words.
    where, expected, got, fix : str
        As for a `Problem`.

    Examples
    --------
    >>> print(DfdbenchError("no such folder", where="results"))
    no such folder (results)
    >>> print(DfdbenchError.of([Problem("no folder"), Problem("no image")]))
    2 problems:
    1. no folder
    2. no image
    """

    problems: tuple[Problem, ...]

    def __init__(
        self, what: str, *, where: str = "", expected: str = "", got: str = "", fix: str = ""
    ) -> None:
        self.problems = (Problem(what, where=where, expected=expected, got=got, fix=fix),)
        super().__init__(what)

    @classmethod
    def of(cls, problems: Problem | Iterable[Problem]) -> Self:
        """Return the error for one problem, or for several together."""
        found = (problems,) if isinstance(problems, Problem) else tuple(problems)
        error = cls(found[0].what if found else "")
        error.problems = found
        return error

    @classmethod
    def raise_if(cls, problems: Iterable[Problem]) -> None:
        """Raise one error for all problems, if there are any."""
        if found := tuple(problems):
            raise cls.of(found)

    def __str__(self) -> str:
        if len(self.problems) == 1:
            return str(self.problems[0])
        shown = self.problems[:_MOST_SHOWN]
        numbered = [f"{number}. {problem}" for number, problem in enumerate(shown, 1)]
        more = len(self.problems) - len(shown)
        numbered += [f"and {more} more"] * (more > 0)
        return "\n".join([f"{len(self.problems)} problems:", *numbered])

    def __reduce__(self) -> tuple[Callable[..., Self], tuple[tuple[Problem, ...]]]:
        # Exceptions are pickled by their arguments: send the problems, not the text.
        return type(self).of, (self.problems,)


class InputError(DfdbenchError, ValueError):
    """An invalid argument, such as an array of the wrong shape or a number out of range."""


class UnknownNameError(DfdbenchError, LookupError):
    """An unknown name of a data set, scene, split, protocol or method."""


class ManifestError(DfdbenchError):
    """A manifest that cannot be read or contradicts itself."""


class SourceError(DfdbenchError):
    """Images or depth maps that are missing, damaged or of the wrong kind."""


class StoreError(DfdbenchError):
    """A built data set that is absent, incomplete or damaged."""


class MethodError(DfdbenchError):
    """A method that cannot be loaded, or whose output cannot be scored."""


class ResultError(DfdbenchError):
    """A result file that is damaged, of another version or contradicts itself."""


def refuse_both(these: Mapping[str, object], those: Mapping[str, object]) -> None:
    """Refuse what cannot be asked for together, by its names as the user types them.

    Parameters
    ----------
    these, those : mapping of str to object
        Values by name; None, False and empty lists were not given. None of `these` goes with any
        of `those`.

    Raises
    ------
    InputError
        If some of both were given; it names them all.

    Notes
    -----
    Of `these` only options can be left out, not the name of a data set, a method or an experiment.

    Examples
    --------
    >>> refuse_both({"--each": None}, {"--train": "train", "--test": "test"})
    >>> refuse_both({"--fold": "K1"}, {"--train": "train", "--test": "test"})
    Traceback (most recent call last):
    dfdbench.errors.InputError: --train and --test cannot be given with --fold
    Fix: leave out --train and --test, or --fold
    """
    first, second = _given(these), _given(those)
    if first and second:
        fix = f"leave out {second}" + f", or {first}" * first.startswith("-")
        raise InputError(f"{second} cannot be given with {first}", fix=fix)


def refuse_alone(these: Mapping[str, object], needed: Mapping[str, object]) -> None:
    """Refuse what needs something else, by its names as the user types them.

    Parameters
    ----------
    these, needed : mapping of str to object
        As for `refuse_both`; any of `these` needs one of `needed`.

    Raises
    ------
    InputError
        If some of `these` were given, and none of `needed`.

    Examples
    --------
    >>> refuse_alone({"--split": "train"}, {"--dataset": None})
    Traceback (most recent call last):
    dfdbench.errors.InputError: --split cannot be given without --dataset
    Fix: add --dataset, or leave out --split
    """
    lacking, first = " or ".join(needed), _given(these)
    if first and not _given(needed):
        fix = f"add {lacking}, or leave out {first}"
        raise InputError(f"{first} cannot be given without {lacking}", fix=fix)


def _given(values: Mapping[str, object]) -> str:
    # An empty text, as of an unset variable, was given.
    none: tuple[object, ...] = (None, (), [])
    return " and ".join(k for k, v in values.items() if v is not False and v not in none)


def unknown_name(kind: str, name: str, known: Iterable[str], fix: str = "") -> UnknownNameError:
    """Return the error for an unknown name; it lists the near misses, or else all known names.

    Parameters
    ----------
    kind : str
        What the name stands for, e.g. ``"scene"``.
    name : str
        The name that was given.
    known : iterable of str
        Every valid name.
    fix : str, optional
        What else the user can do, apart from choosing another name.

    Examples
    --------
    >>> print(unknown_name("scene", "Reinder", ["Art", "Books", "Reindeer"]))
    unknown scene: got Reinder
    Fix: did you mean Reindeer?
    >>> print(unknown_name("scene", "Xylophone", ["Art", "Books", "Reindeer"]))
    unknown scene: expected one of: Art, Books, Reindeer, got Xylophone
    """
    choices, name = sorted(known), str(name)
    # A number's digits say nothing of what is near it.
    words = [] if name.isdigit() else choices
    # In a short name one letter makes a large difference.
    near = difflib.get_close_matches(name, words, n=3, cutoff=0.5 if len(name) < 4 else 0.55)
    near.sort(key=lambda each: (-difflib.SequenceMatcher(None, each, name).ratio(), each))
    if not near:
        near = [choice for choice in choices if choice.casefold() == name.casefold()][-1:]
    hint = f"did you mean {' or '.join(near)}?" if near else ""
    return UnknownNameError(
        what=f"unknown {kind}",
        # Nobody reads thirty names if one is near.
        expected="" if near else "one of: " + ", ".join(choices),
        got=name,
        fix=" ".join(part for part in (hint, fix) if part),
    )


def reason_of(error: BaseException) -> str:
    """Return why a file could not be read or written, in the system's words if it has any.

    Examples
    --------
    >>> reason_of(FileNotFoundError(2, "No such file or directory", "a.toml"))
    'No such file or directory'
    >>> reason_of(OSError("a library's own text"))
    "a library's own text"
    """
    return getattr(error, "strerror", None) or str(error)


def is_lack_of_memory(error: BaseException | None) -> bool:
    """Return whether an error, or one that led to it, says that memory or threads ran out.

    Examples
    --------
    >>> is_lack_of_memory(RuntimeError("can't start new thread")), is_lack_of_memory(KeyError())
    (True, False)
    """
    if error is None:
        return False
    if isinstance(error, MemoryError) or getattr(error, "errno", None) == errno.ENOMEM:
        return True
    # Each library words it differently.
    return bool(_NO_MEMORY.search(str(error))) or is_lack_of_memory(
        error.__cause__ or error.__context__
    )


def room_or(elsewhere: str, error: BaseException) -> str:
    """Return what to do if a file could not be written; suggest making room only on a full disk.

    Parameters
    ----------
    elsewhere : str
        How to choose another place, such as ``"choose another folder"``.
    error : BaseException
        Why the file could not be written.

    Examples
    --------
    >>> room_or("choose another place", OSError(errno.ENOSPC, "No space left on device"))
    'make room, or choose another place'
    >>> room_or("choose another place", OSError(errno.ENAMETOOLONG, "File name too long"))
    'choose another place'
    """
    full = isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT)
    return f"make room, or {elsewhere}" if full else elsewhere


def _cut(word: re.Match[str]) -> str:
    return f"{word[0][:100]}…{word[0][-100:]} ({len(word[0]):,} characters)"
