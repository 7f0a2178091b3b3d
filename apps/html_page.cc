#include "html_page.h"

#include <fmt/format.h>

#include "chart.h"
#include "report_assets.h"

namespace nerf::apps {
namespace {

std::string html_row(const std::vector<std::string>& fields, const std::string& tag) {
  std::string row = "<tr>";
  for (const std::string& f : fields) row += fmt::format("<{0}>{1}</{0}>", tag, xml_escaped(f));
  return row + "</tr>\n";
}

}  // namespace

std::string html_document(const HtmlPage& page) {
  std::string text =
      "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n"
      "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n"
      "<meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; img-src data:; "
      "style-src 'unsafe-inline'; script-src 'unsafe-inline'\">\n<title>" +
      xml_escaped(page.title) + "</title>\n<style>\n" + kPageStyle +
      "</style>\n</head>\n<body>\n<h1>" + xml_escaped(page.title) + "</h1>\n" + page.body;
  if (!page.script.empty()) text += "<script>\n" + page.script + "</script>\n";
  return text + "</body>\n</html>\n";
}

std::string html_table(const std::vector<std::string>& columns,
                       const std::vector<std::vector<std::string>>& rows,
                       const std::string& style_class) {
  std::string text = style_class.empty()
                         ? std::string("<div class=\"table\"><table>\n")
                         : fmt::format("<div class=\"table\"><table class=\"{}\">\n", style_class);
  if (!columns.empty()) text += html_row(columns, "th");
  for (const auto& row : rows) text += html_row(row, "td");
  return text + "</table></div>\n";
}

std::string html_data(const std::string& id, const std::string& json) {
  std::string text = fmt::format("<script type=\"application/json\" id=\"{}\">", id);
  // In JSON these characters stand in strings alone.
  for (const char c : json) {
    if (c == '<' || c == '>' || c == '&')
      text += fmt::format("\\u{:04x}", static_cast<unsigned>(c));
    else
      text += c;
  }
  return text + "</script>\n";
}

std::string base64(std::span<const uint8_t> bytes) {
  static constexpr char kDigits[] =
      "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string text;
  text.reserve((bytes.size() + 2) / 3 * 4);
  for (size_t i = 0; i < bytes.size(); i += 3) {
    const auto at = [&](size_t k) -> uint32_t { return i + k < bytes.size() ? bytes[i + k] : 0; };
    const uint32_t group = at(0) << 16 | at(1) << 8 | at(2);
    for (size_t k = 0; k < 4; ++k)
      text += i + k <= bytes.size() ? kDigits[group >> (18 - 6 * k) & 63] : '=';
  }
  return text;
}

std::string jpeg_url(std::span<const uint8_t> bytes) {
  return "data:image/jpeg;base64," + base64(bytes);
}

}  // namespace nerf::apps
