#!/usr/bin/env python3
"""Prints the tables of docs/results as Markdown: scripts/tables.py SUBCOMMAND; --help lists them.

Tables are made from rows under version control, docs/results/data. In a page a table stands below a
comment with its command, `<!-- tables.py learning docs/results/data/learning -->`; `check` makes it
again and compares, `write` puts it into the page. With --measure a command first measures its rows
with the built command (`make build`; ETUDE names another build).
"""

import argparse
import contextlib
import importlib
import io
import pathlib
import shlex
import sys

from tables.common import COMMANDS, ROOT, Stopped

MODULES = [
    "adaptation", "experiments", "identification", "iterations", "learning", "robot", "sight", "wall_clock",
]
MARK = "<!-- tables.py "
# Pages of results that only sum up others.
OVERVIEWS = ["README.md", "experiments.md"]


def parser():
    parser = argparse.ArgumentParser(prog="tables.py", description=__doc__.partition("\n")[0])
    subcommands = parser.add_subparsers(dest="subcommand", required=True, metavar="SUBCOMMAND")
    subcommands.add_parser("check", help="compare the tables that are made from committed files with the pages")
    subcommands.add_parser("write", help="put these tables into the pages")
    for name, (function, arguments) in sorted(COMMANDS.items()):
        text = function.__doc__
        more = dict(help=text.partition("\n")[0].rstrip(".").replace("%", "%%"), description=text)
        subcommand = subcommands.add_parser(name, formatter_class=argparse.RawDescriptionHelpFormatter, **more)
        for names, settings in arguments:
            subcommand.add_argument(*names, **settings)
    return parser


def run(words):
    options = parser().parse_args(words)
    return COMMANDS[options.subcommand][0](options)


def marked(page):
    """Command and table, as a list of lines, of each comment in a page."""
    lines = page.read_text().splitlines()
    for at, line in enumerate(lines):
        if line.startswith(MARK):
            rest = [line.strip() for line in lines[at + 1 :]]
            first = next(index for index, line in enumerate(rest) if line)
            last = next((index for index in range(first, len(rest)) if not rest[index]), len(rest))
            yield line.removeprefix(MARK).removesuffix("-->").strip(), rest[first:last]


def check(rewrite):
    """The exit code: 1 if a page has another table than its command prints, and it is not rewritten."""
    count = wrong = 0
    for page in sorted((ROOT / "docs").rglob("*.md")):
        tables = list(marked(page))
        if page.parent.name == "results" and page.name not in OVERVIEWS and not tables:
            wrong += 1
            print(f"{page.relative_to(ROOT)}: has no table that is made from rows")
        for command, table in tables:
            printed = io.StringIO()
            with contextlib.redirect_stdout(printed):
                run(shlex.split(command))
            count += 1
            expected = printed.getvalue().strip().split("\n\n")[0].splitlines()
            if table != expected:
                wrong += 1
                if rewrite:
                    text = page.read_text()
                    at = text.index("\n".join(table), text.index(f"{MARK}{command} -->"))
                    page.write_text(text[:at] + "\n".join(expected) + text[at + len("\n".join(table)) :])
                print(f"{page.relative_to(ROOT)}: not what `scripts/tables.py {command}` prints:", *expected, sep="\n")
    print(f"tables: {count}, of which {wrong} are not what their commands print")
    return int((wrong > 0 and not rewrite) or count == 0)


def main():
    for name in MODULES:
        importlib.import_module(f"tables.{name}")
    if sys.argv[1:] in (["check"], ["write"]):
        sys.exit(check(rewrite=sys.argv[1] == "write"))
    try:
        sys.exit(run(sys.argv[1:]))
    except Stopped as stopped:
        sys.exit(f"tables.py: {stopped}")


if __name__ == "__main__":
    main()
