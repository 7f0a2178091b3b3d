#include "nerf/math/option_types.h"

#include <gtest/gtest.h>

#include "support/temp_folder.h"

namespace nerf {
namespace {

struct Options {
  Vec3 background{1, 1, 1};
  std::optional<Box3> bbox;
  std::optional<Vec3d> up;
  template <class V>
  void visit_options(V& v) {
    v("background", background, "background", at_least(0), at_most(1));
    v("bbox", bbox, "box");
    v("up", up, "up", check_value([](const OptionValue& value) -> std::string {
        const auto& x = std::get<std::vector<double>>(value);
        return x[0] == 0 && x[1] == 0 && x[2] == 0 ? "give a direction" : "";
      }));
  }
};

std::string error_of(const std::string& name, const std::string& text) {
  Options options;
  const std::string error = test::error_of([&] {
    for (const OptionField& f : option_fields(options))
      if (f.name == name) set_option_text(f, text, option_flag(f));
  });
  if (!error.empty()) {
    EXPECT_EQ(options_text(options), options_text(Options{}));
  }
  return error;
}

TEST(OptionTypes, VectorsAndBoxesReadBack) {
  Options options;
  auto fields = option_fields(options);
  set_option_text(fields[0], "0.1, 0.25,1", "background");
  set_option_text(fields[1], "-1,-2,-3,4,5,6.5", "bbox");
  set_option_text(fields[2], "0,0,-1", "up");
  EXPECT_EQ(options.background, (Vec3{0.1_r, 0.25_r, 1.0_r}));
  ASSERT_TRUE(options.bbox);
  EXPECT_EQ(options.bbox->min, (Vec3d{-1, -2, -3}));
  EXPECT_EQ(options.bbox->max, (Vec3d{4, 5, 6.5}));
  EXPECT_EQ(options.up, (Vec3d{0, 0, -1}));
  EXPECT_EQ(options_text(options),
            "background = 0.1,0.25,1\nbbox = -1,-2,-3,4,5,6.5\nup = 0,0,-1\n");
  set_option_text(fields[1], "none", "bbox");
  EXPECT_FALSE(options.bbox);
}

TEST(OptionTypes, WrongCountsLimitsAndOrderAreRefused) {
  EXPECT_EQ(error_of("background", "1,1"),
            "--background: '1,1' is not allowed (allowed: 3 numbers joined by commas, 0 to 1)");
  for (const char* text : {"", "1,1,1,1", "1,,1", "1,1,a", "1,1,2", "nan,0,0", "1 1 1", "none"})
    EXPECT_NE(error_of("background", text), "") << text;
  EXPECT_EQ(error_of("bbox", "0,0,0,1,1,0"),
            "--bbox: '0,0,0,1,1,0' is not allowed (each of x1, y1, z1 must be greater than its x0, "
            "y0, z0)");
  EXPECT_EQ(error_of("up", "0,0,0"), "--up: '0,0,0' is not allowed (give a direction)");
}

}  // namespace
}  // namespace nerf
