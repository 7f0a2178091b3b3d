// A request to stop, shared between the thread that asks (a signal handler may) and the one that
// works. The worker polls it between steps and throws Cancelled or returns early.
#pragma once

#include <atomic>

namespace nerf {

class Cancel {
 public:
  void request() noexcept { requested_.store(true, std::memory_order_relaxed); }
  bool requested() const noexcept { return requested_.load(std::memory_order_relaxed); }

 private:
  std::atomic<bool> requested_{false};
};

}  // namespace nerf
