// The middle of some numbers.
#pragma once

#include <algorithm>
#include <vector>

namespace nerf {

// Of two in the middle the greater. 0 where there are none.
inline double median_of(std::vector<double> values) {
  if (values.empty()) return 0;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::ranges::nth_element(values, middle);
  return *middle;
}

}  // namespace nerf
