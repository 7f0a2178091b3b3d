#include "nerf/base/nearest_name.h"

#include <algorithm>
#include <cctype>
#include <vector>

namespace nerf {
namespace {

char folded(char c) {
  return c == '_' ? '-' : static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
}

bool starts_with_folded(std::string_view name, std::string_view prefix) {
  if (prefix.size() > name.size()) return false;
  return std::equal(prefix.begin(), prefix.end(), name.begin(),
                    [](char a, char b) { return folded(a) == folded(b); });
}

}  // namespace

int edit_distance(std::string_view a, std::string_view b) {
  // Rows i - 2, i - 1 and i of the table of distances between prefixes a[0, i) and b[0, j).
  std::vector<int> before(b.size() + 1), previous(b.size() + 1), current(b.size() + 1);
  for (size_t j = 0; j <= b.size(); ++j) previous[j] = static_cast<int>(j);
  for (size_t i = 1; i <= a.size(); ++i) {
    current[0] = static_cast<int>(i);
    for (size_t j = 1; j <= b.size(); ++j) {
      const char x = folded(a[i - 1]), y = folded(b[j - 1]);
      current[j] = std::min({previous[j] + 1, current[j - 1] + 1, previous[j - 1] + (x != y)});
      if (i > 1 && j > 1 && x == folded(b[j - 2]) && folded(a[i - 2]) == y)
        current[j] = std::min(current[j], before[j - 2] + 1);
    }
    std::swap(before, previous);
    std::swap(previous, current);
  }
  return previous[b.size()];
}

std::optional<std::string> nearest_name(std::string_view word,
                                        std::span<const std::string> candidates) {
  // A word of absurd length is no typing mistake, and the table above is quadratic.
  constexpr size_t kLongest = 200;
  if (word.empty() || word.size() > kLongest) return std::nullopt;
  const int near = std::max(2, static_cast<int>(word.size()) / 3);
  const std::string* best = nullptr;
  int best_distance = near + 1;
  for (const std::string& name : candidates) {
    if (name.size() > kLongest) continue;
    const int distance = edit_distance(word, name);
    // Two changes turn any two letters into any others: as many as the word is long say nothing.
    if (distance >= static_cast<int>(std::max(word.size(), name.size()))) continue;
    if (distance < best_distance) {
      best = &name;
      best_distance = distance;
    }
  }
  if (best) return *best;
  for (const std::string& name : candidates)
    if (word.size() >= 2 && starts_with_folded(name, word)) return name;
  return std::nullopt;
}

std::string nearest_name_hint(std::string_view word, std::span<const std::string> candidates) {
  if (const auto name = nearest_name(word, candidates)) return "did you mean " + *name + "?";
  if (candidates.empty()) return "";
  constexpr size_t kShown = 12;
  std::string list = "known: ";
  for (size_t i = 0; i < std::min(kShown, candidates.size()); ++i) {
    if (i > 0) list += ", ";
    list += candidates[i];
  }
  if (candidates.size() > kShown) list += ", ...";
  return list;
}

}  // namespace nerf
