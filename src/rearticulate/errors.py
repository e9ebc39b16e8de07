"""The two kinds of failure a user can meet, each with its exit code."""

from __future__ import annotations


class InputError(ValueError):
    """The input cannot be used: says which file, which frame, what is wrong and what would be right (exit code 2)."""


class FitError(RuntimeError):
    """The input was fine but the work could not be finished (exit code 1)."""


class InputWarning(UserWarning):
    """The input can be used but something in it was dropped or looks odd; one line."""


def one_line(error: Exception) -> str:
    """An exception's message on one line of bearable length, or its type."""
    text = " ".join(str(error).split())
    return text[:120] or type(error).__name__


def printable(text: str) -> str:
    """The text with a mark in place of all that would steer a terminal or is no character at all."""
    return "".join(c if c.isprintable() else "\ufffd" for c in text)
