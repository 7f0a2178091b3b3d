// Suggestions for misspelt names: of options, keys, methods, files' fields.
#pragma once

#include <optional>
#include <span>
#include <string>
#include <string_view>

namespace nerf {

// Number of single-character insertions, deletions, substitutions and swaps of neighbours that turn
// `a` into `b` (the optimal string alignment distance). Letters' case, and '-' against '_', count
// as equal.
int edit_distance(std::string_view a, std::string_view b);

// The candidate with the smallest edit distance to `word` (the first of equals), if that distance
// is small enough for a typing mistake: at most 2, or a third of the word's length where that is
// more. A candidate that starts with `word` also counts. Empty where nothing is near.
std::optional<std::string> nearest_name(std::string_view word,
                                        std::span<const std::string> candidates);

// A hint for Error: "did you mean <name>?" where there is a near one, else "known: a, b, c" (cut
// after a dozen). Empty without candidates.
std::string nearest_name_hint(std::string_view word, std::span<const std::string> candidates);

}  // namespace nerf
