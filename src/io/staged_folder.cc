#include "staged_folder.h"

#include "nerf/base/error.h"
#include "nerf/base/file.h"
#include "paths.h"

namespace nerf::internal {

namespace fs = std::filesystem;

namespace {

fs::path with_suffix(fs::path path, const char* suffix) { return path += suffix; }

// Beside the folder, so that the folder holds its content only.
fs::path key_file(const fs::path& folder) { return with_suffix(folder, ".key"); }

void clear_away(const fs::path& path) {
  std::error_code failed;
  fs::remove_all(path, failed);
  if (failed) throw errno_error(failed.value(), "cannot remove", path);
}

}  // namespace

StagedFolder::StagedFolder(const fs::path& final_path)
    : final_(final_path), staged_(with_suffix(final_path, ".partial")) {
  clear_away(staged_);
  make_writable_folder(staged_);
}

StagedFolder::~StagedFolder() {
  std::error_code ignored;
  if (!committed_) fs::remove_all(staged_, ignored);
}

void StagedFolder::commit(const std::string& key) {
  // The key goes first and comes last: a folder with a key is complete.
  clear_away(key_file(final_));
  clear_away(final_);
  std::error_code failed;
  fs::rename(staged_, final_, failed);
  if (failed) throw errno_error(failed.value(), "cannot write", final_);
  committed_ = true;
  write_file_atomically(key_file(final_), key);
}

bool StagedFolder::is_complete(const fs::path& final_path, const std::string& key) {
  if (!is_folder(final_path) || !is_file(key_file(final_path))) return false;
  return read_text_file(key_file(final_path)) == key;
}

}  // namespace nerf::internal
