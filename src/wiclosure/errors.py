"""The exceptions that users can act on.

Every error here carries one sentence that names the offending file or value and the way out.  The command line prints
that sentence and exits with code 1; a library caller catches `WiclosureError`.
"""


def printable(text: str) -> str:
    """The text in one line, what cannot be printed as escapes."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in " ".join(text.split()))


class WiclosureError(Exception):
    """Root of all errors that this package raises on purpose."""

    def __str__(self) -> str:
        """The sentence in one line, what cannot be printed as escapes: it may name what stands in a damaged file."""
        return printable(super().__str__())


class InputError(WiclosureError):
    """A file, folder or recording that cannot be used as it is."""


class ConfigError(WiclosureError):
    """A configuration or command-line value that cannot be used as it is."""


class ProcessError(WiclosureError):
    """A process that was at work and is no more."""


class OutputError(WiclosureError):
    """A result that cannot be written."""
