// For tests: .npy files as numpy.save writes them.
#pragma once

#include <fmt/format.h>

#include <string>
#include <vector>

#include "test_scenes.h"

namespace nerf::test {

inline std::vector<char> npy_bytes(const std::string& type, const std::string& shape,
                                   const std::vector<double>& values, const char* order = "False") {
  std::string header =
      fmt::format("{{'descr': '{}', 'fortran_order': {}, 'shape': {}, }}", type, order, shape);
  header.resize((header.size() + 10 + 1 + 63) / 64 * 64 - 11, ' ');
  header += '\n';
  ByteWriter out;
  for (const char c : std::string("\x93NUMPY\x01")) out.put(c);
  out.put(uint8_t{0});
  out.put(static_cast<uint16_t>(header.size()));
  for (const char c : header) out.put(c);
  for (const double v : values) {
    if (type == "<f4")
      out.put(static_cast<float>(v));
    else
      out.put(v);
  }
  return out.bytes();
}

}  // namespace nerf::test
