#include "nerf/base/aligned.h"

#include <sys/mman.h>

#include <cstdlib>
#include <cstring>
#include <new>

namespace nerf::internal {

// From here on pages come straight from the operating system: zero on first touch.
constexpr size_t kMapFrom = size_t{1} << 21;

void* aligned_allocate_zeroed(size_t bytes) {
  if (bytes == 0) return nullptr;
  if (bytes >= kMapFrom) {
    void* p = mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    if (p == MAP_FAILED) throw std::bad_alloc();
#if defined(MADV_HUGEPAGE)
    madvise(p, bytes, MADV_HUGEPAGE);
#endif
    return p;
  }
  void* p = std::aligned_alloc(64, (bytes + 63) / 64 * 64);
  if (!p) throw std::bad_alloc();
  std::memset(p, 0, bytes);
  return p;
}

void aligned_free(void* p, size_t bytes) {
  if (!p) return;
  if (bytes >= kMapFrom)
    munmap(p, bytes);
  else
    std::free(p);
}

}  // namespace nerf::internal
