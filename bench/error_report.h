// Curves of cost against error as files: a CSV and SVG charts for each, one HTML page for all.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "chart.h"

namespace nerf::apps {

struct ReportTable {
  std::vector<std::string> columns;
  std::vector<std::vector<std::string>> rows;  // each as long as columns
};

struct ErrorCurve {
  std::string name;  // of its CSV, without .csv
  std::string title;
  std::string text;  // what was measured, and how; one paragraph
  std::vector<Chart> charts;
  ReportTable table;  // the last column is the command that gives the row again
};

// RFC 4180: fields with a comma, a quote or a line break are quoted.
std::string csv_text(const ReportTable& table);

// NAME.csv and each chart's .svg.
void write_curve(const std::filesystem::path& folder, const ErrorCurve& curve);

// One page that needs no other file. `about` says on what machine it was measured.
std::string html_page(const std::vector<ErrorCurve>& curves, const std::string& about);

}  // namespace nerf::apps
