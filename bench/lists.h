// Lists of numbers separated by commas, as values of options.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace nerf::apps {

std::vector<std::string> parts_of(const std::string& list);

// Finite numbers above 0. Throws Error naming `flag` and the part that is none.
std::vector<double> positive_numbers(const std::string& list, const std::string& flag,
                                     const std::string& example);

// Whole numbers from low to high; the same.
std::vector<uint64_t> whole_numbers(const std::string& list, uint64_t low, uint64_t high,
                                    const std::string& flag, const std::string& example);

}  // namespace nerf::apps
