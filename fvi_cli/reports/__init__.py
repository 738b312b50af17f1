"""Tables of orders as CSV, Markdown, LaTeX and JSON, and whether stored ones are up to date."""

from fvi_cli.reports.check import compare_tables, compare_with_tables
from fvi_cli.reports.files import (
    FORMS,
    rendered,
    summary_text,
    table_paths,
)
from fvi_cli.reports.json_table import from_json
from fvi_cli.reports.keep import write_tables, write_where_different

__all__ = [
    "FORMS",
    "compare_tables",
    "compare_with_tables",
    "from_json",
    "rendered",
    "summary_text",
    "table_paths",
    "write_tables",
    "write_where_different",
]
