"""Errors that carry what a person needs to mend them.

Wrong arguments raise :class:`ValueError`; what is here is raised for requests and files.
"""

from __future__ import annotations


class FviError(Exception):
    """Base of every error that the command line shows without a traceback."""


class RequestError(FviError):
    """A request or configuration that cannot be carried out (exit code 2).

    Parameters
    ----------
    complaints
        One line per mistake, all of them at once.
    """

    def __init__(self, *complaints: str) -> None:
        self.complaints = complaints
        super().__init__("\n".join(complaints))


class ConfigError(RequestError):
    """Mistakes in a configuration, each as ``file:line:column: key.path: message``."""


class StorageError(FviError):
    """A result file that cannot be read or written (exit code 2)."""


class ExecutorError(FviError):
    """Workers that cannot be reached or used (exit code 2)."""
