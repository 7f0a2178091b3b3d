// What the documents say about the programs' options.
#include <gtest/gtest.h>

#include <algorithm>
#include <cctype>
#include <filesystem>
#include <set>
#include <sstream>
#include <string>
#include <vector>

#include "nerf/train/methods.h"
#include "run_program.h"

namespace nerf {
namespace {

namespace fs = std::filesystem;
using Command = std::vector<std::string>;

// "--" that no name precedes, with the letters, digits and single dashes behind it.
std::set<std::string> options_in(const std::string& text) {
  const auto in_name = [](char c) { return std::isalnum(static_cast<unsigned char>(c)) != 0; };
  std::set<std::string> found;
  for (size_t at = text.find("--"); at != std::string::npos; at = text.find("--", at + 1)) {
    if (at > 0 && (in_name(text[at - 1]) || text[at - 1] == '-')) continue;
    size_t end = at + 2;
    while (end < text.size() && (in_name(text[end]) || text[end] == '-')) ++end;
    while (text[end - 1] == '-' && end > at + 2) --end;
    if (end > at + 2 && std::islower(static_cast<unsigned char>(text[at + 2])))
      found.insert(text.substr(at, end - at));
  }
  return found;
}

// The text without the commands of OpenImageIO's oiiotool, which has options of its own; a
// backslash continues a command on the next line.
std::string without_commands_of_oiiotool(const std::string& text) {
  std::istringstream lines(text);
  std::string kept;
  bool inside = false;
  for (std::string line; std::getline(lines, line);) {
    const bool left_out = inside || line.starts_with("oiiotool ");
    inside = left_out && line.ends_with("\\");
    if (!left_out) kept += line + "\n";
  }
  return kept;
}

TEST(Docs, NameOnlyOptionsThatAProgramHas) {
  std::set<std::string> known = {"--help", "--help-all"};
  for (const Command& program :
       {Command{NERF_TRAIN_PROGRAM, "--help-all"}, Command{NERF_RENDER_PROGRAM, "--help-all"},
        Command{NERF_EXPORT_PROGRAM, "mesh", "--help"},
        Command{NERF_EXPORT_PROGRAM, "points", "--help"},
        Command{NERF_EXPORT_PROGRAM, "cameras", "--help"},
        Command{NERF_BENCH_PROGRAM, "scene", "--help"},
        Command{NERF_BENCH_PROGRAM, "render", "--help"},
        Command{NERF_BENCH_PROGRAM, "kernels", "--help"},
        Command{NERF_BENCH_PROGRAM, "error", "--help"},
        Command{NERF_BENCH_PROGRAM, "ablation", "--help"},
        Command{NERF_BENCH_PROGRAM, "report", "--help"},
        Command{NERF_BENCH_PROGRAM, "tables", "--help"}})
    known.merge(options_in(
        testing_apps::run_program(program[0], {program.begin() + 1, program.end()}).out));
  ASSERT_TRUE(known.contains("--grid-levels"));
  const fs::path root = NERF_SOURCE_DIR;
  std::vector<fs::path> documents = {root / "README.md"};
  for (const auto& entry : fs::recursive_directory_iterator(root / "docs"))
    if (entry.path().extension() == ".md") documents.push_back(entry.path());
  const std::set<std::string> of_cmake = {"--install", "--prefix", "--preset"};
  for (const fs::path& document : documents)
    for (const std::string& option :
         options_in(without_commands_of_oiiotool(testing_apps::read_text(document))))
      EXPECT_TRUE(known.contains(option) || of_cmake.contains(option) ||
                  (option.starts_with("--no-") && known.contains("--" + option.substr(5))))
          << document.filename() << " names " << option;
}

// The tables of docs/methods.md hold what --list-methods prints, a row for each method; each has as
// many of the slots as its lines have room for.
TEST(Docs, ListTheMethodsThatThereAre) {
  const std::string document =
      testing_apps::read_text(fs::path(NERF_SOURCE_DIR) / "docs" / "methods.md");
  std::istringstream lines(methods_table());
  std::vector<std::vector<std::string>> methods;  // names of the slots, then each method's cells
  for (std::string line; std::getline(lines, line);) {
    methods.emplace_back();
    for (size_t at = 0; at < line.size();) {
      size_t end = std::min(line.find("  ", at), line.size());
      methods.back().push_back(line.substr(at, end - at));
      while (end < line.size() && line[end] == ' ') ++end;
      at = end;
    }
    ASSERT_EQ(methods.back().size(), methods[0].size()) << line;
  }
  ASSERT_GE(methods.size(), 5u);
  const auto row_of = [&](size_t m, size_t first, size_t last) {
    std::string row = m == 0 ? "| " + methods[0][0] + " |" : "| `" + methods[m][0] + "` |";
    for (size_t slot = first; slot < last; ++slot) row += " " + methods[m][slot] + " |";
    return row;
  };
  const auto fits = [&](size_t first, size_t last) {
    for (size_t m = 0; m < methods.size(); ++m)
      if (row_of(m, first, last).size() > 120) return false;
    return true;
  };
  for (size_t first = 1, last = 1; first < methods[0].size(); first = last) {
    while (last < methods[0].size() && fits(first, last + 1)) ++last;
    ASSERT_GT(last, first);
    std::string table;
    for (size_t m = 0; m < methods.size(); ++m) {
      table += row_of(m, first, last) + "\n";
      if (m > 0) continue;
      table += "|";
      for (size_t slot = first; slot <= last; ++slot) table += "---|";
      table += "\n";
    }
    EXPECT_NE(document.find(table), std::string::npos) << table;
  }
}

// Each table of docs/benchmarks.md below a command of nerf_bench tables is what the command prints.
TEST(Docs, ShowTheFiguresThatAreKept) {
  const fs::path root = NERF_SOURCE_DIR;
  std::istringstream lines(testing_apps::read_text(root / "docs" / "benchmarks.md"));
  int tables = 0;
  for (std::string line; std::getline(lines, line);) {
    if (line != "```") continue;
    std::string command;
    while (std::getline(lines, line) && line != "```") command += line + "\n";
    if (!command.starts_with("nerf_bench tables")) continue;
    while (std::getline(lines, line) && line.empty()) {
    }
    std::string shown;
    for (; line.starts_with('|'); std::getline(lines, line)) shown += line + "\n";
    const auto result = testing_apps::run_program(
        "/bin/sh",
        {"-c", "cd \"$0\"; program=$1; nerf_bench() { \"$program\" \"$@\"; }\n" + command,
         root.string(), NERF_BENCH_PROGRAM});
    EXPECT_EQ(result.out, shown) << command << result.err;
    ++tables;
  }
  EXPECT_GE(tables, 5);
}

}  // namespace
}  // namespace nerf
