#include "error_report.h"

#include <fmt/format.h>

#include "nerf/base/error.h"
#include "nerf/base/file.h"

namespace nerf::apps {
namespace {

constexpr const char* kStyle = R"(
body { font: 15px/1.5 "DejaVu Sans", Verdana, Arial, sans-serif; color: #222; background: #fff;
       max-width: 1000px; margin: 2em auto; padding: 0 1em; }
h1 { font-size: 24px; } h2 { font-size: 19px; margin-top: 2.2em; }
svg { max-width: 100%; height: auto; border: 1px solid #ddd; margin: 6px 0; }
details { margin: 8px 0; } summary { cursor: pointer; color: #0060a0; }
.table { overflow-x: auto; }
table { border-collapse: collapse; font-size: 12px; }
td, th { border: 1px solid #ddd; padding: 3px 7px; text-align: right; white-space: nowrap; }
td:first-child, th:first-child, td:last-child, th:last-child { text-align: left; }
td:last-child { font-family: monospace; }
)";

std::string csv_field(const std::string& text) {
  if (text.find_first_of(",\"\n\r") == std::string::npos) return text;
  std::string out = "\"";
  for (const char c : text) out += c == '"' ? std::string("\"\"") : std::string(1, c);
  return out + "\"";
}

std::string csv_line(const std::vector<std::string>& fields) {
  std::string line;
  for (size_t i = 0; i < fields.size(); ++i) {
    if (i > 0) line += ',';
    line += csv_field(fields[i]);
  }
  return line + "\n";
}

std::string html_row(const std::vector<std::string>& fields, const std::string& tag) {
  std::string row = "<tr>";
  for (const std::string& f : fields) row += fmt::format("<{0}>{1}</{0}>", tag, xml_escaped(f));
  return row + "</tr>\n";
}

}  // namespace

std::string csv_text(const ReportTable& table) {
  std::string text = csv_line(table.columns);
  for (const auto& row : table.rows) {
    NERF_CHECK_EQ(row.size(), table.columns.size());
    text += csv_line(row);
  }
  return text;
}

void write_curve(const std::filesystem::path& folder, const ErrorCurve& curve) {
  write_file_atomically(folder / (curve.name + ".csv"), csv_text(curve.table));
  for (const Chart& chart : curve.charts)
    write_file_atomically(folder / (chart.name + ".svg"), svg_text(chart));
}

std::string html_page(const std::vector<ErrorCurve>& curves, const std::string& about) {
  std::string page =
      "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n"
      "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n"
      "<title>Cost against error</title>\n<style>" +
      std::string(kStyle) + "</style>\n</head>\n<body>\n<h1>Cost against error</h1>\n<p>" +
      xml_escaped(about) + "</p>\n";
  for (const ErrorCurve& curve : curves) {
    page +=
        fmt::format("<h2>{}</h2>\n<p>{}</p>\n", xml_escaped(curve.title), xml_escaped(curve.text));
    for (const Chart& chart : curve.charts) page += svg_text(chart);
    page += fmt::format(
        "<details{}><summary>{} rows, also in {}.csv</summary>\n<div class=\"table\"><table>\n",
        curve.table.rows.size() <= 24 ? " open" : "", curve.table.rows.size(), curve.name);
    page += html_row(curve.table.columns, "th");
    for (const auto& row : curve.table.rows) page += html_row(row, "td");
    page += "</table></div></details>\n";
  }
  return page + "</body>\n</html>\n";
}

}  // namespace nerf::apps
