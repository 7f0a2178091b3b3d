// What --medium of nerf_render says.
#include "medium_option.h"

#include <gtest/gtest.h>

#include "render_options.h"
#include "support/temp_folder.h"

namespace nerf::apps {
namespace {

TEST(ParseMedium, TakesEveryKey) {
  const Medium m = parse_medium(
      "smoke,sigma=0.1,0.2,0.3,colour=0.5,0.25,1,height=-1.5,falloff=2,box=0,-1,0,3,2,1", {});
  EXPECT_EQ(m.attenuation, (Vec3d{0.1, 0.2, 0.3}));
  EXPECT_EQ(m.backscatter, m.attenuation);
  EXPECT_EQ(m.colour, (Vec3{0.5_r, 0.25_r, 1}));
  EXPECT_EQ(m.height, -1.5);
  EXPECT_EQ(m.falloff, 2);
  ASSERT_TRUE(m.box);
  EXPECT_EQ(m.box->min, (Vec3d{0, -1, 0}));
  EXPECT_EQ(m.box->max, (Vec3d{3, 2, 1}));
  EXPECT_EQ(parse_medium("fog,sigma=0.4", {}).attenuation, (Vec3d{0.4, 0.4, 0.4}));
  EXPECT_EQ(parse_medium("fog,falloff=2", {}).height, 0);
}

TEST(ParseMedium, BackscatterIsItsOwn) {
  const Medium m = parse_medium("water,sigma=0.1,0.2,0.3,backscatter=0.5,0.25,0.75", {});
  EXPECT_EQ(m.attenuation, (Vec3d{0.1, 0.2, 0.3}));
  EXPECT_EQ(m.backscatter, (Vec3d{0.5, 0.25, 0.75}));
  const Medium one = parse_medium("water,backscatter=2", {});
  EXPECT_EQ(one.backscatter, (Vec3d{2, 2, 2}));
  EXPECT_EQ(one.attenuation, parse_medium("water", {}).attenuation);
}

// What is written is read again, to its six digits.
TEST(MediumText, IsReadAgain) {
  Medium water;
  water.attenuation = {1.0 / 3, 0.0123456789, 12.3456789};
  water.backscatter = {0.7, 2e-7, 3};
  water.colour = {0.05_r, 1.0_r / 3, 1};
  Medium fog;
  fog.attenuation = fog.backscatter = {0.4, 0.4, 0.4};
  fog.colour = {0.5_r, 0.6_r, 0.7_r};
  Medium ground = fog;
  ground.height = -1.5;
  ground.falloff = 0.25;
  ground.box = Box3{{-1, -2, -3}, {1, 2, 3.5}};
  for (const Medium& m : {water, fog, ground}) {
    const std::string text = medium_text(m);
    SCOPED_TRACE(text);
    EXPECT_EQ(text.find(' '), std::string::npos);
    const Medium read = parse_medium(text, {});
    for (int k = 0; k < 3; ++k) {
      EXPECT_NEAR(read.attenuation[k], m.attenuation[k], 5e-6 * m.attenuation[k]);
      EXPECT_NEAR(read.backscatter[k], m.backscatter[k], 5e-6 * m.backscatter[k]);
      EXPECT_NEAR(read.colour[k], m.colour[k], 5e-6_r);
    }
    EXPECT_EQ(read.height, m.height);
    EXPECT_EQ(read.falloff, m.falloff);
    ASSERT_EQ(read.box.has_value(), m.box.has_value());
    if (m.box) {
      EXPECT_EQ(read.box->max, m.box->max);
    }
  }
  EXPECT_EQ(medium_text(fog), "fog,sigma=0.4,colour=0.5,0.6,0.7");
}

// In a scene of twice the size fog is half as dense.
TEST(ParseMedium, KindsSayWhatIsLeftOut) {
  ModelInfo small, large;
  large.to_engine.scale = 0.5;
  for (const char* kind : {"fog", "smoke", "water"}) {
    const Medium a = parse_medium(kind, small), b = parse_medium(kind, large);
    EXPECT_FALSE(a.empty());
    EXPECT_NEAR(b.attenuation.x, 0.5 * a.attenuation.x, 1e-12);
    EXPECT_EQ(a.colour, b.colour);
    EXPECT_FALSE(a.falloff || a.box);
  }
  EXPECT_FALSE(parse_medium("fog", small).colour == parse_medium("smoke", small).colour);
  EXPECT_TRUE(parse_medium("off", small).empty());
  EXPECT_TRUE(parse_medium("fog,sigma=0", small).empty());
}

TEST(ParseMedium, MistakesAreNamed) {
  const struct {
    const char *text, *says;
  } cases[] = {
      {"fgo", "fog"},
      {"", "no medium"},
      {"sigma=1", "no medium"},
      {"off,sigma=1", "no medium"},
      {"fog,1", "no key"},
      {"fog,sigm=1", "sigma"},
      {"fog,sigma=1,sigma=2", "twice"},
      {"fog,sigma=", "no number"},
      {"fog,sigma=x", "no number"},
      {"fog,sigma=nan", "no number"},
      {"fog,sigma=inf", "no number"},
      {"fog,sigma=1e999", "no number"},
      {"fog,sigma=-1", "below 0"},
      {"fog,sigma=1,2", "give 1 or 3"},
      {"water,backscatter=1,2", "give 1 or 3"},
      {"water,backscatter=-1", "below 0"},
      {"fog,colour=1,1", "give 3"},
      {"fog,colour=1,1,2", "from 0 to 1"},
      {"fog,height=1", "falloff"},
      {"fog,height=1,falloff=0", "above 0"},
      {"fog,height=1,falloff=-2", "above 0"},
      {"fog,box=0,0,0,1,1", "give 6"},
      {"fog,box=0,0,0,1,1,-1", "lower corner"},
  };
  for (const auto& c : cases) {
    const std::string problem = test::error_of([&] { parse_medium(c.text, {}); });
    EXPECT_TRUE(test::contains(problem, c.says)) << c.text << ": " << problem;
    EXPECT_TRUE(test::contains(problem, "--medium")) << problem;
  }
  RenderCommand command;
  command.out = "out";
  command.medium = "fog,sigma=-1";
  EXPECT_TRUE(test::contains(test::error_of([&] { command.check_options(); }), "--medium"));
}

}  // namespace
}  // namespace nerf::apps
