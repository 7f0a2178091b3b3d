// Reads the numbers that the scripts of this folder wrote: lines of a word and numbers.
#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <sstream>
#include <string>
#include <type_traits>
#include <vector>

#include "math/worst_error.h"

namespace nerf {

// The numbers of every line that begins with `kind`.
inline std::vector<std::vector<double>> golden_lines(const std::string& file,
                                                     const std::string& kind) {
  std::ifstream in(std::string(NERF_SOURCE_DIR) + "/tests/golden/" + file);
  EXPECT_TRUE(in) << file;
  std::vector<std::vector<double>> out;
  for (std::string line; std::getline(in, line);) {
    std::istringstream words(line);
    std::string word;
    words >> word;
    if (word != kind) continue;
    out.emplace_back();
    for (double v; words >> v;) out.back().push_back(v);
    EXPECT_TRUE(words.eof()) << file << ": " << line;
  }
  EXPECT_FALSE(out.empty()) << file << " has no line of kind " << kind;
  return out;
}

// How far a result may be from a golden number of a training. `stated` is of a program in float;
// one in double rounds as much less, but the files have 12 digits.
inline double golden_tolerance(double want, double stated) {
  if (std::is_same_v<Real, float>) return stated;
  return stated * (kRoundoff / kFloatRoundoff) + 1e-11 * std::fabs(want);
}

}  // namespace nerf
