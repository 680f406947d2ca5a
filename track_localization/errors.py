"""Errors that a user can mend: what is wrong, where, and what to do about it."""


class DataError(ValueError):
    """
    Input that cannot be used.

    The message names the file or topic, the field, and the remedy; command lines print it and
    exit with 1.
    """
