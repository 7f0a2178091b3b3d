// Charts as SVG, whatever they show.
#include "chart.h"

#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include "svg.h"

namespace nerf {
namespace {

using testing_apps::expect_svg;
using testing_apps::TempFolder;

TEST(Chart, TicksAreRoundAndWithinTheAxis) {
  using apps::axis_ticks;
  EXPECT_EQ(axis_ticks(0, 10, false), (std::vector<double>{0, 2, 4, 6, 8, 10}));
  EXPECT_EQ(axis_ticks(-1, 1, false), (std::vector<double>{-1, -0.5, 0, 0.5, 1}));
  EXPECT_EQ(axis_ticks(1, 1000, true), (std::vector<double>{1, 10, 100, 1000}));
  for (const bool log : {false, true})
    for (const auto& [low, high] :
         {std::pair{3.0, 3.3}, {0.012, 950.0}, {1e-9, 1e6}, {7.0, 60.0}}) {
      const std::vector<double> ticks = axis_ticks(low, high, log);
      EXPECT_GE(ticks.size(), 2u) << low << ' ' << high;
      EXPECT_LE(ticks.size(), 12u) << low << ' ' << high;
      for (const double t : ticks) EXPECT_TRUE(t >= low && t <= high * (1 + 1e-9)) << t;
    }
}

TEST(Chart, DrawsWhateverTheValuesAre) {
  TempFolder folder;
  apps::Chart chart;
  chart.title = "a < b & \"c\"";
  chart.x.log = chart.y.log = true;
  const auto drawn = [&] {
    testing_apps::write_text(folder.path() / "chart.svg", apps::svg_text(chart));
    expect_svg(folder.path() / "chart.svg");
    return apps::svg_text(chart);
  };
  EXPECT_NE(drawn().find("a &lt; b &amp; &quot;c&quot;"), std::string::npos);
  chart.series = {{"empty", {}, true}, {"one", {{5, 5, "<label>"}}, true}};
  EXPECT_NE(drawn().find("&lt;label&gt;"), std::string::npos);
  // However many series there are.
  chart.series.assign(40, {"one of many", {{5, 5, ""}}, true});
  drawn();
  // Values that a logarithm has no place for are left out, the others drawn.
  chart.series = {{"some", {{0, 1, ""}, {1, 0, ""}, {2, 3, ""}, {4, NAN, ""}, {8, 1, ""}}, true}};
  drawn();
  chart.x.log = chart.y.log = false;
  drawn();
}

}  // namespace
}  // namespace nerf
