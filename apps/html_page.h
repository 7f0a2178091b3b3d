// Pages that need no other file and no network: HTML with its style, pictures and scripts inside.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

namespace nerf::apps {

struct HtmlPage {
  std::string title;        // escaped where it is put in
  std::string body;         // HTML
  std::string script = {};  // JavaScript, run when the body stands
};

// The whole document, on a light or a dark ground as the reader's system has it. The page is told
// not to load anything (Content-Security-Policy).
std::string html_document(const HtmlPage& page);

// A table whose cells are text, escaped here; wider than the screen it scrolls by itself.
std::string html_table(const std::vector<std::string>& columns,
                       const std::vector<std::vector<std::string>>& rows,
                       const std::string& style_class = {});

// <script type="application/json" id="ID"> with the JSON text: nothing in it can end the element.
std::string html_data(const std::string& id, const std::string& json);

// RFC 4648, with padding.
std::string base64(std::span<const uint8_t> bytes);

// "data:image/jpeg;base64,...".
std::string jpeg_url(std::span<const uint8_t> bytes);

}  // namespace nerf::apps
