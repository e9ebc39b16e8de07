"""How a command ends: known failures are one line and an exit code, warnings one line each."""

from __future__ import annotations

import functools
import os
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, NoReturn

import typer

from rearticulate.errors import FitError, InputError, printable
from rearticulate.extras import needs

FAILED, BAD_INPUT, INTERRUPTED = 1, 2, 130


def reported(command: Callable[..., None]) -> Callable[..., None]:
    """Run a command; exit 2 on bad input, 1 on failure, 130 on Ctrl-C. REARTICULATE_DEBUG=1 shows the traceback."""

    @functools.wraps(command)
    def run(*args: Any, **kwargs: Any) -> None:
        with _warnings_in_one_line():
            try:
                with needs():
                    command(*args, **kwargs)
            except (typer.Exit, typer.Abort, typer.BadParameter):
                raise
            except KeyboardInterrupt as interrupt:
                _end(str(interrupt) or "interrupted", INTERRUPTED)
            except InputError as error:
                _end(f"error: {error}", BAD_INPUT, error)
            except FitError as error:
                _end(f"error: {error}", FAILED, error)
            except OSError as error:
                _end(f"error: {error.filename or 'system'}: {error.strerror or error}", FAILED, error)
            except Exception as error:
                _end(
                    f"error: unexpected {type(error).__name__}: {error} (REARTICULATE_DEBUG=1 tells more)",
                    FAILED,
                    error,
                )

    return run


def _end(line: str, code: int, error: Exception | None = None) -> NoReturn:
    if error is not None and os.environ.get("REARTICULATE_DEBUG", "0") not in ("", "0"):
        raise error
    say(line)
    raise typer.Exit(code)


def say(line: str) -> None:
    """One line on stderr."""
    print(printable(" ".join(line.split())), file=sys.stderr, flush=True)


@contextmanager
def _warnings_in_one_line() -> Iterator[None]:
    """Ours are UserWarnings; what libraries say to developers is left out."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        warnings.simplefilter("always", UserWarning)
        warnings.showwarning = lambda message, *args, **kwargs: say(f"warning: {message}")
        yield
