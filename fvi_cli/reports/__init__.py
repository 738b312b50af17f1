"""Results as tables: one description of a table, one file per kind of result, one writer per form.

A kind of result (:mod:`fvi_cli.reports.kinds`) makes a :class:`Report` of its results; everything
else (CSV, JSON, Markdown, LaTeX, what a terminal shows, whether stored files are up to date) is
done with the report alone.
"""

from fvi_cli.reports.compare import compare, missing, write
from fvi_cli.reports.table import Column, Report, Sheet, Within
from fvi_cli.reports.writers import rendered

__all__ = ["Column", "Report", "Sheet", "Within", "compare", "missing", "rendered", "write"]
