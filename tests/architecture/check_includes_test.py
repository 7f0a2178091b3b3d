#!/usr/bin/env python3
"""The include checker must see each kind of violation, and nothing in a clean tree."""
import pathlib
import tempfile
import unittest

import check_includes


class CheckIncludes(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.addCleanup(self.folder.cleanup)
        self.root = pathlib.Path(self.folder.name)
        self.write("include/nerf/base/error.h", "#include <string>\n")
        self.write("include/nerf/io/scene.h", '#include "nerf/base/error.h"\n')

    def write(self, path, text):
        file = self.root / path
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text, encoding="utf-8")

    def violations(self):
        return check_includes.check_tree(self.root)[1]

    def test_clean_tree(self):
        self.write("src/io/scene.cc", '#include <OpenImageIO/imageio.h>\n#include "nerf/io/scene.h"\n')
        self.write("apps/nerf_train.cc", '#include <CLI/CLI.hpp>\n#include "nerf/io/scene.h"\n')
        self.assertEqual(self.violations(), [])
        self.assertEqual(check_includes.check_tree(self.root)[0], 4)

    def test_upward_include_of_a_public_header(self):
        self.write("include/nerf/math/bad.h", '#pragma once\n#include "nerf/io/scene.h"\n')
        self.assertEqual(len(self.violations()), 1)
        self.assertIn("include/nerf/math/bad.h:2: layer math includes", self.violations()[0])

    def test_upward_include_of_a_source_in_any_spelling(self):
        self.write("src/io/private.h", "")
        for line in ('#include "nerf/io/scene.h"', "#include <nerf/io/scene.h>",
                     '  #  include "io/private.h"', '#include "../io/private.h"'):
            self.write("src/base/bad.cc", line + "\n")
            self.assertEqual(len(self.violations()), 1, line)

    def test_upward_include_of_a_test(self):
        self.write("tests/base/bad_test.cc", '#include "nerf/io/scene.h"\n')
        self.assertEqual(len(self.violations()), 1)

    def test_public_header_with_foreign_headers(self):
        for line in ("#include <fmt/core.h>", "#include <Eigen/Dense>", "#include <unistd.h>",
                     '#include "private.h"', "#include HEADER"):
            self.write("include/nerf/base/bad.h", line + "\n")
            self.assertEqual(len(self.violations()), 1, line)

    def test_header_outside_the_layers_and_missing_header(self):
        self.write("include/nerf/extra/bad.h", "")
        self.write("src/base/bad.cc", '#include "nerf/base/absent.h"\n')
        self.assertEqual(len(self.violations()), 2)


if __name__ == "__main__":
    unittest.main()
