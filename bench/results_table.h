// Measurements that were kept (bench/results/*.csv), and the Markdown tables printed from them.
#pragma once

#include <array>
#include <cstddef>
#include <string>
#include <vector>

namespace nerf::apps {

// The first columns of every file, in this order. `date` is YYYY-MM-DD; `commit` recorded the row;
// `load` is "alone" (nothing else ran), "ahead" (at a higher priority than other work), "shared"
// (beside other work). Each may be empty where it is not known.
inline constexpr std::array<const char*, 6> kResultColumns = {"date", "commit", "machine",
                                                              "load", "seed",   "command"};

// One file. A column whose name ends in "(UNIT)" holds figures, numbers in that unit ("(1)" for
// plain counts and ratios) or nothing. Every other column holds text that names what was measured.
struct Results {
  std::vector<std::string> columns;
  std::vector<std::vector<std::string>> rows;  // each as long as columns
  bool is_figure(size_t column) const;
  // Throws Error for a name that no column has; a figure's name may leave its unit out.
  size_t column(const std::string& name, const std::string& flag) const;
};

// RFC 4180: fields with commas, quotes or line breaks stand in quotes. Throws Error with `where`
// and the line: first columns other than kResultColumns, a column twice, a row of another length, a
// date, load or figure that is none, quotes that do not match.
Results parse_results(const std::string& text, const std::string& where);

// A column's text contains `text`, or with `negated` does not.
struct Condition {
  std::string column, text;
  bool negated = false;
};

struct TableChoice {
  std::vector<std::string> columns{};  // names of those to print; none: all but commit and load
  std::vector<std::string> across{};   // text columns whose values become columns of figures
  std::vector<Condition> where{};      // all must hold
  bool any_load = false;               // rows that were not measured alone as well
  bool history = false;                // every row, not only the newest of each key
};

// The newest row of each key, in the order of the file, as a Markdown table; "" where none is left.
// The key is machine, seed, command and every other text column; of rows of one date the later one
// is the newer. Rows that have none of the printed figures are left out, and so are columns without
// any value. Throws Error for columns that are not
// there.
std::string markdown_table(const Results& results, const TableChoice& choice);

}  // namespace nerf::apps
