// Which file a capture means by an image's name, where files were moved, converted or renamed
// since.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace nerf::internal {

struct FoundImage {
  enum class How { kAsNamed, kByTail, kByStem };
  std::filesystem::path path;  // empty where there is no such file
  std::string name;            // clean, below the folder, without an extension added
  How how = How::kAsNamed;
};

// Looks for every name below the folder, in this order:
// - as it is, with backslashes as separators too, with an image's extension added;
// - by its longest tail that exists: an absolute path of another computer;
// - under another extension or in other letter case, where only one file fits.
// A file that two names would lead to in such ways is none of them. `notes` gets lines for a person
// on what was found by another name.
std::vector<FoundImage> find_images(const std::filesystem::path& folder,
                                    const std::vector<std::string>& names,
                                    std::vector<std::string>* notes = nullptr);

// How many of the names find_images() would find as they are, which asks the disk far less.
size_t count_as_named(const std::filesystem::path& folder, const std::vector<std::string>& names);

}  // namespace nerf::internal
