"""Equations of the documentation: a hook of MkDocs that turns fenced blocks named `math` into MathML, which browsers draw by themselves.

GitHub draws the same blocks with its own renderer, so the pages need no script from elsewhere. See `hooks` in mkdocs.yml.
"""

from __future__ import annotations

import re

from latex2mathml.converter import convert

BLOCK = re.compile(r"^```math\n(.*?)^```$", re.DOTALL | re.MULTILINE)


def on_page_markdown(markdown: str, **_: object) -> str:
    """A page's Markdown with its equations, one or several lines of LaTeX each, as MathML."""
    return BLOCK.sub(lambda block: f"<div class='equation'>{convert(block[1].strip(), display='block')}</div>\n", markdown)
