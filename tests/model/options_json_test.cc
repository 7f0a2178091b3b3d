#include "nerf/model/options_json.h"

#include <gtest/gtest.h>

#include "support/temp_folder.h"

namespace nerf {
namespace {

enum class Mode { kOne, kTwo };
auto option_names(Mode) {
  return std::array{OptionName{Mode::kOne, "one"}, OptionName{Mode::kTwo, "two"}};
}

struct Inner {
  Mode mode = Mode::kOne;
  std::optional<double> far;
  template <class V>
  void visit_options(V& v) {
    v("mode", mode, "mode");
    v("far", far, "far", above(0));
  }
};

struct Options {
  bool flag = true;
  int steps = 3;
  uint64_t seed = UINT64_MAX;
  float rate = 0.1f;
  double exact = 1.0 / 3.0;
  std::string text = "a \"quoted\" \xc3\xa9";
  Inner inner;
  template <class V>
  void visit_options(V& v) {
    v("flag", flag, "flag");
    v("steps", steps, "steps", at_least(1), at_most(10));
    v("seed", seed, "seed");
    v("rate", rate, "rate");
    v("exact", exact, "exact");
    v("text", text, "text");
    v.retired("old", false);
    v.retired("old_rate", 0.0);
    v("inner", inner, "inner");
  }
  void check_options() const {
    if (steps == 7) throw Error("seven is not allowed", "options");
  }
};

std::string error_of(const std::string& json) {
  Options options;
  const std::string before = options_to_json(options);
  const std::string error = test::error_of([&] { options_from_json(options, json, "run.json"); });
  if (!error.empty()) {
    EXPECT_EQ(options_to_json(options), before) << "changed by " << json;
  }
  return error;
}

TEST(OptionsJson, RoundTripKeepsBits) {
  Options options;
  options.flag = false;
  options.steps = 10;
  options.inner.mode = Mode::kTwo;
  options.inner.far = 0.1;
  const std::string json = options_to_json(options);
  EXPECT_NE(json.find("\"rate\": 0.1,"), std::string::npos) << json;
  EXPECT_NE(json.find("\"mode\": \"two\""), std::string::npos) << json;
  Options back;
  back.rate = 0;
  back.exact = 0;
  back.seed = 0;
  options_from_json(back, json, "run.json");
  EXPECT_EQ(back.flag, false);
  EXPECT_EQ(back.steps, 10);
  EXPECT_EQ(back.seed, UINT64_MAX);
  EXPECT_EQ(back.rate, 0.1f);
  EXPECT_EQ(back.exact, 1.0 / 3.0);
  EXPECT_EQ(back.text, options.text);
  EXPECT_EQ(back.inner.mode, Mode::kTwo);
  EXPECT_EQ(back.inner.far, 0.1);
  EXPECT_EQ(options_to_json(back), json);
}

TEST(OptionsJson, NamedFieldsChangeOthersStay) {
  Options options;
  options.inner.far = 2.0;
  options_from_json(options, R"({"steps": 4, "inner": {"far": null}})", "run.json");
  EXPECT_EQ(options.steps, 4);
  EXPECT_FALSE(options.inner.far.has_value());
  EXPECT_EQ(options.rate, 0.1f);
}

TEST(OptionsJson, UnknownKeyNamesTheNearest) {
  EXPECT_EQ(error_of(R"({"setps": 4})"), "run.json: setps: unknown option (did you mean steps?)");
  EXPECT_EQ(error_of(R"({"inner": {"mod": "one"}})"),
            "run.json: inner.mod: unknown option (did you mean mode?)");
  EXPECT_EQ(error_of(R"({"iner": {"mode": "one"}})"),
            "run.json: iner: unknown option (did you mean inner?)");
  EXPECT_NE(error_of(R"({"steps": 4, "qqqqqqq": 1})").find("known: flag, steps"),
            std::string::npos);
}

TEST(OptionsJson, WrongValuesNameTheKey) {
  for (const char* json :
       {R"({"steps": "4"})", R"({"steps": 4.5})", R"({"steps": 11})", R"({"steps": 1e99})",
        R"({"steps": null})", R"({"steps": [4]})", R"({"steps": {"a": 1}})",
        R"({"steps": 18446744073709551615})", R"({"steps": true})"}) {
    const std::string error = error_of(json);
    EXPECT_EQ(error.rfind("run.json: steps: ", 0), 0u) << json << " gave " << error;
  }
  EXPECT_NE(error_of(R"({"inner": {"mode": "three"}})").find("allowed: one, two"),
            std::string::npos);
  EXPECT_NE(error_of(R"({"inner": 3})").find("expected an object"), std::string::npos);
  EXPECT_NE(error_of(R"({"inner": {"far": 0}})"), "");
  EXPECT_NE(error_of(R"({"seed": -1})"), "");
  EXPECT_NE(error_of(R"({"flag": 1})"), "");
  EXPECT_NE(error_of(R"({"text": 1})"), "");
  EXPECT_EQ(error_of(R"({"steps": 7})"), "options: seven is not allowed");
}

TEST(OptionsJson, BrokenTextNamesLineAndColumn) {
  EXPECT_EQ(error_of("{\n  \"steps\": 4,\n  oops\n}").rfind("run.json:3:3: not valid JSON", 0), 0u)
      << error_of("{\n  \"steps\": 4,\n  oops\n}");
  EXPECT_EQ(error_of("[1]"), "run.json: expected an object of options, found an array");
  EXPECT_EQ(error_of(R"({"steps": 4, "steps": 5})"),
            "run.json: key \"steps\" is given twice (remove one of the two)");
  EXPECT_EQ(error_of(R"({"rate": 1e999})"), "run.json: holds a number that is out of range");
  const std::string whole = options_to_json(Options{});
  for (size_t n = 0; n + 2 < whole.size(); ++n) EXPECT_NE(error_of(whole.substr(0, n)), "") << n;
  EXPECT_NE(error_of(std::string(100000, '[')), "");
  EXPECT_NE(error_of("{\"text\": \"\xff\"}"), "");
}

// A file of an earlier version is read where what it asks for is what happens anyway.
TEST(OptionsJson, RetiredOptionsMustChangeNothing) {
  Options options;
  options_from_json(options, R"({"old": false, "old_rate": 0, "steps": 4})", "file");
  EXPECT_EQ(options.steps, 4);
  for (const char* text : {R"({"old": true})", R"({"old_rate": 0.5})", R"({"old": "no"})"}) {
    try {
      options_from_json(options, text, "file");
      FAIL() << text;
    } catch (const Error& error) {
      EXPECT_NE(std::string(error.what()).find("file: old"), std::string::npos) << error.what();
      EXPECT_NE(std::string(error.what()).find("is no more"), std::string::npos) << error.what();
    }
  }
  EXPECT_EQ(options_to_json(options).find("old"), std::string::npos);
}

}  // namespace
}  // namespace nerf
