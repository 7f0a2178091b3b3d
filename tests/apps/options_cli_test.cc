#include "options_cli.h"

#include <gtest/gtest.h>

namespace nerf::apps {
namespace {

enum class Mode { kSlow, kFast };
auto option_names(Mode) {
  return std::array{OptionName{Mode::kSlow, "slow"}, OptionName{Mode::kFast, "fast"}};
}

struct Grid {
  int levels = 8;
  bool hashed = true;
  template <class V>
  void visit_options(V& v) {
    v("levels", levels, "resolutions", at_least(1), at_most(32));
    v("hashed", hashed, "hashes indices");
    v.retired("table_kind", int64_t{0});
  }
};

struct Options {
  std::string scene;
  std::string out = "run";
  int downscale = 1;
  double shift = 0;
  std::optional<double> minutes;
  bool depth = true;
  bool quick = false;
  Mode mode = Mode::kSlow;
  std::string lamp;
  Grid grid;
  template <class V>
  void visit_options(V& v) {
    v("scene", scene, "what to train on", positional(), required());
    v("out", out, "folder", short_name('o'), metavar("DIR"));
    v("downscale", downscale, "divides sizes", at_least(1));
    v("shift", shift, "any number");
    v("minutes", minutes, "time", above(0));
    v("depth", depth, "depth pictures");
    v("quick", quick, "less of everything", short_name('q'));
    v("mode", mode, "how");
    v("lamp", lamp, "lights", repeatable());
    v("grid", grid, "grid");
  }
  void check_options() const {
    if (quick && minutes) throw Error("--quick and --minutes exclude each other");
  }
};

struct Parsed {
  Options options;
  CommandLine line;
  std::string error;
};

Parsed parse(std::vector<const char*> arguments) {
  Parsed parsed;
  arguments.insert(arguments.begin(), "program");
  try {
    parsed.line = parse_command_line(static_cast<int>(arguments.size()), arguments.data(),
                                     {"program", "Does things.", ""}, parsed.options);
  } catch (const Error& error) {
    parsed.error = error.what();
  }
  return parsed;
}

TEST(OptionsCli, SetsWhatIsGiven) {
  const Parsed p = parse({"lego", "-o", "there", "--downscale=4", "--shift", "-1.5", "--minutes",
                          "2.5", "--no-depth", "--grid-levels", "12", "--mode", "fast"});
  EXPECT_EQ(p.error, "");
  EXPECT_FALSE(p.line.exit);
  EXPECT_EQ(p.options.scene, "lego");
  EXPECT_EQ(p.options.out, "there");
  EXPECT_EQ(p.options.downscale, 4);
  EXPECT_EQ(p.options.shift, -1.5);
  EXPECT_EQ(p.options.minutes, 2.5);
  EXPECT_FALSE(p.options.depth);
  EXPECT_FALSE(p.options.quick);
  EXPECT_EQ(p.options.grid.levels, 12);
  EXPECT_TRUE(p.options.grid.hashed);
  EXPECT_EQ(p.options.mode, Mode::kFast);
  EXPECT_EQ(p.line.given, (std::set<std::string>{"scene", "out", "downscale", "shift", "minutes",
                                                 "depth", "grid.levels", "mode"}));
}

TEST(OptionsCli, ShortFormsAndFlags) {
  const Parsed p = parse({"-q", "-othere", "--depth", "--", "--odd-name"});
  EXPECT_EQ(p.error, "");
  EXPECT_TRUE(p.options.quick);
  EXPECT_TRUE(p.options.depth);
  EXPECT_EQ(p.options.out, "there");
  EXPECT_EQ(p.options.scene, "--odd-name");
}

TEST(OptionsCli, OptionsOfEarlierVersionsAreSaidToBeNoMore) {
  EXPECT_EQ(parse({"lego", "--grid-table-kind", "0"}).error,
            "--grid-table-kind is no more (leave it out)");
  EXPECT_EQ(parse({"lego", "--grid-table-kind=1"}).error,
            "--grid-table-kind is no more (leave it out)");
}

TEST(OptionsCli, UnknownOptionsNameTheNearest) {
  EXPECT_EQ(parse({"lego", "--donwscale", "2"}).error,
            "unknown option --donwscale (did you mean --downscale?)");
  EXPECT_EQ(parse({"--donwscale", "2"}).error,
            "unknown option --donwscale (did you mean --downscale?)")
      << "before the missing scene is complained about";
  EXPECT_EQ(parse({"lego", "--grid_levels=3"}).error,
            "unknown option --grid_levels (did you mean --grid-levels?)");
  EXPECT_EQ(parse({"lego", "-out", "x"}).options.out, "ut") << "-o with its value attached";
  EXPECT_EQ(parse({"lego", "-minutes", "3"}).error,
            "unknown option -minutes (did you mean --minutes?)");
  EXPECT_EQ(parse({"lego", "--xyzzy-plugh"}).error,
            "unknown option --xyzzy-plugh (--help lists the options)");
  EXPECT_EQ(parse({"lego", "--no-dept"}).error,
            "unknown option --no-dept (did you mean --no-depth?)");
}

TEST(OptionsCli, ValuesAreChecked) {
  EXPECT_EQ(parse({"lego", "--downscale", "0"}).error,
            "--downscale: '0' is not allowed (allowed: an integer, at least 1)");
  EXPECT_EQ(parse({"lego", "--downscale", "two"}).error,
            "--downscale: 'two' is not allowed (allowed: an integer, at least 1)");
  EXPECT_EQ(parse({"lego", "--mode", "fats"}).error,
            "--mode: 'fats' is not allowed (did you mean fast? allowed: slow, fast)");
  EXPECT_EQ(parse({"lego", "--downscale"}).error,
            "--downscale needs a value (an integer, at least 1)");
  EXPECT_EQ(parse({"lego", "--downscale", "2", "--downscale=3"}).error,
            "--downscale is given twice (remove one of the two)");
  EXPECT_EQ(parse({"lego", "-o", "a", "--out", "b"}).error,
            "--out is given twice (remove one of the two)");
  EXPECT_EQ(parse({"--lamp", "1,2", "lego", "--lamp=-3,4"}).options.lamp, "1,2 -3,4");
  EXPECT_EQ(parse({"--lamp", "1,2", "lego", "--lamp=-3,4"}).options.scene, "lego");
  EXPECT_EQ(parse({"lego", "--lamp"}).error.substr(0, 20), "--lamp needs a value");
  EXPECT_EQ(parse({}).error, "SCENE is missing (what to train on)");
  EXPECT_NE(parse({"lego", "fern"}).error.find("fern"), std::string::npos);
  EXPECT_EQ(parse({"lego", "--depth", "--no-depth"}).error,
            "--depth and --no-depth are both given (remove one of the two)");
  EXPECT_EQ(parse({"lego", "-q", "--minutes", "1"}).error,
            "--quick and --minutes exclude each other");
}

TEST(OptionsCli, HelpNamesEverythingAndLeaves) {
  testing::internal::CaptureStdout();
  const Parsed p = parse({"--help"});
  const std::string help = testing::internal::GetCapturedStdout();
  EXPECT_TRUE(p.line.exit);
  EXPECT_EQ(p.error, "") << "no complaint about the missing scene";
  for (const char* part :
       {"Does things.", "-o,--out DIR", "folder [run]", "--downscale N",
        "divides sizes (an integer, at least 1) [1]", "depth pictures [on; --no-depth turns it",
        "less of everything [off]", "--mode NAME", "how (slow, fast) [slow]", "--grid-levels N",
        "Usage: program [OPTIONS] SCENE", "what to train on", "--version"})
    EXPECT_NE(help.find(part), std::string::npos) << "lacks: " << part << "\n" << help;
}

TEST(OptionsCli, VersionIsPrinted) {
  testing::internal::CaptureStdout();
  EXPECT_TRUE(parse({"--version"}).line.exit);
  EXPECT_EQ(testing::internal::GetCapturedStdout().rfind("program 0.", 0), 0u);
}

}  // namespace
}  // namespace nerf::apps
