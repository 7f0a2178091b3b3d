#include "lenient_json.h"

#include <cmath>
#include <string_view>

#include "colmap.h"
#include "nerf/base/file.h"

namespace nerf::internal {

using nlohmann::json;

namespace {

constexpr const char* kNan = "NaN";
constexpr const char* kInfinity = "Infinity";

bool is_letter(char c) { return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z'); }

// Replaces bare words outside texts that stand for such a number, with a sign before them.
std::string with_texts_for_nan(std::string_view in) {
  std::string out;
  out.reserve(in.size());
  bool in_text = false;
  for (size_t i = 0; i < in.size();) {
    const char c = in[i];
    if (in_text || c == '"') {
      if (c == '"') in_text = !in_text;
      const size_t step = in_text && c == '\\' && i + 1 < in.size() ? 2 : 1;
      out.append(in.substr(i, step));
      i += step;
      continue;
    }
    const size_t start = c == '-' || c == '+' ? i + 1 : i;
    size_t end = start;
    while (end < in.size() && is_letter(in[end])) ++end;
    std::string word;
    for (const char letter : in.substr(start, end - start))
      word += static_cast<char>(letter | 0x20);
    if (word == "nan" || word == "inf" || word == "infinity") {
      for (const std::string_view kind : {"(ind)", "(snan)"})
        if (in.substr(end).starts_with(kind)) end += kind.size();
      out += '"';
      out += word == "nan" ? kNan : kInfinity;
      out += '"';
    } else {
      end = std::max(end, i + 1);
      out.append(in.substr(i, end - i));
    }
    i = end;
  }
  return out;
}

}  // namespace

json read_lenient_json(const std::filesystem::path& file) {
  const std::string text = read_text_file(file, uint64_t{256} << 20);
  std::string problem;
  try {
    return json::parse(text);
  } catch (const json::exception& e) {
    problem = e.what();
  }
  json value = json::parse(with_texts_for_nan(text), nullptr, /*allow_exceptions=*/false);
  if (!value.is_discarded()) return value;
  // "[json.exception.parse_error.101] parse error at line 3, column 5: ..."
  if (const size_t end = problem.find("] "); end != problem.npos) problem = problem.substr(end + 2);
  throw Error(printable(problem), file.string(), "not a JSON file, or cut off");
}

bool is_not_finite(const json& value) {
  if (value.is_number_float()) return !std::isfinite(value.get<double>());
  if (!value.is_string()) return false;
  const auto& text = value.get_ref<const std::string&>();
  return text == kNan || text == kInfinity;
}

}  // namespace nerf::internal
