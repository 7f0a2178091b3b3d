// Markdown tables of the measurements that bench/results holds.
#include <fmt/format.h>

#include <algorithm>
#include <cstdio>

#include "app.h"
#include "bench_commands.h"
#include "lists.h"
#include "nerf/base/error.h"
#include "nerf/base/file.h"
#include "nerf/base/nearest_name.h"
#include "options_cli.h"
#include "results_table.h"

namespace nerf::apps {
namespace {

namespace fs = std::filesystem;

struct TablesOptions {
  std::string file;
  fs::path results = "bench/results";
  std::string columns;
  std::string across;
  std::string where;
  bool any_load = false;
  bool history = false;

  template <class V>
  void visit_options(V& v) {
    v("file", file, "one file of the folder, without .csv; without it each gives a table",
      positional(), metavar("FILE"));
    v("results", results, "folder with the CSV files", metavar("DIR"));
    v("columns", columns, "columns to print, separated by commas; units may be left out",
      metavar("NAMES"));
    v("across", across, "columns of text whose values become columns of figures", metavar("NAMES"));
    v("where", where, "only rows whose columns contain these texts (with != do not)",
      metavar("NAME=TEXT;..."));
    v("any_load", any_load,
      "also rows that were measured beside other work, or where that is "
      "not known");
    v("history", history, "every row, not only the newest of its machine, seed and command");
  }

  TableChoice choice() const {
    TableChoice c;
    if (!columns.empty()) c.columns = parts_of(columns);
    if (!across.empty()) c.across = parts_of(across);
    for (size_t at = 0; at < where.size();) {
      const size_t end = std::min(where.find(';', at), where.size());
      const std::string part = where.substr(at, end - at);
      const size_t equals = part.find('=');
      if (equals == std::string::npos)
        throw Error("'" + part + "' has no =", "--where",
                    "write \"machine=Zen 4;date!=2026-11-21\"");
      const bool negated = equals > 0 && part[equals - 1] == '!';
      c.where.push_back(
          {part.substr(0, equals - (negated ? 1 : 0)), part.substr(equals + 1), negated});
      at = end + 1;
    }
    c.any_load = any_load;
    c.history = history;
    return c;
  }
};

// Paths of the CSV files of the folder, in the order of their names.
std::vector<fs::path> result_files(const fs::path& folder) {
  if (!fs::is_directory(folder))
    throw Error("no such folder", folder.string(),
                "run this at the top of the repository, or give --results DIR");
  std::vector<fs::path> files;
  for (const auto& entry : fs::directory_iterator(folder))
    if (entry.path().extension() == ".csv") files.push_back(entry.path());
  std::sort(files.begin(), files.end());
  return files;
}

}  // namespace

int bench_tables(int argc, char** argv) {
  TablesOptions options;
  const ProgramText text{
      "nerf_bench tables", "Prints kept measurements as Markdown tables, the newest of each kind.",
      "Only rows that were measured with nothing else running count, unless --any-load is "
      "given.\n\n"
      "  nerf_bench tables training --columns scene,machine,date,PSNR\n"
      "  nerf_bench tables kernels --where \"machine=Zen 4\" --columns kernel,ceiling "
      "--across products,threads"};
  if (parse_command_line(argc, argv, text, options).exit) return kExitOk;
  std::vector<fs::path> files = result_files(options.results);
  std::vector<std::string> names;
  for (const fs::path& f : files) names.push_back(f.stem().string());
  if (!options.file.empty()) {
    const auto at = std::find(names.begin(), names.end(), options.file);
    if (at == names.end())
      throw Error("no file '" + options.file + ".csv'", options.results.string(),
                  nearest_name_hint(options.file, names));
    files = {files[static_cast<size_t>(at - names.begin())]};
  }
  const TableChoice choice = options.choice();
  bool any = false;
  for (const fs::path& f : files) {
    const std::string table = markdown_table(parse_results(read_text_file(f), f.string()), choice);
    if (table.empty()) continue;
    if (files.size() > 1) std::printf("%s## %s\n\n", any ? "\n" : "", f.stem().string().c_str());
    std::fputs(table.c_str(), stdout);
    any = true;
  }
  if (!any)
    throw Error("no row is left", options.results.string(),
                options.any_load ? "check --where" : "try --any-load");
  return kExitOk;
}

}  // namespace nerf::apps
