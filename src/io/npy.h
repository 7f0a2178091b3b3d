// Arrays of numbers in NumPy's .npy format, version 1 to 3.
#pragma once

#include <filesystem>
#include <span>
#include <vector>

#include "nerf/base/real.h"

namespace nerf::internal {

struct NpyArray {
  std::vector<size_t> shape;
  std::vector<double> values;  // row by row
  bool integers = false;       // of the file's type
};

// Little-endian floats of 16, 32 and 64 bits and unsigned integers of 16 and 32, in C order. Throws
// Error for anything else, for damaged headers and for files whose length is not that of the array.
NpyArray read_npy(const std::filesystem::path& path);

// Little-endian float32 in version 1, row by row; whole or not at all. Throws Error.
void write_npy(const std::filesystem::path& path, std::span<const size_t> shape,
               std::span<const Real> values);

}  // namespace nerf::internal
