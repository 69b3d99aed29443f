"""What the Markdown pages say of this repository is there: links, anchors, frames, files; and the pages keep to their lengths."""

from __future__ import annotations

import re
import shlex
import tomllib
from pathlib import Path

import pytest

from seeing_wind.engine.command.arguments import parser
from seeing_wind.engine.settings import BodyEdit, ColliderEdit, Edit, FieldEdit, options_of

ROOT = Path(__file__).resolve().parents[1]
AT_ROOT = [ROOT / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")]
PAGES = [*AT_ROOT, *sorted(ROOT.glob("docs/**/*.md")), *sorted(ROOT.glob("sample_scenes/*/README.md"))]
MOST_LINES = {"README.md": 130, "docs/accuracy.md": 80}
MOST_CHANGES = 12
"""Lines of the changelog for one release."""
MOST_WORDS = 40
"""In a sentence of the guide."""
LINK = re.compile(r"\]\(([^)#\s]*)(?:#([^)\s]+))?\)")
NAMED = re.compile(r"(?:sample_scenes|benchmarks|docs|tests|scripts|seeing_wind)/[\w/.-]*\w\.(?:py|sh|md|toml|txt|json|png)\b")


def prose(page: Path) -> str:
    """A page without its blocks of code."""
    return re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)


def anchors(page: Path) -> set[str]:
    """What a link to a heading of the page may name, as GitHub and MkDocs make it."""
    headings = re.findall(r"^#+ (.+)$", prose(page), re.MULTILINE)
    return {re.sub(r"[-\s]+", "-", re.sub(r"[^\w\s-]", "", heading.lower()).strip()) for heading in headings}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_anchors_and_named_files_are_there(page) -> None:
    broken = []
    for target, anchor in LINK.findall(prose(page)):
        there = page.parent / target if target else page
        if target.startswith("http"):
            continue
        if not there.exists() or (anchor and anchor not in anchors(there)):
            broken.append(f"{target}#{anchor}")
    assert broken == []
    assert [name for name in NAMED.findall(page.read_text(encoding="utf-8")) if not (ROOT / name).exists()] == []


def test_every_path_of_the_architecture_is_there() -> None:
    """Also folders, and what stands in code without its folder beside one that has it."""
    page = prose(ROOT / "docs" / "architecture.md")
    paths = set(re.findall(r"`((?:seeing_wind|tests|benchmarks|docs|scripts)/[\w./-]*)`", page))
    assert len(paths) > 70
    assert [path for path in sorted(paths) if not (ROOT / path).exists()] == []


@pytest.mark.parametrize(
    "name, path",
    [
        ("LAWS", "engine/materials.py"), ("PLASTIC_LAWS", "engine/materials.py"), ("LAW_TEXTS", "engine/settings/build.py"),
        ("ELASTIC_LAWS", "engine/mpm/laws/constitutive.py"), ("def kirchhoff_adjoint", "engine/mpm/laws/constitutive.py"),
        ("def kirchhoff_both_ways", "engine/mpm/laws/constitutive.py"), ("def plastic_flow", "engine/mpm/laws/plasticity.py"),
        ("FORMATS", "engine/field/sampling.py"), ("def export_field", "engine/field/sampling.py"), ("def _ply", "engine/field/sampling.py"),
        ("ONE_FILE", "ui/field/operators.py"), ("def option", "engine/settings/option.py"),
        ("def network_tracks", "engine/observe/networks.py"), ("class Generations", "engine/observe/tracks/reseed.py"),
        ("class Kernel", "engine/recovery/prior/kernel.py"), ("class Prior", "engine/recovery/prior/kernel.py"),
        ("def over_time", "engine/recovery/prior/kernel.py"), ("def correlation", "engine/recovery/prior/kernel.py"),
        ("def filmed", "engine/records.py"), ("LENS", "engine/observe/clip/transforms.py"),
        ("PINHOLES", "engine/observe/clip/transforms.py"),
        ("WAYS", "ui/property_kinds.py"), ("SAYS", "ui/bake/operators.py"), ("EXPORTS", "ui/bake/cache.py"),
        ("def bake_motion", "ui/bake/motion.py"), ("def way_for", "ui/bake/motion.py"),
        ("def material_options", "engine/settings/build.py"), ("VERBS", "engine/command/verbs.py"), ("VERBS", "ui/commands.py"),
    ],
)  # fmt: skip
def test_what_the_architecture_names_is_in_its_file(name, path) -> None:
    page = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    assert name.split()[-1] in page and re.search(rf"^\s*{re.escape(name)}\b", (ROOT / "seeing_wind" / path).read_text(), re.MULTILINE)


@pytest.mark.parametrize("page", MOST_LINES)
def test_pages_for_everyone_are_short(page) -> None:
    assert len((ROOT / page).read_text(encoding="utf-8").splitlines()) <= MOST_LINES[page]


def test_a_release_has_a_dozen_lines() -> None:
    releases = re.split(r"^## ", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), flags=re.MULTILINE)[1:]
    assert [one.splitlines()[0] for one in releases if len(re.findall(r"^- ", one, re.MULTILINE)) > MOST_CHANGES] == []


@pytest.mark.parametrize("page", sorted((ROOT / "docs" / "guide").glob("*.md")), ids=lambda page: page.name)
def test_sentences_of_the_guide_are_short(page) -> None:
    running = re.sub(r"^(\||!\[).*$", "", prose(page), flags=re.MULTILINE)
    parts = re.split(r"(?<=[.:?;])\s+|\n\s*\n|\n\s*(?:\d+\.|-) ", running)
    assert [" ".join(part.split()) for part in parts if len(part.split()) > MOST_WORDS] == []


def commands() -> list[str]:
    """The engine's command lines that README and guide print whole, in blocks of code or in a sentence."""
    pages = [ROOT / "README.md", *sorted(ROOT.glob("docs/guide/*.md")), ROOT / "docs" / "reference" / "formats.md"]
    text = "\n".join(page.read_text(encoding="utf-8") for page in pages)
    lines = re.findall(r"^(?: *\$ | *)((?:seeing-wind|blender --command seeing_wind) .+)$|`(seeing-wind [^`]+)`", text, re.MULTILINE)
    return sorted({line or inline for line, inline in lines})


@pytest.mark.parametrize("line", commands())
def test_printed_commands_are_ones_that_the_engine_takes(line) -> None:
    words = shlex.split(re.sub(r"--save \S+", "", line), comments=True)
    verb = words[3:] if words[0] == "blender" else words[1:]
    assert parser().parse_args(verb).verb == verb[0]


def test_the_printed_edit_has_keys_that_there_are() -> None:
    (text,) = re.findall(r"```toml\n(.*?)```", (ROOT / "docs" / "reference" / "edit.md").read_text(encoding="utf-8"), re.DOTALL)
    edit = tomllib.loads(text)
    unknown = set()
    for table, cls in (("body", BodyEdit), ("collider", ColliderEdit), ("further_field", FieldEdit)):
        unknown |= {key for one in edit.pop(table) for key in one} - set(options_of(cls))
    assert unknown | set(edit) - set(options_of(Edit)) == set()


def test_every_page_is_in_the_site_s_table() -> None:
    table = re.findall(r"[\w/-]+\.md", (ROOT / "mkdocs.yml").read_text(encoding="utf-8"))
    assert sorted(table) == sorted(page.relative_to(ROOT / "docs").as_posix() for page in ROOT.glob("docs/**/*.md"))
