"""Errors that carry what a person needs to mend them, as fields.

Wrong arguments raise :class:`ValueError`; the others are raised for requests and files.
"""

from __future__ import annotations


class ArgumentError(ValueError):
    """An argument that is not allowed.

    Parameters
    ----------
    key
        Its key path, such as ``damping.0.order``.
    message
        What is wrong with it.
    """

    def __init__(self, key: str, message: str) -> None:
        super().__init__(key, message)
        self.key = key
        self.message = message

    def below(self, key: str) -> ArgumentError:
        """The same error of an argument that belongs to another."""
        return ArgumentError(f"{key}.{self.key}", self.message)

    def __str__(self) -> str:
        return f"{self.key}: {self.message}"


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
