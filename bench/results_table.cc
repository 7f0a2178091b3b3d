#include "results_table.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <charconv>
#include <cmath>
#include <iterator>
#include <map>
#include <optional>
#include <set>

#include "nerf/base/error.h"
#include "nerf/base/nearest_name.h"

namespace nerf::apps {
namespace {

using Row = std::vector<std::string>;

constexpr size_t kDate = 0, kCommit = 1, kLoad = 3, kCommand = 5;

struct NumberedRow {
  size_t line;  // where it begins, from 1
  Row fields;
};

// Takes the text apart one record at a time.
class CsvReader {
 public:
  CsvReader(const std::string& text, const std::string& where) : text_(text), where_(where) {}

  std::optional<NumberedRow> next() {
    if (at_ >= text_.size()) return {};
    NumberedRow row{line_, {}};
    do {
      row.fields.push_back(field());
    } while (take(','));
    take('\r');
    if (!take('\n') && at_ < text_.size()) fail("a stray carriage return");
    return row;
  }

 private:
  bool take(char c) {
    if (at_ >= text_.size() || text_[at_] != c) return false;
    if (c == '\n') ++line_;
    ++at_;
    return true;
  }

  std::string field() {
    std::string value;
    if (take('"')) {
      const size_t begun = line_;
      for (;;) {
        if (at_ >= text_.size())
          throw Error("a quoted field has no end", fmt::format("{}:{}", where_, begun));
        const char c = text_[at_];
        take(c);
        if (c == '"' && !take('"')) break;
        value += c;
      }
      if (at_ < text_.size() && text_[at_] != ',' && text_[at_] != '\n' && text_[at_] != '\r')
        fail("text follows a closing quote");
      return value;
    }
    for (; at_ < text_.size() && text_[at_] != ',' && text_[at_] != '\n' && text_[at_] != '\r';
         ++at_) {
      if (text_[at_] == '"') fail("a quote stands within a field that does not begin with one");
      value += text_[at_];
    }
    return value;
  }

  [[noreturn]] void fail(const std::string& what) const {
    throw Error(what, fmt::format("{}:{}", where_, line_),
                "quote fields that hold commas or quotes, and double their quotes");
  }

  const std::string& text_;
  const std::string& where_;
  size_t at_ = 0, line_ = 1;
};

bool is_date(const std::string& text) {
  if (text.size() != 10) return false;
  for (size_t i = 0; i < text.size(); ++i)
    if (i == 4 || i == 7 ? text[i] != '-' : std::isdigit(static_cast<unsigned char>(text[i])) == 0)
      return false;
  return true;
}

bool is_number(const std::string& text) {
  double value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  return error == std::errc() && end == text.data() + text.size() && std::isfinite(value);
}

void check_row(const Results& results, const NumberedRow& row, const std::string& where) {
  const std::string place = fmt::format("{}:{}", where, row.line);
  if (row.fields.size() != results.columns.size())
    throw Error(fmt::format("{} fields where the first line names {} columns", row.fields.size(),
                            results.columns.size()),
                place);
  if (!row.fields[kDate].empty() && !is_date(row.fields[kDate]))
    throw Error("'" + row.fields[kDate] + "' is no date", place, "write YYYY-MM-DD");
  const std::string& load = row.fields[kLoad];
  if (!load.empty() && load != "alone" && load != "ahead" && load != "shared")
    throw Error("unknown load '" + load + "'", place,
                "give alone, ahead or shared, or nothing where it is not known");
  for (size_t i = 0; i < row.fields.size(); ++i)
    if (results.is_figure(i) && !row.fields[i].empty() && !is_number(row.fields[i]))
      throw Error(fmt::format("'{}' is no number", row.fields[i]), place,
                  fmt::format("the column '{}' holds figures", results.columns[i]));
}

std::string without_unit(const std::string& column) {
  return column.ends_with(')') ? column.substr(0, column.rfind(" (")) : column;
}

// What a reader needs at the top: plain counts and ratios have no unit.
std::string title(const std::string& column) {
  return column.ends_with(" (1)") ? without_unit(column) : column;
}

std::string markdown_cell(const std::string& text) {
  std::string out;
  for (const char c : text) out += c == '|' ? std::string("\\|") : std::string(1, c);
  return out;
}

std::string markdown_row(const Row& cells) {
  std::string line = "|";
  for (const std::string& cell : cells) line.append(" ").append(markdown_cell(cell)).append(" |");
  return line + "\n";
}

Row picked(const Row& row, const std::vector<size_t>& columns) {
  Row out;
  for (const size_t c : columns) out.push_back(row[c]);
  return out;
}

// Commands as code.
Row printed(const Results& r, size_t row, const std::vector<size_t>& columns) {
  Row cells = picked(r.rows[row], columns);
  for (size_t i = 0; i < columns.size(); ++i)
    if (columns[i] == kCommand && !cells[i].empty()) cells[i] = fmt::format("`{}`", cells[i]);
  return cells;
}

std::string joined(const Row& parts) {
  return fmt::format("{}", fmt::join(parts.begin(), parts.end(), ", "));
}

// Indices of the rows to print, in the order of the file. `wanted` are the columns to print.
std::vector<size_t> chosen_rows(const Results& r, const TableChoice& choice,
                                const std::vector<size_t>& wanted) {
  std::vector<size_t> key;
  for (size_t c = 0; c < r.columns.size(); ++c)
    if (c != kDate && c != kCommit && c != kLoad && !r.is_figure(c)) key.push_back(c);
  const auto holds = [&](const Condition& c, const Row& row) {
    return (row[r.column(c.column, "--where")].find(c.text) == std::string::npos) == c.negated;
  };
  std::vector<size_t> figures;
  std::ranges::copy_if(wanted, std::back_inserter(figures),
                       [&](size_t c) { return r.is_figure(c); });
  const auto has_figure = [&](const Row& row) {
    return figures.empty() ||
           std::ranges::any_of(figures, [&](size_t c) { return !row[c].empty(); });
  };
  std::map<Row, size_t> newest;
  std::vector<size_t> rows;
  for (size_t i = 0; i < r.rows.size(); ++i) {
    const Row& row = r.rows[i];
    if (!choice.any_load && row[kLoad] != "alone") continue;
    if (!std::ranges::all_of(choice.where, [&](const Condition& c) { return holds(c, row); }))
      continue;
    if (!has_figure(row)) continue;
    if (choice.history) {
      rows.push_back(i);
      continue;
    }
    const auto [at, first] = newest.emplace(picked(row, key), i);
    if (!first && r.rows[at->second][kDate] <= row[kDate]) at->second = i;
  }
  for (const auto& [k, i] : newest) rows.push_back(i);
  std::sort(rows.begin(), rows.end());
  return rows;
}

std::vector<size_t> wanted_columns(const Results& r, const TableChoice& choice) {
  std::vector<size_t> columns;
  for (const std::string& name : choice.columns) columns.push_back(r.column(name, "--columns"));
  for (size_t c = 0; choice.columns.empty() && c < r.columns.size(); ++c)
    if (c != kCommit && c != kLoad) columns.push_back(c);
  return columns;
}

// Rows that differ in the columns `across` alone become one, with their figures beside each other.
std::string table_across(const Results& r, const std::vector<size_t>& rows,
                         const std::vector<size_t>& columns, const std::vector<size_t>& across) {
  std::vector<size_t> fixed, figures;
  for (const size_t c : columns)
    if (std::find(across.begin(), across.end(), c) == across.end())
      (r.is_figure(c) ? figures : fixed).push_back(c);
  std::vector<Row> left, top;
  std::map<std::pair<Row, Row>, size_t> newest;
  for (const size_t i : rows) {
    const Row l = printed(r, i, fixed), t = picked(r.rows[i], across);
    if (std::find(left.begin(), left.end(), l) == left.end()) left.push_back(l);
    if (std::find(top.begin(), top.end(), t) == top.end()) top.push_back(t);
    const auto [at, first] = newest.emplace(std::pair(l, t), i);
    if (!first && r.rows[at->second][kDate] <= r.rows[i][kDate]) at->second = i;
  }
  std::sort(top.begin(), top.end());
  Row titles, names;
  for (const size_t c : fixed) titles.push_back(title(r.columns[c]));
  for (const size_t c : figures) names.push_back(title(r.columns[c]));
  for (const Row& t : top) {
    Row named = t;
    std::erase(named, "");
    titles.push_back(named.empty() ? "-" : joined(named));
  }
  if (!titles.empty() && !fixed.empty()) titles[fixed.size() - 1] += ": " + joined(names);
  std::string text = markdown_row(titles) + "|";
  for (size_t i = 0; i < titles.size(); ++i) text += "---|";
  text += "\n";
  for (const Row& l : left) {
    Row cells = l;
    for (const Row& t : top) {
      const auto at = newest.find({l, t});
      Row values = at == newest.end() ? Row{} : picked(r.rows[at->second], figures);
      std::erase(values, "");
      cells.push_back(joined(values));
    }
    text += markdown_row(cells);
  }
  return text;
}

}  // namespace

bool Results::is_figure(size_t column) const {
  return columns[column].ends_with(')') && columns[column].find(" (") != std::string::npos;
}

size_t Results::column(const std::string& name, const std::string& flag) const {
  std::vector<std::string> known;
  for (size_t c = 0; c < columns.size(); ++c) {
    if (columns[c] == name) return c;
    known.push_back(without_unit(columns[c]));
  }
  const auto at = std::find(known.begin(), known.end(), name);
  if (at == known.end())
    throw Error("unknown column '" + name + "'", flag, nearest_name_hint(name, known));
  if (std::find(at + 1, known.end(), name) != known.end())
    throw Error("several columns are called '" + name + "'", flag, "give the unit as well");
  return static_cast<size_t>(at - known.begin());
}

Results parse_results(const std::string& text, const std::string& where) {
  CsvReader reader(text, where);
  Results results;
  const std::optional<NumberedRow> head = reader.next();
  if (!head) throw Error("the file is empty", where, "its first line names the columns");
  results.columns = head->fields;
  for (size_t i = 0; i < kResultColumns.size(); ++i)
    if (i >= results.columns.size() || results.columns[i] != kResultColumns[i])
      throw Error(fmt::format("column {} is not '{}'", i + 1, kResultColumns[i]), where + ":1",
                  "the first columns are date,commit,machine,load,seed,command");
  std::set<std::string> seen;
  for (const std::string& column : results.columns)
    if (!seen.insert(column).second)
      throw Error("the column '" + column + "' is there twice", where + ":1");
  while (std::optional<NumberedRow> row = reader.next()) {
    check_row(results, *row, where);
    results.rows.push_back(std::move(row->fields));
  }
  return results;
}

std::string markdown_table(const Results& results, const TableChoice& choice) {
  std::vector<size_t> columns = wanted_columns(results, choice);
  const std::vector<size_t> rows = chosen_rows(results, choice, columns);
  if (rows.empty()) return "";
  std::erase_if(columns, [&](size_t c) {
    return std::ranges::all_of(rows, [&](size_t i) { return results.rows[i][c].empty(); });
  });
  std::vector<size_t> across;
  for (const std::string& name : choice.across) {
    across.push_back(results.column(name, "--across"));
    if (results.is_figure(across.back()))
      throw Error("'" + name + "' holds figures", "--across", "give a column of text");
  }
  if (!across.empty()) return table_across(results, rows, columns, across);
  Row titles;
  for (const size_t c : columns) titles.push_back(title(results.columns[c]));
  std::string text = markdown_row(titles) + "|";
  for (size_t i = 0; i < titles.size(); ++i) text += "---|";
  text += "\n";
  for (const size_t i : rows) text += markdown_row(printed(results, i, columns));
  return text;
}

}  // namespace nerf::apps
