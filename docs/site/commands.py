"""The reference of the command line, written out of the commands themselves."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

from dfdbench.cli import VERBS
from dfdbench.tables.render import escape_markdown

HEAD = """# Every command

Written from the program itself when this site is built: `dfdbench COMMAND --help` says the same.
`dfdbench --install-completion` teaches your shell the commands, data sets and methods.

`--format json`, and the statuses that commands end with: [scripts and agents](../scripts.md).

## The commands

"""


def commands_page() -> str:
    """Return the page: what each command is for, how it is called, its options."""
    listed = "\n".join(
        f"| [`{name}`](#dfdbench-{name}) | {verb.summary} |" for name, verb in VERBS.items()
    )
    parts = [HEAD, "| command | what |\n|:---|:---|", listed, "\n"]
    for name, verb in VERBS.items():
        parts += _described(verb.load(name), f"dfdbench {name}", 2)
    return "\n".join(parts)


def _described(command: Any, name: str, level: int) -> Iterator[str]:
    context = command.context_class(command, info_name=name)
    usage = command.get_usage(context).removeprefix("Usage: ")
    yield f"\n{'#' * level} dfdbench {name.removeprefix('dfdbench ')}\n"
    yield f"{escape_markdown(' '.join((command.help or '').split()))}\n"
    yield f"```\n{' '.join(usage.split())}\n```\n"
    shown = [parameter for parameter in command.params if not getattr(parameter, "hidden", False)]
    if rows := [_row(parameter, context) for parameter in shown]:
        yield "| option | what | default |\n|:---|:---|:---|"
        yield from rows
    for inner in command.list_commands(context) if hasattr(command, "list_commands") else ():
        found = command.get_command(context, inner)
        yield from _described(found, f"{name} {inner}", level + 1)


def _row(parameter: Any, context: Any) -> str:
    options, text = parameter.get_help_record(context)
    # The last pair of brackets that click writes holds what it knows of the option.
    found = re.fullmatch(r"(.*?)(?:\s*\[([^\[\]]*)\])?", text, re.S)
    assert found
    facts = (found[2] or "").replace("default: ", "")
    cells = (f"`{options.replace('|', '/')}`", *map(escape_markdown, (found[1], facts)))
    return f"| {' | '.join(cells)} |"
