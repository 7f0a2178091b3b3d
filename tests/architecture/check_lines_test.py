#!/usr/bin/env python3
"""The checker of lines must see a wide line in every kind of file, and nothing else."""
import pathlib
import tempfile
import unittest

import check_lines


class CheckLines(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.addCleanup(self.folder.cleanup)
        self.root = pathlib.Path(self.folder.name)

    def write(self, path, text):
        file = self.root / path
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text, encoding="utf-8")

    def test_lines_in_their_width(self):
        self.write("docs/a.md", "x" * 120 + "\n" + "\u00fc" * 120 + "\n")  # characters, not bytes
        self.write("data/points.txt", "x" * 500)  # not text that people read
        self.write("docs/chart.svg", "x" * 500)
        self.assertEqual(check_lines.check_tree(self.root), (1, []))

    def test_wide_lines(self):
        places = ["README.md", "docs/deep/a.md", "include/nerf/base/a.h", "src/a.cc", "apps/CMakeLists.txt",
                  "scripts/demo", "tests/a.py", "cmake/a.cmake"]
        for place in places:
            self.write(place, "short\n" + "x" * 121 + "\n")
        files, violations = check_lines.check_tree(self.root)
        self.assertEqual(files, len(places))
        self.assertEqual(len(violations), len(places))
        for place in places:
            self.assertIn(f"{place}:2: 121 characters, at most 120", violations)


if __name__ == "__main__":
    unittest.main()
