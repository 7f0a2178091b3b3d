#include "error_report.h"

#include <fmt/format.h>

#include "html_page.h"
#include "nerf/base/error.h"
#include "nerf/base/file.h"

namespace nerf::apps {
namespace {

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
  std::string body = "<p>" + xml_escaped(about) + "</p>\n";
  for (const ErrorCurve& curve : curves) {
    body +=
        fmt::format("<h2>{}</h2>\n<p>{}</p>\n", xml_escaped(curve.title), xml_escaped(curve.text));
    for (const Chart& chart : curve.charts) body += svg_text(chart);
    body += fmt::format("<details{}><summary>{} rows, also in {}.csv</summary>\n",
                        curve.table.rows.size() <= 24 ? " open" : "", curve.table.rows.size(),
                        curve.name);
    body += html_table(curve.table.columns, curve.table.rows) + "</details>\n";
  }
  return html_document({"Cost against error", body});
}

}  // namespace nerf::apps
