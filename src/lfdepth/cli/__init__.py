"""The command line: parses, calls the library, prints.

Everything heavy loads inside the command that needs it, so that help appears at once.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from io import TextIOWrapper
from typing import TYPE_CHECKING

from lfdepth.cli.interrupts import Interrupts
from lfdepth.errors import LightFieldError

if TYPE_CHECKING:
    from cyclopts import CycloptsError

__all__ = ["main"]

PROGRAM = "lfdepth"
FAILED = 2
"""Exit status after bad input or a file that cannot be read or written."""
INTERRUPTED = 130
"""Exit status after Ctrl-C, as shells have it: 128 + SIGINT."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command.

    Parameters
    ----------
    arguments : sequence of str, optional
        Words after the program's name; those of the process by default.

    Returns
    -------
    int
        Exit status: 0, 1 if a part of the work failed and the rest was done, 2 after an error that one line
        on standard error explains, 130 after Ctrl-C.
    """
    if isinstance(sys.stdout, TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")  # a symbol must not stop a result
    words = sys.argv[1:] if arguments is None else arguments
    interrupts = Interrupts()
    failure: Exception | None = None
    status = 0
    try:
        with interrupts:
            status = _run(words)
    except KeyboardInterrupt:
        interrupts.wanted = True
    except Exception as error:
        failure = error
    if interrupts.wanted:  # whatever a library made of it
        print("interrupted", file=sys.stderr)
        return INTERRUPTED
    return status if failure is None else _explained(failure)


def _run(words: Sequence[str]) -> int:
    from cyclopts import CycloptsError  # here, so that Ctrl-C is Ctrl-C while it loads, too

    from lfdepth.cli import commands, experiments, learned, scale, viewing  # noqa: F401  # these register themselves
    from lfdepth.cli.app import app
    from lfdepth.cli.options import method_named_in

    commands.add_estimate(method_named_in(words) if "estimate" in words else None)
    try:
        status = app(words, exit_on_error=False, print_error=False, result_action="return_value")
    except CycloptsError as error:
        return _fail(_usage(error, method_named_in(words)))
    sys.stdout.flush()
    return status or 0


def _explained(error: Exception) -> int:
    """Print one line on what went wrong; raise it again where it is no user's mistake."""
    if isinstance(error, LightFieldError):
        return _fail(_one_line(error))
    if isinstance(error, MemoryError):
        return _fail(f"not enough memory ({_one_line(error)}); use fewer or smaller views")
    if isinstance(error, BrokenPipeError):
        sys.stdout = None  # whoever read the output has left: nothing to flush
        return FAILED
    if isinstance(error, OSError):
        return _fail(f"{error.filename or 'file'}: {error.strerror or error}")
    if isinstance(error, RuntimeError) and "cannot cache function" in str(error):
        return _fail(
            "compiled kernels: neither the package's nor the user's cache folder is writable; expected a "
            "writable one; set NUMBA_CACHE_DIR to a folder of your own"
        )
    raise error


def _usage(error: CycloptsError, method: str) -> str:
    """What was wrong with the words of a command line, and where the right ones are listed."""
    from cyclopts import UnknownOptionError

    from lfdepth import methods

    command = " ".join([PROGRAM, *(error.command_chain or ())])
    estimating = list(error.command_chain or ()) == ["estimate"]
    if estimating and isinstance(error, UnknownOptionError):
        option = error.token.keyword or error.token.value
        known = [each.option for each in methods.parameters_of(methods.method_class(method)).values()]
        return (
            f"{option}: neither {command} nor method {method} has this option; expected one of the method's "
            f"({', '.join(known)}) or of the command's; see {command} --method {method} --help"
        )
    what = _one_line(error).split(" Available commands: ")[0]  # the first eight of them
    return f"{what.rstrip('.')}; see {command} --help"


def _fail(message: str) -> int:
    print(f"error: {message}", file=sys.stderr)
    return FAILED


def _one_line(error: Exception) -> str:
    return " ".join(str(error).splitlines())
