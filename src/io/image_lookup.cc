#include "image_lookup.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <set>

#include "colmap.h"
#include "paths.h"
#include "scene_input.h"

namespace nerf::internal {

namespace fs = std::filesystem;

namespace {

std::string small_letters(std::string text) {
  for (char& c : text)
    if (c >= 'A' && c <= 'Z') c = static_cast<char>(c - 'A' + 'a');
  return text;
}

// A drive's letter at the front is no folder's name.
std::string without_drive(const std::string& name) {
  const bool drive = name.size() > 1 && name[1] == ':';
  return drive ? name.substr(2) : name;
}

fs::path with_extension(const fs::path& path) {
  for (const char* extension :
       {"", ".png", ".jpg", ".jpeg", ".PNG", ".JPG", ".JPEG", ".webp", ".exr", ".tif"}) {
    fs::path whole = path;
    whole += extension;
    if (is_file(whole)) return whole;
  }
  return {};
}

using How = FoundImage::How;

class Lookup {
 public:
  explicit Lookup(fs::path folder) : folder_(std::move(folder)) {}
  FoundImage find(const std::string& name);

 private:
  FoundImage find_tail(const std::string& forward, bool by_stem);
  fs::path only_of_stem(const fs::path& path);

  fs::path folder_;
  // Image files of a folder, by their name without extension in small letters.
  std::map<fs::path, std::multimap<std::string, fs::path>> folders_;
};

// Of files "a.png" and "A.jpg", "a.jpeg" means neither.
fs::path Lookup::only_of_stem(const fs::path& path) {
  const fs::path folder = path.parent_path();
  const auto [it, is_new] = folders_.try_emplace(folder);
  if (is_new) {
    std::error_code problem;
    for (fs::directory_iterator entry(folder, problem), end; !problem && entry != end;
         entry.increment(problem)) {
      if (is_file(entry->path()) && is_image_file(entry->path()))
        it->second.emplace(small_letters(entry->path().stem().string()), entry->path());
    }
  }
  // "shot.v2" may lack an extension, or have one that no image has.
  for (const fs::path& stem : {path.stem(), path.filename()}) {
    const auto [first, last] = it->second.equal_range(small_letters(stem.string()));
    if (first != last && std::next(first) == last) return first->second;
  }
  return {};
}

FoundImage Lookup::find_tail(const std::string& forward, bool by_stem) {
  std::string tail = clean_image_name(without_drive(forward));
  for (bool whole = true;; whole = false) {
    const fs::path path = by_stem ? only_of_stem(folder_ / tail) : with_extension(folder_ / tail);
    if (!path.empty())
      return {path, tail, by_stem ? How::kByStem : whole ? How::kAsNamed : How::kByTail};
    const size_t slash = tail.find('/');
    if (slash == std::string::npos) return {};
    tail.erase(0, slash + 1);
  }
}

FoundImage Lookup::find(const std::string& name) {
  std::string forward = name;
  std::replace(forward.begin(), forward.end(), '\\', '/');
  const std::string clean = clean_image_name(without_drive(forward));
  if (clean.empty()) return {};
  for (const std::string& text : {name, forward}) {
    // A path of this computer, or one that leads out of the folder with "..".
    const fs::path path = with_extension(folder_ / text);
    if (!path.empty()) return {path.lexically_normal(), clean, How::kAsNamed};
  }
  FoundImage found = find_tail(forward, false);
  if (found.path.empty()) found = find_tail(forward, true);
  if (found.path.empty()) return {{}, clean, How::kAsNamed};
  found.path = found.path.lexically_normal();
  return found;
}

void add_note(const fs::path& folder, const std::vector<std::string>& names,
              const std::vector<FoundImage>& found, How how, const char* what,
              std::vector<std::string>& notes) {
  const auto count =
      std::count_if(found.begin(), found.end(), [&](const auto& f) { return f.how == how; });
  if (count == 0) return;
  const auto first =
      std::find_if(found.begin(), found.end(), [&](const auto& f) { return f.how == how; });
  const std::string file =
      first->path.lexically_relative(folder.lexically_normal()).generic_string();
  notes.push_back(fmt::format("{} image{} {}: {} is {}", count, count == 1 ? "" : "s", what,
                              printable(names[static_cast<size_t>(first - found.begin())]),
                              printable(file)));
}

}  // namespace

std::vector<FoundImage> find_images(const fs::path& folder, const std::vector<std::string>& names,
                                    std::vector<std::string>* notes) {
  Lookup lookup(folder);
  std::vector<FoundImage> found;
  std::map<fs::path, std::set<std::string>> claims;
  for (const std::string& name : names) {
    found.push_back(lookup.find(name));
    if (!found.back().path.empty()) claims[found.back().path].insert(name);
  }
  for (size_t i = 0; i < found.size(); ++i)
    if (found[i].how != How::kAsNamed && claims[found[i].path].size() > 1)
      found[i] = {{}, clean_image_name(without_drive(names[i])), How::kAsNamed};
  if (notes != nullptr) {
    add_note(folder, names, found, How::kByTail, "found by the end of a path that is not here",
             *notes);
    add_note(folder, names, found, How::kByStem,
             "found under another extension or in other letter case", *notes);
  }
  return found;
}

size_t count_as_named(const fs::path& folder, const std::vector<std::string>& names) {
  return static_cast<size_t>(std::count_if(names.begin(), names.end(), [&](std::string name) {
    if (is_file(folder / name)) return true;
    std::replace(name.begin(), name.end(), '\\', '/');
    return is_file(folder / name);
  }));
}

}  // namespace nerf::internal
