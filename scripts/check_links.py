"""Checks that relative links in Markdown lead to files and headings, that paths of code exist, and
that the contents of a book (SUMMARY.md in a folder) lead to each of its pages: check_links.py
FILE|FOLDER…"""

import re
import sys
from pathlib import Path

LINK = re.compile(r"\]\(([^)\s]+)\)")
# A path from the top of the repository, such as `crates/learn/src/config.rs`.
CODE = re.compile(r"`((?:benches|configs|crates|python|scripts|songs|viewer)/[\w./-]+\.(?:md|mid|py|rs|toml))`")
ROOT = Path(__file__).resolve().parents[1]
FENCE = re.compile(r"^```.*?^```", re.MULTILINE | re.DOTALL)


def anchors(page: Path) -> set[str]:
    """Names that Markdown readers give to the headings of a page."""
    heads = re.findall(r"^#+ (.+)$", FENCE.sub("", page.read_text()), re.MULTILINE)
    plain = (re.sub(r"[^\w\- ]", "", head.lower()).strip() for head in heads)
    return {head.replace(" ", "-") for head in plain}


def broken(page: Path) -> list[str]:
    text = page.read_text()
    found = [f"{page}: there is no {path}" for path in CODE.findall(text) if not (ROOT / path).exists()]
    for link in LINK.findall(FENCE.sub("", text)):
        if re.match(r"[a-z]+:", link):
            continue
        path, _, anchor = link.partition("#")
        target = (page.parent / path).resolve() if path else page
        if not target.exists():
            found.append(f"{page}: {link} leads nowhere")
        elif anchor and target.suffix == ".md" and anchor not in anchors(target):
            found.append(f"{page}: {target.name} has no heading for #{anchor}")
    return found


def left_out(summary: Path) -> list[str]:
    """Pages beside the contents of a book to which they do not lead."""
    linked = set(LINK.findall(summary.read_text())) | {summary.name}
    return [f"{page}: {summary} does not lead to it" for page in sorted(summary.parent.glob("*.md")) if page.name not in linked]


def main() -> int:
    pages: list[Path] = []
    for name in sys.argv[1:]:
        path = Path(name)
        pages += sorted(path.rglob("*.md")) if path.is_dir() else [path]
    found = [line for page in pages for line in broken(page)]
    found += [line for page in pages if page.name == "SUMMARY.md" for line in left_out(page)]
    print("\n".join(found) if found else f"{len(pages)} pages, every link leads somewhere")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
