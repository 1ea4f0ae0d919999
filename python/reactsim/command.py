"""Runs any command of the program."""

from __future__ import annotations

from .display import Text
from .options import PathLike
from .program import invoke, text_of

__all__ = ["command"]


def command(*arguments: PathLike, progress: bool = True) -> Text:
    """Runs a command of the program, as on the command line, and returns its standard output.

    It is for commands without a function of their own, such as
    `reactsim.command("completions", "bash")`. Arguments are not checked: paths from elsewhere
    belong after `"--"`, and values of options into `"--option=value"`.

    Args:
        arguments: Command, options and paths.
        progress: Show the messages of the program.

    Raises:
        ReactsimError: The exit code of the program is not 0; the message has its last lines.

    """
    output = invoke([text_of(argument) for argument in arguments], show=progress)
    return Text(output.data.decode("utf-8"))
