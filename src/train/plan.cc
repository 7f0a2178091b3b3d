#include "nerf/train/plan.h"

#include <algorithm>
#include <charconv>
#include <optional>

namespace nerf {
namespace {

std::optional<int64_t> positive_number(std::string_view text) {
  int64_t n = 0;
  const char* const end = text.data() + text.size();
  const auto [stop, error] = std::from_chars(text.data(), end, n);
  if (error != std::errc() || stop != end || n <= 0) return std::nullopt;
  return n;
}

// Nothing where the text is no list of changes.
std::optional<PlanChanges> parse(std::string_view text) {
  PlanChanges out;
  while (!text.empty()) {
    const size_t comma = text.find(',');
    const std::string_view item = text.substr(0, comma);
    const size_t colon = item.find(':');
    if (colon == std::string_view::npos) return std::nullopt;
    const auto step = positive_number(item.substr(0, colon));
    const auto length = positive_number(item.substr(colon + 1));
    if (!step || !length || *length < *step) return std::nullopt;
    if (!out.list.empty() && *step <= out.list.back().step) return std::nullopt;
    out.list.push_back({*step, *length});
    if (comma == std::string_view::npos) break;
    text.remove_prefix(comma + 1);
    if (text.empty()) return std::nullopt;
  }
  return out;
}

}  // namespace

void OptionTraits<PlanChanges>::describe(OptionField& field) {
  field.metavar = "STEP:LENGTH,...";
  field.problem = [](const OptionValue& value) -> std::string {
    if (parse(std::get<std::string>(value))) return "";
    return "must be STEP:LENGTH, or several of them with commas between, steps rising and none "
           "above its length";
  };
}

OptionValue OptionTraits<PlanChanges>::to_value(const PlanChanges& changes) {
  std::string text;
  for (const PlanChange& c : changes.list) {
    if (!text.empty()) text += ',';
    text += std::to_string(c.step);
    text += ':';
    text += std::to_string(c.length);
  }
  return text;
}

PlanChanges OptionTraits<PlanChanges>::from_value(const OptionValue& value) {
  return parse(std::get<std::string>(value)).value_or(PlanChanges());
}

double TrainingPlan::progress_at(int64_t step) const {
  int64_t from = 0;
  double reached = 0;
  const auto along = [&](int64_t at, int64_t length) {
    const double total = static_cast<double>(std::max<int64_t>(length - from, 1));
    const double share = std::min(1.0, static_cast<double>(at - from) / total);
    return from == 0 ? std::max(0.0, share - hold) / (1 - hold) : reached + (1 - reached) * share;
  };
  for (const PlanChange& c : changes.list) {
    if (step < c.step) return along(step, c.length);
    if (c.length == c.step) continue;  // extended
    reached = along(c.step, c.length);
    from = c.step;
  }
  return along(step, steps);
}

int64_t TrainingPlan::length_at(int64_t step) const {
  for (const PlanChange& c : changes.list)
    if (step < c.step) return c.length;
  return steps;
}

TrainingPlan TrainingPlan::changed(int64_t done, int64_t to, bool length_matters) const {
  TrainingPlan out{to, hold, {}};
  for (const PlanChange& c : changes.list)
    if (c.step < done) out.changes.list.push_back(c);
  const int64_t length = length_at(done - 1);
  // Whether a step that was done had, or would have had, another progress than at the beginning.
  const bool matters = length_matters || progress_at(done - 1) > 0 || out.progress_at(done - 1) > 0;
  if (done > 0 && matters && done <= length && length != to)
    out.changes.list.push_back({done, length});
  return out;
}

}  // namespace nerf
