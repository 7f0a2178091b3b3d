#!/usr/bin/env python3
"""Checks that no line of text that people read is wider than 120 characters.

  check_lines.py [ROOT]

Looks at README.md and, below docs, include, src, apps, bench, tests, cmake and scripts, at pages, C++,
Python, CMake and shell files. Prints one line per violation; exit code 1 when there is one.
"""
import pathlib
import sys

WIDTH = 120
FOLDERS = ("docs", "include", "src", "apps", "bench", "tests", "cmake", "scripts")
ENDINGS = {".md", ".h", ".cc", ".inc", ".py", ".cmake", ".sh"}


def files_of(root):
    """Paths of the files to look at."""
    yield from root.glob("*.md")
    yield from root.glob("CMakeLists.txt")
    for folder in FOLDERS:
        for path in sorted((root / folder).rglob("*")):
            shell = folder == "scripts" and not path.suffix
            if path.is_file() and (path.suffix in ENDINGS or path.name == "CMakeLists.txt" or shell):
                yield path


def check_tree(root):
    """Number of files and the list of violations."""
    files, violations = 0, []
    for path in files_of(root):
        files += 1
        for number, line in enumerate(path.read_text(encoding="utf-8").split("\n"), 1):
            if len(line) > WIDTH:
                violations.append(f"{path.relative_to(root)}:{number}: {len(line)} characters, at most {WIDTH}")
    return files, violations


def main():
    root = pathlib.Path(sys.argv[1] if len(sys.argv) > 1 else ".").resolve()
    files, violations = check_tree(root)
    print("\n".join(violations + [f"{files} files, {len(violations)} lines too wide"]))
    return 1 if violations or not files else 0


if __name__ == "__main__":
    sys.exit(main())
