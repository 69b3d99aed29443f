"""docs/reference/cli.md from the parser and the settings: every verb with its options, and the keys of edit.toml.

    python scripts/cli_reference.py            writes the page
    python scripts/cli_reference.py --check    exits with 1 where it is not up to date
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from seeing_wind.engine.command.arguments import Parser, parser  # noqa: E402
from seeing_wind.engine.settings import BodyEdit, ColliderEdit, Edit, FieldEdit, options_of  # noqa: E402

PAGE = ROOT / "docs" / "reference" / "cli.md"
UNTITLED = ("positional arguments", "options")
"""Groups that need no title, as they come first."""
AS_RECOVER = "The options are those of `recover`; what concerns the solve alone makes no difference."
HEAD = """# Command line

Written by `make cli-reference` from the definitions of the options, and by a test held to them: change `seeing_wind/engine/settings/`
instead. `python -m seeing_wind.engine VERB ...`, or `blender --command seeing_wind VERB ...`.
`python -m seeing_wind.engine --version` says which version it is.
"""
EDIT = """## `edit.toml`

What `resimulate --edit` reads. Paths count from the file. `[[body]]` is needed once at least. [An edit](edit.md) has an
example and says what the keys do together.
"""


def page() -> str:
    """The whole page."""
    root = parser()
    verbs = next(action for action in root._actions if action.dest == "verb")
    helps = {choice.dest: choice.help for choice in verbs._choices_actions}
    parts = [HEAD]
    for name, verb in verbs.choices.items():
        parts.append(f"## `{name}`\n\n{_sentence(helps[name])}\n\n```\n{_usage(name, verb)}\n```\n")
        parts += [AS_RECOVER + "\n"] if name == "observe" else _groups(verb)
    parts.append(EDIT)
    tables = (("At the top", Edit), ("`[[body]]`", BodyEdit), ("`[[collider]]`", ColliderEdit), ("`[[further_field]]`", FieldEdit))
    for title, cls in tables:
        parts.append(f"### {title}\n\n" + _table("key", [(f"`{one.name}`", one.summary(one.default)) for one in options_of(cls).values()]))
    return "\n".join(parts)


def _usage(name: str, verb: Parser) -> str:
    """A verb's usage: its name and the arguments that are required."""
    needed = [action for action in verb._actions if action.required]
    words = [_call(action) for action in sorted(needed, key=lambda action: bool(action.option_strings))]
    return " ".join([name, *words, *(["[OPTIONS]"] if len(verb._actions) > len(needed) + 1 else [])])


def _groups(verb: Parser) -> list[str]:
    """A table for each group of options, and a sentence on options in it that exclude each other."""
    found, first = [], [action for group in verb._action_groups if group.title in UNTITLED for action in group._group_actions]
    for title, about, actions in [("", None, first)] + [
        (group.title, group.description, group._group_actions) for group in verb._action_groups if group.title not in UNTITLED
    ]:
        rows = [(f"`{_call(action)}`", action.help % {"prog": verb.prog}) for action in actions if "--help" not in action.option_strings]
        if rows:
            heading = (f"### {_sentence(title)[:-1]}\n\n" if title else "") + (f"{_sentence(about)}\n\n" if about else "")
            found.append(heading + _table("option", rows) + _alternatives(verb, actions))
    return found


def _alternatives(verb: Parser, actions: list[argparse.Action]) -> str:
    """A sentence on which of the `actions` exclude each other."""
    groups = [group._group_actions for group in verb._mutually_exclusive_groups if group._group_actions[0] in actions]
    named = [[f"`{action.option_strings[0]}`" for action in group] for group in groups]
    return "\nAt most one of " + "; of ".join(f"{', '.join(names[:-1])} and {names[-1]}" for names in named) + ".\n" if named else ""


def _call(action: argparse.Action) -> str:
    """An option as it is typed."""
    if not action.option_strings:
        return f"{action.metavar} ..." if action.nargs == "+" else str(action.metavar)
    value = action.metavar if isinstance(action.metavar, tuple) else (action.metavar,) if action.metavar else tuple(action.choices or ())
    between = "|" if action.metavar is None else " "
    return " ".join(filter(None, [action.option_strings[-1], between.join(value), "..." if action.nargs == "+" else ""]))


def _table(first: str, rows: list[tuple[str, str]]) -> str:
    cells = [(_cell(name), _cell(text)) for name, text in rows]
    return "\n".join([f"| {first} | |", "|---|---|", *(f"| {name} | {text} |" for name, text in cells)]) + "\n"


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


def _sentence(text: str) -> str:
    return f"{text[:1].upper()}{text[1:]}."


def main() -> int:
    """Write or check the page; returns the exit code."""
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--check", action="store_true")
    text = page()
    if arguments.parse_args().check:
        return int(not PAGE.is_file() or PAGE.read_text(encoding="utf-8") != text)
    PAGE.parent.mkdir(exist_ok=True)
    PAGE.write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
