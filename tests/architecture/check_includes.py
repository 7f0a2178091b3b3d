#!/usr/bin/env python3
"""Checks the #include lines of a source tree against the layers of docs/architecture.md.

  check_includes.py [ROOT]

A file of layer L (include/nerf/L, src/L, tests/L) may include only from L and the layers below it;
apps/ and bench/ may include everything. A public header (include/) may include only the C++ standard
library and other public headers, so that a consumer needs no other library's headers and no compiler
flag changes what a header declares. Prints one line per violation; exit code 1 when there is one.
"""
import pathlib
import re
import sys

LAYERS = ["base", "math", "geometry", "kernels", "autodiff", "parts", "model", "io", "train"]
INCLUDE = re.compile(r'^\s*#\s*include\s*(?:"(?P<quoted>[^"]*)"|<(?P<angled>[^>]*)>|(?P<other>\S+))')
STANDARD = re.compile(r"^[a-z_0-9]+$")  # <vector>, <cstdint>; not <unistd.h>, <fmt/core.h>


def layer_of(path):
    """Layer of a path relative to the root, or None for files outside the layers."""
    parts = path.parts
    if parts[:2] == ("include", "nerf"):
        name = parts[2]
    elif parts[0] in ("src", "tests"):
        name = parts[1]
    else:
        return None
    return LAYERS.index(name) if name in LAYERS else None


def included_path(root, file, target):
    """Path relative to the root of a quoted include, or None where no such file exists."""
    for folder in (file.parent, root / "include", root / "src", root / "tests"):
        candidate = (folder / target).resolve()
        if candidate.is_file() and candidate.is_relative_to(root):
            return candidate.relative_to(root)
    return None


def check_file(root, file):
    relative = file.relative_to(root)
    own, public = layer_of(relative), relative.parts[0] == "include"
    if public and own is None:
        yield f"{relative}: stands in no layer ({', '.join(LAYERS)})"
        return
    for number, line in enumerate(file.read_text(encoding="utf-8").splitlines(), 1):
        match = INCLUDE.match(line)
        if not match:
            continue
        where, quoted, angled = f"{relative}:{number}", match["quoted"], match["angled"]
        if public and quoted is None and not STANDARD.match(angled or ""):
            yield f"{where}: a public header includes {line.split('include', 1)[1].strip()}"
        name = quoted if quoted is not None else angled
        if name is None:
            continue
        if public and quoted is not None and not quoted.startswith("nerf/"):
            yield f'{where}: a public header includes "{quoted}", which is not installed'
        target = included_path(root, file, name)
        if target is None:
            if name.startswith("nerf/"):
                yield f"{where}: {name} does not exist"
            continue
        other = layer_of(target)
        if own is not None and other is not None and other > own:
            yield f"{where}: layer {LAYERS[own]} includes {name} of {LAYERS[other]}, a layer above it"


def check_tree(root):
    root, violations, files = pathlib.Path(root).resolve(), [], 0
    for folder in ("include", "src", "tests", "apps", "bench"):
        for file in sorted((root / folder).rglob("*")):
            if file.suffix in (".h", ".cc") and file.is_file():
                violations += check_file(root, file)
                files += 1
    return files, violations


def main():
    root = sys.argv[1] if len(sys.argv) > 1 else pathlib.Path(__file__).parents[2]
    files, violations = check_tree(root)
    for violation in violations:
        print(violation)
    print(f"{files} files, {len(violations)} violations")
    return 1 if violations or files == 0 else 0


if __name__ == "__main__":
    sys.exit(main())
