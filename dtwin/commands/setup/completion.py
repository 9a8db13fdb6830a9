"""`dtwin completion`: a script by which a shell completes commands, options and the choices of an option."""

from __future__ import annotations

from argparse import ArgumentParser
from dataclasses import dataclass
from typing import Annotated, Any, Final, Literal

import shtab
import tyro

from dtwin.commands.table import COMMANDS
from dtwin.options import parser_of

Shell = Literal["bash", "zsh", "fish"]
_WHERE: Final = {
    "bash": '# for ~/.bashrc: eval "$(dtwin completion bash)"',
    "zsh": '# for ~/.zshrc: eval "$(dtwin completion zsh)"',
    "fish": "# for ~/.config/fish/config.fish: dtwin completion fish | source",
}


@dataclass(frozen=True)
class Completion:
    """Print a script that lets a shell complete `dtwin`; its first line says where it belongs."""

    shell: Annotated[Shell, tyro.conf.Positional]
    """Shell that is to complete."""

    def execute(self) -> int:
        print(_WHERE[self.shell])
        print(shtab.complete(_whole(), self.shell))
        return 0


def _whole() -> ArgumentParser:
    """One parser of all commands, those of two words within those of their first one."""
    whole = ArgumentParser(prog="dtwin")
    whole.add_argument("--version", action="store_true", help="print the version")
    firsts = whole.add_subparsers()
    for first in dict.fromkeys(name.split()[0] for name in COMMANDS):
        seconds = [name for name in COMMANDS if name.startswith(f"{first} ")]
        # What is in a group comes before the arguments of a command that the group is as well.
        parents = [_group(seconds)] if seconds else []
        if first in COMMANDS:
            _add(firsts, first, first, parents)
        else:
            firsts.add_parser(first, help=f"commands of {first}", parents=parents)
    return whole


def _group(names: list[str]) -> ArgumentParser:
    """A parser of the second words of commands."""
    group = ArgumentParser(add_help=False)
    seconds = group.add_subparsers()
    for name in names:
        _add(seconds, name.split()[1], name, [])
    return group


def _add(to: Any, word: str, name: str, parents: list[ArgumentParser]) -> None:
    command = COMMANDS[name]
    options = parser_of(command.kind, f"dtwin {name}")
    to.add_parser(word, help=command.summary, parents=[*parents, options], add_help=False)
