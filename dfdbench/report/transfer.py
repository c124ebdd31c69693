"""A method fitted on each of several data sets and tested on all of them."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from dfdbench.metrics.protocol import metrics_of, ranked_by, title_of
from dfdbench.results.record import Result
from dfdbench.results.wording import method_label, score_text
from dfdbench.tables.table import Table, as_html


class Transfer:
    """The scores of a method that was fitted on one data set and tested on another.

    Parameters
    ----------
    results : mapping of (str, str) to Result
        By what it was fitted on and what it was tested on.
    protocol : str
        The protocol of its table.
    folder : Path
        Where its runs are.
    """

    def __init__(
        self, results: Mapping[tuple[str, str], Result], protocol: str, folder: Path
    ) -> None:
        self.results = dict(results)
        self.protocol, self.folder = protocol, folder
        self._name = ranked_by(protocol)[0]
        first = next(iter(self.results.values()))
        self._metric = metrics_of(protocol)[self._name]
        self.title = (
            f"{method_label(first.method)} across data sets, split {first.dataset.split}, "
            f"protocol {title_of(protocol)}: {self._metric.heading}"
        )

    def __repr__(self) -> str:
        return f"<{self.title}>"

    def _repr_html_(self) -> str:
        return as_html(self.as_table())

    def table(self) -> pd.DataFrame:
        """Return the means: a row per set that it was fitted on, a column per set of the test."""
        means = {
            pair: (result.averages or {}).get(self.protocol, {}).get(self._name, np.nan)
            for pair, result in self.results.items()
        }
        order = list(dict.fromkeys(own for own, _ in means))
        frame = pd.Series(means).unstack().loc[order, order]
        return frame.rename_axis(index="fitted on", columns="tested on")

    def worst(self) -> float:
        """Return the most that a foreign fit costs: its score over that of the set's own fit."""
        means = self.table().to_numpy()
        return float((means / np.diag(means)).max())

    def as_table(self) -> Table:
        """Return the means as a table of the command line."""
        means = self.table()
        rows = tuple((str(own), *map(score_text, row)) for own, row in means.iterrows())
        note = f"The worst foreign fit has {self.worst():.2f} times the score of the set's own."
        columns = ("fitted on", *map(str, means.columns))
        return Table(self.title, columns, rows, "l" + "r" * len(means), (note,))

    def draw(self, forms: Sequence[str] = ("png",)) -> list[Path]:
        """Draw the matrix into its folder, as png, pdf or svg; return the files."""
        from dfdbench.figures.comparisons import transfer_figure  # it imports matplotlib
        from dfdbench.figures.style import write_forms

        return write_forms(
            transfer_figure(self.table(), self.title), self.folder, "transfer", forms
        )
