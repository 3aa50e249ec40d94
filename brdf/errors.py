"""The ways in which a request can fail, each with the exit code of the command line."""


class BrdfError(Exception):
    """Base of every error that is ours to explain: its text is one line for the user.

    Attributes
    ----------
    exit_code : int
        What the command ``brdf`` exits with.
    """

    exit_code = 1


class UsageError(BrdfError):
    """What was asked for cannot be meant: an unknown name, a value outside its bounds."""

    exit_code = 2


class DataError(BrdfError):
    """A file is missing, unreadable, or holds what cannot be fitted."""

    exit_code = 3


class NoBackend(BrdfError):
    """No libLLVM that Dr.Jit can work with."""

    exit_code = 4
