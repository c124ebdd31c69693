"""Keep commands from writing into a data set, a run, or one of their own inputs."""

import os
from pathlib import Path

from dfdbench.errors import InputError
from dfdbench.system.files import is_address

#: The file in a run's folder that identifies the run.
RUN_IDENTITY = "run.json"
_HELD = {RUN_IDENTITY: "a run", "zarr.json": "a built data set"}


def output_place(
    named: Path | str, *inputs: Path | str | None, option: str = "--out", replaces: bool = False
) -> Path:
    """Return the place that a command writes to, after checking that it may write there.

    Parameters
    ----------
    named : Path or str
        The file or folder that the user named, or the default.
    *inputs : Path, str or None
        Files and folders that the same command reads.
    option : str
        The option, for the message.
    replaces : bool
        The command itself checks what the place holds, and may replace it. Then only the folders
        above it are checked, and no input may be inside it.

    Raises
    ------
    InputError
        If the place is empty or a URL, or if it is a data set, a run or an input, or inside one.

    Examples
    --------
    >>> output_place("report", "photos") == Path("report")
    True
    >>> output_place("photos/report", "photos")
    Traceback (most recent call last):
    dfdbench.errors.InputError: this command would write into one of its inputs: photos ...
    """
    where = f"{option} {named}".lstrip()
    if not str(named).strip():
        raise InputError("no place is named", where=option, fix="leave it out, or name a place")
    if is_address(named):
        raise InputError("this command writes on this machine only, not to a URL", where=where)
    place = Path(os.path.realpath(str(named)))
    above = place.parents if replaces else (place, *place.parents)
    for marker, what in _HELD.items():
        holder = next((folder for folder in above if (folder / marker).is_file()), None)
        if holder:
            raise _refused(what, where, holder)
    for read in filter(None, inputs):
        source = Path(os.path.realpath(str(read)))
        if place.is_relative_to(source) or (replaces and source.is_relative_to(place)):
            raise _refused("one of its inputs", where, read)
    return Path(named)


def _refused(into: str, where: str, found: object) -> InputError:
    what = f"this command would write into {into}: {found}"
    return InputError(what, where=where, fix="choose another place")
