// A file that a program will write when its work is done.
#pragma once

#include <filesystem>
#include <vector>

namespace nerf::apps {

// Finds what would make the file fail before the work, and makes its folder. Once this goes, the
// folders that it has made go too, unless there is something in them.
class TargetFile {
 public:
  // Throws Error where `file` is a folder, or its folder cannot be made or written into.
  explicit TargetFile(const std::filesystem::path& file);
  ~TargetFile();
  TargetFile(const TargetFile&) = delete;
  TargetFile& operator=(const TargetFile&) = delete;

 private:
  void clear();

  std::vector<std::filesystem::path> made_;  // the innermost first
};

}  // namespace nerf::apps
