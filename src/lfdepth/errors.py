"""The one exception family of lfdepth."""


class LightFieldError(ValueError):
    """Input that lfdepth cannot work with.

    The message is a single line: the file or argument, what was found, what was expected, and what to do.

    Examples
    --------
    >>> import lfdepth
    >>> try:
    ...     lfdepth.read("no-such-scene")
    ... except lfdepth.LightFieldError as error:
    ...     print(error)
    no-such-scene: no such file or folder; expected a light field; check the path
    """
