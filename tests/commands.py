"""Gives commands, in this process."""

import pytest

from cosim.cli import main


def command(capsys: pytest.CaptureFixture[str], *arguments: object, status: int = 0) -> tuple[str, str]:
    """Give a command, demand its exit status, and return what it printed to standard output and to standard error."""
    assert main([str(argument) for argument in arguments]) == status, capsys.readouterr()
    printed = capsys.readouterr()
    assert "Traceback" not in printed.err
    return printed.out, printed.err


def failed(capsys: pytest.CaptureFixture[str], status: int, *arguments: str) -> str:
    """Give a command, demand its exit status, and return what it printed to standard error."""
    _, printed = command(capsys, *arguments, status=status)
    return printed
