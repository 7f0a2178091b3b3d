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
  // All text is inside.
  const auto number_after = [&](const std::string& what, size_t from) {
    const size_t at = svg.find(what, from);
    return at == std::string::npos ? -1 : std::stod(svg.substr(at + what.size()));
  };
  const double height = number_after("height=\"", 0);
  for (size_t at = svg.find("<text "); at != std::string::npos; at = svg.find("<text ", at + 1)) {
    EXPECT_GT(number_after(" y=\"", at), 0) << file;
    EXPECT_LT(number_after(" y=\"", at), height) << file;
  }
}

}  // namespace nerf::testing_apps
