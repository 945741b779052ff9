#!/usr/bin/env python3
"""Checks that no files of a crate import each other in circles, and that crates depend only on those
in the lines below their own in ARCHITECTURE.md. Prints each circle and each arrow up; exits with 1.

Tests and re-exports do not count: `pub use a::B` is no import of `a` unless the file uses `B` itself.
"""

import re
import sys
import tomllib
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
# Tests of the robot need the emulated devices and the world that moves them: Cargo allows the circular dev-dependency.
DEV_ARROWS_UP = {("robot", "emulators"), ("robot", "twin"), ("robot", "stage")}
STRINGS = re.compile(r'//[^\n]*|/\*.*?\*/|r#+".*?"#+|"(?:\\.|[^"\\])*"', re.DOTALL)
TEST_MODULE = re.compile(r"#\[cfg\((?:all\()?test\b[^\]]*\]\s*(?:#\[[^\]]*\]\s*)*(?:pub(?:\([^)]*\))?\s+)?mod\s+(\w+)\s*([;{])")
USE = re.compile(r"(?P<public>pub(?:\([^)]*\))?\s+)?\buse\s+(?P<tree>[^;]+);")
PATH = re.compile(r"\b(?:crate|super|self)(?:::\w+)+")


def without_tests(text: str) -> str:
    """The text without comments, strings and test modules."""
    text = STRINGS.sub(lambda match: " " if match[0].startswith("/") else '""', text)
    while found := TEST_MODULE.search(text):
        end = found.end()
        if found[2] == "{":
            depth = 1
            while depth and end < len(text):
                depth += {"{": 1, "}": -1}.get(text[end], 0)
                end += 1
        text = text[: found.start()] + text[end:]
    return text


def leaves(tree: str, prefix: tuple[str, ...] = ()):
    """The paths of a `use` tree, each with the name that it brings in."""
    tree = tree.strip()
    if "{" in tree:
        head, _, rest = tree.partition("{")
        inner = rest.rsplit("}", 1)[0]
        prefix += tuple(part for part in head.strip().split("::") if part)
        depth, start = 0, 0
        for at, char in enumerate(inner + ","):
            depth += {"{": 1, "}": -1}.get(char, 0)
            if char == "," and depth == 0:
                if inner[start:at].strip():
                    yield from leaves(inner[start:at], prefix)
                start = at + 1
        return
    path, _, alias = tree.partition(" as ")
    parts = prefix + tuple(part.strip() for part in path.split("::") if part.strip())
    if parts and parts[-1] == "self":
        parts = parts[:-1]
    yield parts, alias.strip() or (parts[-1] if parts else "")


class Crate:
    def __init__(self, source: Path):
        self.source = source
        self.modules: dict[tuple[str, ...], Path] = {}
        self.texts: dict[tuple[str, ...], str] = {}
        root = next(path for name in ("lib.rs", "main.rs") if (path := source / name).exists())
        self.add((), root)

    def add(self, module: tuple[str, ...], path: Path):
        self.modules[module] = path
        self.texts[module] = without_tests(path.read_text())
        folder = path.parent if path.name in ("lib.rs", "main.rs", "mod.rs") else path.parent / path.stem
        for name in re.findall(r"\bmod\s+(\w+)\s*;", self.texts[module]):
            for child in (folder / f"{name}.rs", folder / name / "mod.rs"):
                if child.exists():
                    self.add((*module, name), child)

    @cache
    def uses(self, module: tuple[str, ...]):
        """Of each `use`: whether it is public, its absolute path in the crate, the name it brings."""
        found = []
        for match in USE.finditer(self.texts[module]):
            for path, name in leaves(match["tree"]):
                if absolute := self.absolute(module, path):
                    found.append((bool(match["public"]), absolute, name))
        return found

    def absolute(self, module: tuple[str, ...], path: tuple[str, ...]):
        if not path:
            return None
        first, rest = path[0], path[1:]
        if first == "crate":
            return rest
        if first == "self":
            return module + rest
        if first == "super":
            base = module[:-1]
            while rest and rest[0] == "super":
                base, rest = base[:-1], rest[1:]
            return base + rest
        return module + path if (*module, first) in self.modules else None

    def definition(self, path: tuple[str, ...], seen=frozenset()):
        """The module that defines what the path names, through re-exports."""
        module: tuple[str, ...] = ()
        for at, part in enumerate(path):
            if (*module, part) in self.modules:
                module = (*module, part)
                continue
            for public, target, name in self.uses(module):
                if name == part and target != path and target not in seen:
                    return self.definition(target + path[at + 1 :], seen | {path})
            for public, target, name in self.uses(module):
                if public and name == "*" and (found := self.definition((*target[:-1], part), seen | {path})) != module:
                    return found
            return module
        return module

    def imports(self, module: tuple[str, ...]):
        text = self.texts[module]
        body = re.sub(r"\bmod\s+\w+\s*;", "", USE.sub("", text))
        targets = set()
        for public, path, name in self.uses(module):
            if public and not re.search(rf"\b{name}\b", body):
                continue
            targets.add(self.definition(path[:-1] if name == "*" else path))
        for match in PATH.finditer(body):
            if path := self.absolute(module, tuple(match[0].split("::"))):
                targets.add(self.definition(path))
        return targets - {module}


def circles(edges: dict):
    """The strongly connected groups of more than one node (Tarjan's algorithm)."""
    index, low, stack, found = {}, {}, [], []

    def visit(node):
        index[node] = low[node] = len(index)
        stack.append(node)
        for target in edges[node]:
            if target not in index:
                visit(target)
                low[node] = min(low[node], low[target])
            elif target in stack:
                low[node] = min(low[node], index[target])
        if low[node] == index[node]:
            group = []
            while not group or group[-1] != node:
                group.append(stack.pop())
            if len(group) > 1:
                found.append(group)

    for node in edges:
        if node not in index:
            visit(node)
    return found


def file_circles():
    for source in sorted([*ROOT.glob("crates/*/src"), ROOT / "python/src"]):
        crate = Crate(source)
        edges = {module: crate.imports(module) for module in crate.modules}
        for group in circles(edges):
            arrows = [
                f"{crate.modules[a].relative_to(source)} -> {crate.modules[b].relative_to(source)}"
                for a in group for b in edges[a] if b in group
            ]
            yield f"{source.relative_to(ROOT)}: {len(group)} files in a circle: {'; '.join(sorted(arrows))}"


def layers() -> dict[str, int]:
    """The line of each crate in the drawing of ARCHITECTURE.md, from the top."""
    text = (ROOT / "ARCHITECTURE.md").read_text()
    block = next(b for b in re.findall(r"```(?:text)?\n(.*?)```", text, re.DOTALL) if b.lstrip().startswith("cli"))
    lines = [re.split(r"\s{2,}", line.strip())[0] for line in block.splitlines() if line.strip()]
    return {name.strip(): at for at, line in enumerate(lines) for name in line.split("·")}


def arrows_up():
    layer = layers()
    for manifest in sorted([*ROOT.glob("crates/*/Cargo.toml"), ROOT / "python/Cargo.toml"]):
        name = manifest.parent.name
        if name not in layer:
            yield f"{name} has no line in ARCHITECTURE.md"
            continue
        content = tomllib.loads(manifest.read_text())
        for table in ("dependencies", "dev-dependencies"):
            for used in content.get(table, {}):
                other = "cli" if used == "etude" else used.removeprefix("etude-")
                if (other == used and used != "etude") or other not in layer:
                    continue
                dev = table == "dev-dependencies" and (name, other) in DEV_ARROWS_UP
                if layer[other] <= layer[name] and not dev:
                    yield f"{name} -> {other} ({table}) does not point down"


def main() -> int:
    found = [*arrows_up(), *file_circles()]
    print("\n".join(found) if found else "no circle between files, no arrow up between crates")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
