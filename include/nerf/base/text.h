// Small helpers for text that people read and write.
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <string_view>

namespace nerf {

// "line:column" of a byte of `text`, both from 1, for messages about text files. A byte behind the
// end counts as the end.
std::string line_and_column(std::string_view text, size_t byte);

// Order of names with numbers in them as people count: img2 before img10. Runs of digits compare by
// value, everything else bytewise; equal values by the number of leading zeros.
bool natural_less(std::string_view a, std::string_view b);

// A number from `least` to `most` and nothing else; no value for other text.
std::optional<double> number_in(std::string_view text, double least, double most);

// The first characters of UTF-8 text, at most `bytes` long; a character is left out rather than
// cut.
std::string shortened(std::string text, size_t bytes);

// File systems take 255 bytes; a name must leave room for an ending and for what a temporary file
// adds.
inline constexpr size_t kLongestFileStem = 200;

}  // namespace nerf
