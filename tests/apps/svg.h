// For tests: files of charts.
#pragma once

#include <gtest/gtest.h>

#include <filesystem>
#include <string>

#include "run_program.h"

namespace nerf::testing_apps {

inline void expect_svg(const std::filesystem::path& file) {
  const std::string svg = read_text(file);
  EXPECT_EQ(svg.rfind("<svg ", 0), 0u) << file;
  EXPECT_TRUE(svg.ends_with("</svg>\n")) << file;
  EXPECT_EQ(svg.find("nan"), std::string::npos) << file;
  EXPECT_EQ(svg.find("inf"), std::string::npos) << file;
}

}  // namespace nerf::testing_apps
