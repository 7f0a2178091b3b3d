#include "nerf/kernels/simd.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "kernels/kernel_test.h"
#include "nerf/base/error.h"

namespace nerf {
namespace {

TEST(Simd, EveryListedTargetCanBeForced) {
  const std::vector<std::string> targets = simd_targets();
  ASSERT_FALSE(targets.empty());
  std::vector<std::string> seen;
  for_each_target([&](const std::string& target) {
    EXPECT_EQ(simd_target(), target);
    EXPECT_EQ(simd_targets(), targets) << "the list does not depend on what is forced";
    EXPECT_EQ(simd_target(), target) << "asking for the list changes nothing";
    seen.push_back(target);
  });
  EXPECT_EQ(seen, targets);
  EXPECT_EQ(simd_target(), targets.front()) << "the best comes first";
}

TEST(Simd, UnknownTargetIsAnErrorThatNamesTheOthers) {
  const std::string before = simd_target();
  try {
    force_simd_target("MMX");
    FAIL() << "no error";
  } catch (const Error& e) {
    const std::string text = e.what();
    EXPECT_NE(text.find("MMX"), std::string::npos) << text;
    for (const std::string& target : simd_targets())
      EXPECT_NE(text.find(target), std::string::npos) << text;
  }
  EXPECT_EQ(simd_target(), before);
}

}  // namespace
}  // namespace nerf
