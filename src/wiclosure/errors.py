"""The exceptions that users can act on.

Every error here carries one sentence that names the offending file or value and the way out.  The command line prints
that sentence and exits with code 1; a library caller catches `WiclosureError`.
"""


class WiclosureError(Exception):
    """Root of all errors that this package raises on purpose."""


class InputError(WiclosureError):
    """A file, folder or recording that cannot be used as it is."""


class ConfigError(WiclosureError):
    """A configuration or command-line value that cannot be used as it is."""


class ProcessError(WiclosureError):
    """A process that was at work and is no more."""


class OutputError(WiclosureError):
    """A result that cannot be written."""
