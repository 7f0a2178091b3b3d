// What the control groups of this process allow it. The two paths are arguments for the tests.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>

namespace nerf::internal {

// Smallest memory limit, in bytes, of the cgroup that `proc_cgroup` (/proc/self/cgroup) names and
// of those above it, below `mount` (/sys/fs/cgroup): v2's memory.max and memory.high, v1's
// memory.limit_in_bytes. No value where nothing limits.
std::optional<uint64_t> cgroup_memory_limit(const std::filesystem::path& proc_cgroup,
                                            const std::filesystem::path& mount);

// Smallest number of processors that the same groups grant, rounded to the nearest whole one and at
// least 1: v2's cpu.max, v1's cpu.cfs_quota_us over cpu.cfs_period_us.
std::optional<int> cgroup_cpu_limit(const std::filesystem::path& proc_cgroup,
                                    const std::filesystem::path& mount);

}  // namespace nerf::internal
