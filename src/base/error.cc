#include "nerf/base/error.h"

namespace nerf::internal {

void check_failed(const char* file, int line, const char* expression, const std::string& values) {
  std::ostringstream s;
  s << file << ":" << line << ": check failed: " << expression;
  if (!values.empty()) s << " (" << values << ")";
  throw std::logic_error(s.str());
}

}  // namespace nerf::internal
