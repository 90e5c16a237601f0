"""The error that a user's input causes; any other exception is a defect of this program."""


class InputError(ValueError):
    """What was given (a file, a setting, an option, a request) can't be used; says what, where, and what next."""
