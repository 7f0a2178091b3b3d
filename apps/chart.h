// Charts as SVG: points and lines over two axes, ticks, a legend, on a light ground.
#pragma once

#include <optional>
#include <string>
#include <vector>

namespace nerf::apps {

struct ChartPoint {
  double x = 0, y = 0;
  std::string label;  // beside the point; may be empty
};

struct ChartSeries {
  std::string name;  // in the legend
  std::vector<ChartPoint> points;
  bool line = true;     // joins the points in order
  bool markers = true;  // at each point
};

struct ChartAxis {
  std::string title;
  bool log = false;           // values that are not above 0 are left out
  std::vector<double> ticks;  // empty: chosen
};

struct Chart {
  std::string name;  // of its file, without .svg
  std::string title;
  ChartAxis x, y;
  std::vector<ChartSeries> series;
  std::optional<double> x_mark;  // a dashed line across, e.g. what there is to compare with
  std::string x_mark_label;
};

// A whole SVG document; text in it is escaped.
std::string svg_text(const Chart& chart);

// `text` with what XML and HTML reserve escaped.
std::string xml_escaped(const std::string& text);

// Values at which an axis from low to high is labelled, within it: round ones.
std::vector<double> axis_ticks(double low, double high, bool log);

}  // namespace nerf::apps
