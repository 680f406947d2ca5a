"""One table, written for a terminal, for Markdown, for HTML or as CSV."""

from __future__ import annotations

import csv
import dataclasses
import html
import io
import math
from collections.abc import Sequence

Cell = str | float | int | None


@dataclasses.dataclass(frozen=True)
class Table:
    """
    A heading row and rows of cells; None or NaN is written as an empty cell.

    ``title`` says what is shown and carries the unit where all columns share one.
    """

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[Cell]]

    def text(self) -> str:
        """Return it aligned for a terminal."""
        cells = self._cells()
        widths = [max(len(row[k]) for row in cells) for k in range(len(self.columns))]
        lines = []
        for n, row in enumerate(cells):
            parts = [
                c.ljust(w) if self._is_text(k) else c.rjust(w)
                for k, (c, w) in enumerate(zip(row, widths, strict=True))
            ]
            lines.append('  '.join(parts).rstrip())
            if n == 0:
                lines.append('  '.join('-' * w for w in widths))
        return '\n'.join([self.title, *lines]) if self.title else '\n'.join(lines)

    def markdown(self) -> str:
        """Return it as a Markdown table under its title."""
        cells = self._cells()
        marks = ['---' if self._is_text(k) else '---:' for k in range(len(self.columns))]
        escaped = [[c.replace('|', '\\|') for c in row] for row in (cells[0], marks, *cells[1:])]
        lines = ['| ' + ' | '.join(row) + ' |' for row in escaped]
        return '\n'.join([f'**{self.title}**', '', *lines] if self.title else lines)

    def html(self) -> str:
        """Return it as an HTML table with its title as caption."""
        head, *body = self._cells()
        parts = ['<table>', f'<caption>{html.escape(self.title)}</caption>' if self.title else '']
        parts.append('<tr>' + ''.join(f'<th>{html.escape(c)}</th>' for c in head) + '</tr>')
        for row in body:
            tags = ('td' if self._is_text(k) else 'td class="number"' for k in range(len(row)))
            parts.append(
                '<tr>'
                + ''.join(f'<{t}>{html.escape(c)}</td>' for t, c in zip(tags, row, strict=True))
                + '</tr>'
            )
        return '\n'.join([*parts, '</table>'])

    def csv(self) -> str:
        """Return it as CSV with unrounded numbers."""
        out = io.StringIO()
        writer = csv.writer(out, lineterminator='\n')
        writer.writerow(self.columns)
        for row in self.rows:
            writer.writerow(['' if _empty(cell) else cell for cell in row])
        return out.getvalue()

    def _cells(self) -> list[list[str]]:
        return [list(self.columns), *([_written(cell) for cell in row] for row in self.rows)]

    def _is_text(self, column: int) -> bool:
        return any(isinstance(row[column], str) for row in self.rows)


def _empty(cell: Cell) -> bool:
    return cell is None or (isinstance(cell, float) and math.isnan(cell))


def _written(cell: Cell) -> str:
    if cell is None or _empty(cell):
        return ''
    if isinstance(cell, float):
        return significant(cell)
    return str(cell)


def significant(value: float) -> str:
    """
    Return ``value`` with three digits that matter, and never fewer than the whole number.

    From ten millions on it is written with an exponent.
    """
    if value == 0.0 or not math.isfinite(value):
        return f'{value:g}'
    if abs(value) >= 1e7:
        return f'{value:.2e}'
    digits = max(0, 2 - math.floor(math.log10(abs(value))))
    return f'{value:.{min(digits, 5)}f}'
