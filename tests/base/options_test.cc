#include "nerf/base/options.h"

#include <gtest/gtest.h>

#include <bit>
#include <cmath>

#include "nerf/base/nearest_name.h"
#include "support/temp_folder.h"

namespace nerf {
namespace {

using test::error_of;

enum class Space { kIdentity, kContract };
auto option_names(Space) {
  return std::array{OptionName{Space::kIdentity, "identity"},
                    OptionName{Space::kContract, "contract"}};
}

struct March {
  int steps = 64;
  Space space = Space::kContract;
  template <class V>
  void visit_options(V& v) {
    v("max_steps", steps, "samples along the longest ray", at_least(1), at_most(1024));
    v("space", space, "warp of space");
  }
};

struct Common {
  uint64_t seed = 1;
  template <class V>
  void visit_options(V& v) {
    v("seed", seed, "random numbers");
  }
};

struct Options {
  bool fast = false;
  int64_t big = 5;
  int huge = 1;
  float rate = 0.1f;
  double share = 0.25;
  std::string name = "grid";
  std::filesystem::path out = "run";
  std::optional<double> near;
  uint8_t small = 7;
  March march;
  Common common;
  template <class V>
  void visit_options(V& v) {
    v("fast", fast, "quick and rough");
    v("big", big, "any integer");
    v("huge", huge, "a large range", at_least(1), at_most(100000));
    v("rate", rate, "learning rate", above(0));
    v("share", share, "share of samples", at_least(0), below(1));
    v("name", name, "method", one_of({"grid", "nerf"}));
    v("out", out, "folder", short_name('o'), metavar("DIR"));
    v("near", near, "nearest sample", above(0));
    v("small", small, "a small number");
    v("march", march, "marching");
    common.visit_options(v);
  }
  void check_options() const {
    if (fast && big > 100) throw Error("fast and big exclude each other", "options");
  }
};

const OptionField& field(const std::vector<OptionField>& fields, const std::string& name) {
  for (const OptionField& f : fields)
    if (f.name == name) return f;
  throw std::logic_error("no field " + name);
}

TEST(Options, FieldsComeInOrderWithGroupsPrefixed) {
  Options options;
  std::string names;
  for (const OptionField& f : option_fields(options)) names += f.name + " ";
  EXPECT_EQ(names,
            "fast big huge rate share name out near small march.max_steps march.space seed ");
  const auto fields = option_fields(options);
  EXPECT_EQ(field(fields, "out").short_name, 'o');
  EXPECT_EQ(field(fields, "out").metavar, "DIR");
  EXPECT_EQ(field(fields, "rate").help, "learning rate");
  EXPECT_EQ(option_flag(field(fields, "march.max_steps")), "--march-max-steps");
}

TEST(Options, TextSetsEveryType) {
  Options o;
  const auto fields = option_fields(o);
  const auto set = [&](const char* name, const char* text) {
    set_option_text(field(fields, name), text, name);
  };
  set("fast", "on");
  set("big", "-9223372036854775808");
  set("rate", "1e-3");
  set("share", "0.5");
  set("name", "nerf");
  set("out", "a/b");
  set("near", "0.125");
  set("small", "255");
  set("march.max_steps", "1024");
  set("march.space", "identity");
  set("seed", "18446744073709551615");
  EXPECT_TRUE(o.fast);
  EXPECT_EQ(o.big, INT64_MIN);
  EXPECT_EQ(o.rate, 1e-3f);
  EXPECT_EQ(o.share, 0.5);
  EXPECT_EQ(o.name, "nerf");
  EXPECT_EQ(o.out, "a/b");
  EXPECT_EQ(o.near, 0.125);
  EXPECT_EQ(o.small, 255);
  EXPECT_EQ(o.march.steps, 1024);
  EXPECT_EQ(o.march.space, Space::kIdentity);
  EXPECT_EQ(o.common.seed, UINT64_MAX);
  set("near", "none");
  EXPECT_FALSE(o.near.has_value());
}

TEST(Options, RefusedTextNamesWhatIsAllowedAndChangesNothing) {
  Options o;
  const auto fields = option_fields(o);
  const auto error = [&](const char* name, const char* text) {
    return error_of([&] { set_option_text(field(fields, name), text, name); });
  };
  EXPECT_EQ(error("march.max_steps", "1025"),
            "march.max_steps: '1025' is not allowed (allowed: an integer, 1 to 1024)");
  EXPECT_EQ(error("march.space", "contrat"),
            "march.space: 'contrat' is not allowed (did you mean contract? allowed: identity, "
            "contract)");
  EXPECT_EQ(error("huge", "0"), "huge: '0' is not allowed (allowed: an integer, 1 to 100000)");
  for (const char* text : {"", "1.5", "abc", "12x", "0x10", "1e3", "9223372036854775808", " 1"})
    EXPECT_NE(error("big", text), "") << text;
  for (const char* text : {"", "nan", "inf", "-inf", "0", "-1", "1e39", "none"})
    EXPECT_NE(error("rate", text), "") << text;
  for (const char* text : {"inf", "nan", "1e400", "0"}) EXPECT_NE(error("near", text), "") << text;
  for (const char* text : {"-0.1", "1", "1.5"}) EXPECT_NE(error("share", text), "") << text;
  for (const char* text : {"-1", "256", "18446744073709551616"})
    EXPECT_NE(error("small", text), "") << text;
  EXPECT_NE(error("seed", "-1"), "");
  EXPECT_NE(error("fast", "maybe"), "");
  EXPECT_NE(error("name", "mipnerf"), "");
  EXPECT_EQ(options_text(o), options_text(Options{}));
}

TEST(Options, TextOfAllFieldsReadsBack) {
  Options o;
  o.rate = 0.3f;
  o.share = 1.0 / 3.0;
  o.near = 2.5;
  o.common.seed = UINT64_MAX;
  const std::string text = options_text(o);
  EXPECT_NE(text.find("rate = 0.3\n"), std::string::npos) << text;
  EXPECT_NE(text.find("march.space = contract\n"), std::string::npos) << text;
  Options back;
  const auto from = option_fields(o), to = option_fields(back);
  for (size_t i = 0; i < from.size(); ++i) set_option_text(to[i], option_text(from[i]), "back");
  EXPECT_EQ(back.rate, o.rate);
  EXPECT_EQ(back.share, o.share);
  EXPECT_EQ(options_text(back), text);
}

TEST(Options, ValuesOfOtherTypesConvertOnlyWhenNothingIsLost) {
  Options o;
  const auto fields = option_fields(o);
  set_option(field(fields, "share"), OptionValue(int64_t{0}), "share");
  EXPECT_EQ(o.share, 0.0);
  set_option(field(fields, "big"), OptionValue(1e6), "big");
  EXPECT_EQ(o.big, 1000000);
  set_option(field(fields, "seed"), OptionValue(int64_t{3}), "seed");
  EXPECT_EQ(o.common.seed, 3u);
  for (const OptionValue& value : {OptionValue(1.5), OptionValue(1e300), OptionValue(true),
                                   OptionValue(std::string("1")), OptionValue(UINT64_MAX)})
    EXPECT_NE(error_of([&] { set_option(field(fields, "big"), value, "big"); }), "");
  EXPECT_NE(error_of([&] { set_option(field(fields, "big"), std::nullopt, "big"); }), "");
  EXPECT_EQ(o.big, 1000000);
}

TEST(Options, ValidationChecksLimitsThenTheStructsOwnRule) {
  Options o;
  EXPECT_NO_THROW(validate_options(o));
  o.march.steps = 0;
  EXPECT_EQ(error_of([&] { validate_options(o, "run"); }),
            "run: march.max_steps: '0' is not allowed (allowed: an integer, 1 to 1024)");
  o.march.steps = 1;
  o.share = std::nan("");
  EXPECT_NE(error_of([&] { validate_options(o); }), "");
  o.share = 0;
  o.fast = true;
  o.big = 101;
  EXPECT_EQ(error_of([&] { validate_options(o); }), "options: fast and big exclude each other");
}

TEST(Options, ShortDoubleKeepsTheFloat) {
  EXPECT_EQ(internal::short_double(0.1f), 0.1);
  uint32_t bits = 1;
  for (int i = 0; i < 20000; ++i, bits = bits * 1664525u + 1013904223u) {
    const auto x = std::bit_cast<float>(bits);
    if (std::isfinite(x)) {
      EXPECT_EQ(static_cast<float>(internal::short_double(x)), x);
    }
  }
}

TEST(NearestName, DistanceCountsEditsAndSwaps) {
  EXPECT_EQ(edit_distance("", "abc"), 3);
  EXPECT_EQ(edit_distance("kitten", "sitting"), 3);
  EXPECT_EQ(edit_distance("donwscale", "downscale"), 1);
  EXPECT_EQ(edit_distance("Max-Steps", "max_steps"), 0);
}

TEST(NearestName, FindsTypingMistakesOnly) {
  const std::vector<std::string> names{"--downscale", "--steps", "--minutes", "--out", "--size"};
  EXPECT_EQ(nearest_name("--donwscale", names), "--downscale");
  EXPECT_EQ(nearest_name("--min", names), "--minutes");
  EXPECT_EQ(nearest_name("--step", names), "--steps");
  EXPECT_EQ(nearest_name("--sampler-far-plane", names), std::nullopt);
  EXPECT_EQ(nearest_name("", names), std::nullopt);
  EXPECT_EQ(nearest_name("ab", std::vector<std::string>{"xy"}), std::nullopt);
  EXPECT_EQ(nearest_name(std::string(100000, 'a'), names), std::nullopt);
  EXPECT_EQ(nearest_name_hint("--donwscale", names), "did you mean --downscale?");
  EXPECT_EQ(nearest_name_hint("qqqqqqqqq", std::vector<std::string>{"a", "b"}), "known: a, b");
  EXPECT_EQ(nearest_name_hint("x", {}), "");
}

}  // namespace
}  // namespace nerf
