// Memory of this process.
#pragma once

#include <cstdint>

namespace nerf {

// Bytes of memory this process may use: the smallest of the machine's physical memory, the limits
// of its cgroup and the cgroups above it (v1 or v2), and its address-space limit (ulimit -v).
uint64_t available_memory_bytes();

// Highest resident set of this process so far, in bytes.
uint64_t peak_memory_bytes();

}  // namespace nerf
