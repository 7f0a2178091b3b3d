// A script that takes colmap's place for as long as this lives.
#pragma once

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

namespace nerf::test {

class StandInColmap {
 public:
  // The script lies in `folder`/bin, before everything else in $PATH.
  StandInColmap(const std::filesystem::path& folder, const char* script) : path_(::getenv("PATH")) {
    const std::filesystem::path file = folder / "bin" / "colmap";
    std::filesystem::create_directory(file.parent_path());
    std::ofstream(file) << script;
    std::filesystem::permissions(file, std::filesystem::perms{0755});
    ::setenv("PATH", (file.parent_path().string() + ":" + path_).c_str(), 1);
  }
  ~StandInColmap() {
    ::setenv("PATH", path_.c_str(), 1);
    for (const std::string& name : variables_) ::unsetenv(name.c_str());
  }
  StandInColmap(const StandInColmap&) = delete;
  StandInColmap& operator=(const StandInColmap&) = delete;

  // What the script reads as $name.
  void set(const std::string& name, const std::string& value) {
    ::setenv(name.c_str(), value.c_str(), 1);
    variables_.push_back(name);
  }

 private:
  std::string path_;
  std::vector<std::string> variables_;
};

}  // namespace nerf::test
