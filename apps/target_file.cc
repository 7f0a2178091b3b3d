#include "target_file.h"

#include "nerf/base/error.h"
#include "nerf/base/file.h"

namespace nerf::apps {

TargetFile::TargetFile(const std::filesystem::path& file) {
  std::error_code unknown;
  if (std::filesystem::is_directory(file, unknown)) throw Error("this is a folder", file.string());
  const auto folder = file.parent_path();
  for (auto at = folder; !at.empty() && !std::filesystem::exists(at, unknown) && !unknown;
       at = at.parent_path())
    made_.push_back(at);
  try {
    make_writable_folder(folder.empty() ? "." : folder);
  } catch (...) {
    clear();
    throw;
  }
}

TargetFile::~TargetFile() { clear(); }

void TargetFile::clear() {
  std::error_code not_empty;
  for (const auto& folder : made_)
    if (std::filesystem::is_directory(folder, not_empty))
      std::filesystem::remove(folder, not_empty);
}

}  // namespace nerf::apps
