// What the documents say about the programs' options.
#include <gtest/gtest.h>

#include <filesystem>
#include <regex>
#include <set>
#include <string>
#include <vector>

#include "run_program.h"

namespace nerf {
namespace {

namespace fs = std::filesystem;
using Command = std::vector<std::string>;

std::set<std::string> options_in(const std::string& text) {
  static const std::regex kOption("(^|[^-A-Za-z0-9])(--[a-z][a-z0-9]*(-[a-z0-9]+)*)");
  std::set<std::string> found;
  for (std::sregex_iterator it(text.begin(), text.end(), kOption), end; it != end; ++it)
    found.insert((*it)[2]);
  return found;
}

TEST(Docs, NameOnlyOptionsThatAProgramHas) {
  std::set<std::string> known = {"--help"};
  for (const Command& program :
       {Command{NERF_TRAIN_PROGRAM, "--help"}, Command{NERF_RENDER_PROGRAM, "--help"},
        Command{NERF_BENCH_PROGRAM, "scene", "--help"}})
    known.merge(options_in(
        testing_apps::run_program(program[0], {program.begin() + 1, program.end()}).out));
  ASSERT_TRUE(known.contains("--grid-levels"));
  const fs::path root = NERF_SOURCE_DIR;
  std::vector<fs::path> documents = {root / "README.md"};
  for (const auto& entry : fs::directory_iterator(root / "docs"))
    if (entry.path().extension() == ".md") documents.push_back(entry.path());
  const std::set<std::string> of_cmake = {"--install", "--prefix"};
  for (const fs::path& document : documents)
    for (const std::string& option : options_in(testing_apps::read_text(document)))
      EXPECT_TRUE(known.contains(option) || of_cmake.contains(option))
          << document.filename() << " names " << option;
}

}  // namespace
}  // namespace nerf
