"""The ledger: what ours takes and what a named peer takes for the same, as one table."""

import os
import time
from collections.abc import Callable
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from dfdbench.results.environment import describe_environment
from dfdbench.tables.render import as_markdown
from dfdbench.tables.table import Table

HEADINGS = ("ours", "CPU ms", "peer", "CPU ms", "peer / ours", "what comes out")
#: On a page the table lies between these.
BEGIN, END = "<!-- written by make benchmark -->\n", "<!-- end -->\n"


def timed(run: Callable[[], Any]) -> tuple[float, Any]:
    """Return the processor seconds of a call, and what it returns: others at work do not count."""
    begun = time.process_time()
    found = run()
    return time.process_time() - begun, found


def cpu(run: Callable[[], Any], rounds: int = 1) -> float:
    """Measure the least processor seconds of some calls."""
    return min(timed(run)[0] for _ in range(rounds))


class Ledger:
    """Rows of a table, and how long it took to fill."""

    def __init__(self) -> None:
        self._begun = time.perf_counter()
        self.rows: list[tuple[str, ...]] = []

    def note(
        self, ours: str, own: float, package: str, peer: str, theirs: float, result: str
    ) -> None:
        """Note the processor seconds of ours and of a peer, by the name of its package."""
        numbers = _milliseconds(own), _milliseconds(theirs), f"{theirs / own:.3g}"
        named = f"{package} {version(package)}: {peer}"
        self.rows.append((ours, numbers[0], named, *numbers[1:], result))
        print("", ours, numbers[0], named, *numbers[1:], result, sep="\n")

    def require(self, ours: str, package: str) -> bool:
        """Return whether a peer is installed, and note where it is not."""
        try:
            return bool(version(package))
        except PackageNotFoundError:
            self.rows.append((ours, "", package, "", "", "peer not installed"))
            return False

    def text(self) -> str:
        """Return the table, and below it the machine and the time."""
        table = Table("ours beside its peers", HEADINGS, tuple(self.rows), "lrlrrl")
        found = describe_environment()
        minutes = (time.perf_counter() - self._begun) / 60
        load = f"{os.cpu_count()} cores with a load of {os.getloadavg()[0]:.0f}"
        where = f"{found.cpu}, one thread on {load}"
        return f"{as_markdown(table).strip()}\n\n{where}; the whole took {minutes:.1f} minutes.\n"

    def write(self, page: Path) -> None:
        """Put the table where the page has the last one."""
        before, begin, rest = page.read_text("utf-8").partition(BEGIN)
        _, end, after = rest.partition(END)
        page.write_text(f"{before}{begin}\n{self.text()}\n{end}{after}", encoding="utf-8")


def _milliseconds(seconds: float) -> str:
    return f"{1e3 * seconds:,.0f}" if seconds > 0.1 else f"{1e3 * seconds:.1f}"
