"""Results as tables: one description of a table, one file per kind of result, one writer per form.

A kind of result (:mod:`fvi_cli.reports.kinds`) makes a :class:`Report` from its results. CSV,
Markdown, LaTeX, the text on a terminal and the check of stored rows are made from the report alone.
"""

from fvi_cli.reports.table import Column, Report, Sheet, Within, grid_of
from fvi_cli.reports.write import compare, rendered, to_text, write

__all__ = ["Column", "Report", "Sheet", "Within", "compare", "grid_of", "rendered", "to_text"]
__all__ += ["write"]
