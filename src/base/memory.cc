// Limits come from the system, the process and its control groups.
#include "nerf/base/memory.h"

#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <charconv>
#include <fstream>
#include <functional>
#include <limits>
#include <string>
#include <string_view>

#include "cgroup.h"

namespace nerf {
namespace {

namespace fs = std::filesystem;

// One number in a file; no value where it is missing or says "max".
std::optional<uint64_t> read_limit(const fs::path& path) {
  std::ifstream in(path);
  std::string word;
  if (!(in >> word)) return std::nullopt;
  uint64_t value = 0;
  const auto [end, failed] = std::from_chars(word.data(), word.data() + word.size(), value);
  if (failed != std::errc() || end != word.data() + word.size() || value == 0) return std::nullopt;
  // v1 writes "unlimited" as the largest multiple of a page.
  if (value > std::numeric_limits<int64_t>::max() / 2) return std::nullopt;
  return value;
}

void take_smaller(std::optional<uint64_t>& limit, std::optional<uint64_t> other) {
  if (other && (!limit || *other < *limit)) limit = other;
}

// Controllers of a v1 line are separated by commas: "memory" or "cpu,cpuacct".
bool lists(std::string_view controllers, std::string_view wanted) {
  while (!controllers.empty()) {
    const size_t comma = std::min(controllers.find(','), controllers.size());
    if (controllers.substr(0, comma) == wanted) return true;
    controllers.remove_prefix(std::min(comma + 1, controllers.size()));
  }
  return false;
}

// Calls visit_v2 or visit_v1 for the folder of every group of this process that a controller has.
// Within a container the named folder may lie outside of the mount; its root then is the
// container's own group, so every level up to the root is visited.
void visit_groups(const fs::path& proc_cgroup, const fs::path& mount, const char* controller,
                  const std::function<void(const fs::path&)>& visit_v2,
                  const std::function<void(const fs::path&)>& visit_v1) {
  const auto walk = [](const fs::path& root, const fs::path& below, const auto& visit) {
    for (fs::path group = below.relative_path();; group = group.parent_path()) {
      visit(root / group);
      if (group.empty()) return;
    }
  };
  std::ifstream in(proc_cgroup);
  for (std::string line; std::getline(in, line);) {
    // "<id>:<controllers>:<path>"; v2's line has id 0 and no controllers.
    const size_t first = line.find(':');
    if (first == std::string::npos) continue;
    const size_t second = line.find(':', first + 1);
    if (second == std::string::npos) continue;
    const std::string controllers = line.substr(first + 1, second - first - 1);
    const fs::path group = fs::path(line.substr(second + 1)).lexically_normal();
    if (controllers.empty()) {
      walk(mount, group, visit_v2);
      walk(mount / "unified", group, visit_v2);
    } else if (lists(controllers, controller)) {
      walk(mount / controller, group, visit_v1);
    }
  }
}

// "200000 100000" or "max 100000": processors, or no value.
std::optional<double> read_quota(const fs::path& path) {
  std::ifstream in(path);
  double quota = 0, period = 0;
  if (!(in >> quota >> period) || !(quota > 0) || !(period > 0)) return std::nullopt;
  return quota / period;
}

}  // namespace

namespace internal {

std::optional<uint64_t> cgroup_memory_limit(const fs::path& proc_cgroup, const fs::path& mount) {
  std::optional<uint64_t> limit;
  visit_groups(
      proc_cgroup, mount, "memory",
      [&](const fs::path& group) {
        take_smaller(limit, read_limit(group / "memory.max"));
        take_smaller(limit, read_limit(group / "memory.high"));
      },
      [&](const fs::path& group) {
        take_smaller(limit, read_limit(group / "memory.limit_in_bytes"));
      });
  return limit;
}

std::optional<int> cgroup_cpu_limit(const fs::path& proc_cgroup, const fs::path& mount) {
  std::optional<double> limit;
  const auto take = [&](std::optional<double> quota) {
    if (quota && (!limit || *quota < *limit)) limit = quota;
  };
  visit_groups(
      proc_cgroup, mount, "cpu",
      [&](const fs::path& group) { take(read_quota(group / "cpu.max")); },
      [&](const fs::path& group) {
        const auto quota = read_limit(group / "cpu.cfs_quota_us");  // -1: none
        const auto period = read_limit(group / "cpu.cfs_period_us");
        if (quota && period) take(static_cast<double>(*quota) / static_cast<double>(*period));
      });
  if (!limit) return std::nullopt;
  return std::max(1, static_cast<int>(std::min(*limit, 1e6) + 0.5));
}

}  // namespace internal

uint64_t available_memory_bytes() {
  const long pages = ::sysconf(_SC_PHYS_PAGES);
  const long page = ::sysconf(_SC_PAGESIZE);
  uint64_t bytes = std::numeric_limits<uint64_t>::max();
  if (pages > 0 && page > 0) bytes = static_cast<uint64_t>(pages) * static_cast<uint64_t>(page);
  if (const auto limit = internal::cgroup_memory_limit("/proc/self/cgroup", "/sys/fs/cgroup")) {
    bytes = std::min(bytes, *limit);
  }
  rlimit address_space;
  if (::getrlimit(RLIMIT_AS, &address_space) == 0 && address_space.rlim_cur != RLIM_INFINITY) {
    bytes = std::min(bytes, static_cast<uint64_t>(address_space.rlim_cur));
  }
  return bytes;
}

uint64_t peak_memory_bytes() {
  // getrusage's figure survives exec, so it may be that of the program that started this one.
  std::ifstream in("/proc/self/status");
  for (std::string line; std::getline(in, line);) {
    if (!line.starts_with("VmHWM:")) continue;
    uint64_t kilobytes = 0;
    const size_t digit = line.find_first_of("0123456789");
    if (digit == std::string::npos) break;
    std::from_chars(line.data() + digit, line.data() + line.size(), kilobytes);
    return kilobytes * 1024;
  }
  rusage usage;
  if (::getrusage(RUSAGE_SELF, &usage) != 0) return 0;
  return static_cast<uint64_t>(usage.ru_maxrss) * 1024;
}

}  // namespace nerf
