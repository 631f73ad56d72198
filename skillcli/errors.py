"""Errors that a user can act on.

The library raises them; only `skillcli.cli` turns them into a line, a hint and an exit code.
"""


class SkillError(Exception):
    """A failure that the user can understand and act on.

    Args:
        message: one line: what was expected, what was got.
        hint: what to do about it, or what is available.
    """

    exit_code = 1

    def __init__(self, message: str, hint: str = "") -> None:
        super().__init__(message)
        self.message = message
        self.hint = hint


class UsageError(SkillError):
    """An invalid command, recipe or value."""

    exit_code = 2


class StoreError(SkillError):
    """The artifact store cannot do what was asked, or holds something damaged."""


class UnknownArtifact(StoreError):
    """The given id matches no artifact, or more than one."""


class Interrupted(SkillError):
    """The user stopped the work. The message says what was kept."""

    exit_code = 130
