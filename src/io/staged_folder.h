// A folder that appears when its content is complete, or not at all.
#pragma once

#include <filesystem>
#include <string>

namespace nerf::internal {

// Content is made in path() and moved to the final place by commit(); without a commit it is
// removed. A key written beside the content tells later runs what it was made from.
class StagedFolder {
 public:
  // Removes what an interrupted run left.
  explicit StagedFolder(const std::filesystem::path& final_path);
  ~StagedFolder();
  StagedFolder(const StagedFolder&) = delete;
  StagedFolder& operator=(const StagedFolder&) = delete;

  const std::filesystem::path& path() const { return staged_; }
  void commit(const std::string& key);

  // Whether a complete folder made from the same key stands at `final_path`.
  static bool is_complete(const std::filesystem::path& final_path, const std::string& key);

 private:
  std::filesystem::path final_, staged_;
  bool committed_ = false;
};

}  // namespace nerf::internal
