"""The one exception family of lfdepth."""


class LightFieldError(ValueError):
    """Input that lfdepth cannot work with.

    The message is a single line: the file or argument, what was found, what was expected, and what to do.
    """
