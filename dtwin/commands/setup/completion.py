"""`dtwin completion`: a script by which a shell completes commands, options and the choices of an option."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import reduce
from typing import Annotated, Any, Final, Literal, get_args, get_origin, get_type_hints

import tyro

from dtwin.commands.table import COMMANDS

Shell = Literal["bash", "zsh", "fish"]
_POSITIONAL: Final = get_args(tyro.conf.Positional[str])[1]
_WHERE: Final = {
    "bash": '# for ~/.bashrc: eval "$(dtwin completion bash)"',
    "zsh": '# for ~/.zshrc: eval "$(dtwin completion zsh)"',
    "fish": "# for ~/.config/fish/config.fish: dtwin completion fish | source",
}


@dataclass(frozen=True)
class Words:
    """What can follow a command.

    Attributes:
        options: Long options with their choices, none where anything may be given.
        choices: Choices of the positional arguments.
    """

    options: Mapping[str, tuple[str, ...]]
    choices: tuple[str, ...]


@dataclass(frozen=True)
class Completion:
    """Print a script that lets a shell complete `dtwin`; its first line says where it belongs."""

    shell: Annotated[Shell, tyro.conf.Positional]
    """Shell that is to complete."""

    def execute(self) -> int:
        commands = {name: _words(name) for name in COMMANDS}
        print(_WHERE[self.shell])
        print(_fish(commands) if self.shell == "fish" else _bash(commands, self.shell == "zsh"))
        return 0


def _words(name: str) -> Words:
    """What can follow a command, read from the dataclass of its options."""
    kind = COMMANDS[name].kind
    hints = get_type_hints(kind, include_extras=True)
    options: dict[str, tuple[str, ...]] = {"--help": ()}
    positional: tuple[str, ...] = ()
    for field in fields(kind):
        hint = hints[field.name]
        if _POSITIONAL in getattr(hint, "__metadata__", ()):
            positional += _choices(hint)
        else:
            options[f"--{field.name.replace('_', '-')}"] = _choices(hint)
    return Words(options, positional)


def _choices(hint: Any) -> tuple[str, ...]:
    """The texts that a type allows, none where it allows any."""
    if get_origin(hint) is Literal:
        return tuple(map(str, get_args(hint)))
    return reduce(lambda found, inner: found + _choices(inner), get_args(hint), ())


def _firsts(commands: Mapping[str, Words]) -> dict[str, list[str]]:
    """First words of the commands, each with those that may follow it."""
    firsts: dict[str, list[str]] = {}
    for name in commands:
        first, _, second = name.partition(" ")
        firsts.setdefault(first, []).extend([second] if second else [])
    return firsts


def _bash(commands: Mapping[str, Words], zsh: bool) -> str:
    """A function for bash, which zsh understands through its own bashcompinit."""
    firsts = _firsts(commands)
    lines = ["autoload -U +X compinit bashcompinit && compinit && bashcompinit"] if zsh else []
    lines += [
        "_dtwin() {",
        '    local words="" command="${COMP_WORDS[1]} ${COMP_WORDS[2]}" before="${COMP_WORDS[COMP_CWORD - 1]}"',
        '    if [ "$COMP_CWORD" -eq 1 ]; then',
        f'        words="{" ".join(firsts)} --help --version"',
        "    else",
        '        case "$command" in',
    ]
    for name, found in sorted(commands.items(), key=lambda item: -item[0].count(" ")):
        more = [] if " " in name else firsts[name]
        pattern = f'"{name}"' if " " in name else f'"{name} "*'
        lines += [f"            {pattern})", '                case "$before" in']
        for option, choices in found.options.items():
            if choices:
                lines.append(f'                    {option}) words="{" ".join(choices)}" ;;')
        rest = " ".join([*more, *found.choices, *found.options])
        lines += [f'                    *) words="{rest}" ;;', "                esac", "                ;;"]
    for first, seconds in firsts.items():
        if first not in commands:
            lines.append(f'            "{first} "*) words="{" ".join(seconds)} --help" ;;')
    lines += [
        "        esac",
        "    fi",
        '    COMPREPLY=($(compgen -W "$words" -- "${COMP_WORDS[COMP_CWORD]}"))',
        "}",
        "complete -o default -F _dtwin dtwin",
    ]
    return "\n".join(lines)


def _fish(commands: Mapping[str, Words]) -> str:
    """Lines for fish, each with the words after which it holds."""
    lines = []
    for first, seconds in _firsts(commands).items():
        lines.append(f"complete -c dtwin -n __fish_use_subcommand -f -a {first}")
        if seconds:
            condition = (
                f"__fish_seen_subcommand_from {first}; and not __fish_seen_subcommand_from {' '.join(seconds)}"
            )
            lines.append(f"complete -c dtwin -n '{condition}' -a '{' '.join(seconds)}'")
    for name, found in commands.items():
        condition = "; and ".join(f"__fish_seen_subcommand_from {word}" for word in name.split())
        if found.choices:
            lines.append(f"complete -c dtwin -n '{condition}' -a '{' '.join(found.choices)}'")
        for option, choices in found.options.items():
            given = f" -x -a '{' '.join(choices)}'" if choices else ""
            lines.append(f"complete -c dtwin -n '{condition}' -l {option.removeprefix('--')}{given}")
    return "\n".join(lines)
