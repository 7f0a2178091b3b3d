#include "scene_times.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <map>
#include <set>

#include "lenient_json.h"
#include "nerf/base/nearest_name.h"
#include "nerf/base/text.h"

namespace nerf::internal {

namespace fs = std::filesystem;
using nlohmann::json;

namespace {

constexpr double kLargest = 1e15;  // nanoseconds of two weeks; beyond it doubles lose moments

// The last number in a name, with decimals; no value where there is none.
std::optional<double> number_in(const std::string& text) {
  const auto is_digit = [&](size_t i) {
    return i < text.size() && text[i] >= '0' && text[i] <= '9';
  };
  size_t end = text.size();
  while (end > 0 && !is_digit(end - 1)) --end;
  if (end == 0) return std::nullopt;
  size_t begin = end;
  while (begin > 0 && is_digit(begin - 1)) --begin;
  if (begin > 1 && text[begin - 1] == '.' && is_digit(begin - 2)) {
    --begin;
    while (begin > 0 && is_digit(begin - 1)) --begin;
  }
  double value = 0;
  std::from_chars(text.data() + begin, text.data() + end, value);
  return value;
}

SceneInput::Times times_of_names(std::vector<View>& views) {
  std::vector<std::string> without;
  for (View& view : views) {
    const auto number = number_in(fs::path(view.name).stem().string());
    if (!number || !(*number <= kLargest))
      without.push_back(view.name);
    else
      view.time = *number;
  }
  if (!without.empty())
    throw Error(
        fmt::format("{} of {} photos have no number in their names, or one that is too large: {}",
                    without.size(), views.size(), name_list(without)),
        "--times name", "rename them, or give a table: --times FILE.json");
  return {.source = "numbers in the names"};
}

// View::clock where nothing else says when the photos were taken.
void give_clock_of_names(std::vector<View>& views) {
  std::vector<double> numbers;
  for (const View& view : views) {
    const auto number = number_in(fs::path(view.name).stem().string());
    if (!number || !(*number <= kLargest)) return;
    numbers.push_back(*number);
  }
  for (size_t i = 0; i < views.size(); ++i) views[i].clock = numbers[i];
}

// Their place among the photos of their folder. A folder is a camera of a rig, or, of Blender's
// transforms, a split that runs over all times (as D-NeRF's loader takes frames without "time").
SceneInput::Times times_of_order(std::vector<View>& views, bool stretched) {
  std::map<std::string, std::vector<View*>> folders;
  for (View& view : views) folders[fs::path(view.name).parent_path().string()].push_back(&view);
  for (auto& [folder, own] : folders) {
    std::ranges::stable_sort(
        own, [](const View* a, const View* b) { return natural_less(a->name, b->name); });
    const double step = stretched ? 1 / std::max(1.0, static_cast<double>(own.size()) - 1) : 1;
    for (size_t i = 0; i < own.size(); ++i) own[i]->time = step * static_cast<double>(i);
  }
  return {.source = "order of the frames"};
}

SceneInput::Times times_of_table(const fs::path& file, std::vector<View>& views,
                                 SceneReport& report) {
  const json table = read_lenient_json(file);
  const char* hint = "a table is one object: {\"photo.png\": 0.5, ...}, in any unit";
  if (!table.is_object()) throw Error("is no table of times", file.string(), hint);
  std::vector<std::string> without;
  std::set<std::string> used;
  for (View& view : views) {
    const fs::path name = view.name;
    auto entry = table.end();
    for (const fs::path& key :
         {name, name.filename(), name.parent_path() / name.stem(), name.stem()})
      if (entry == table.end()) entry = table.find(key.generic_string());
    if (entry == table.end()) {
      without.push_back(view.name);
      continue;
    }
    used.insert(entry.key());
    const double time = entry->is_number() ? entry->get<double>() : NAN;
    if (!(std::abs(time) <= kLargest))
      throw Error("is no number, or too large a one",
                  fmt::format("{}, \"{}\"", file.string(), printable(entry.key())), hint);
    view.time = time;
  }
  if (!without.empty())
    throw Error(fmt::format("has no time for {} of {} photos: {}", without.size(), views.size(),
                            name_list(without)),
                file.string(), hint);
  if (used.size() < table.size())
    report.notes.push_back(fmt::format("{} of {} entries of {} are of no photo that is used",
                                       table.size() - used.size(), table.size(),
                                       printable(file.filename().string())));
  return {.source = printable(file.filename().string())};
}

SceneInput::Times asked_times(SceneInput& input, const SceneOptions& options, SceneReport& report) {
  if (options.times == "frame") {
    if (input.times && input.times->on_request) return *input.times;
    return times_of_order(input.views, options.format == SceneFormat::kBlender);
  }
  if (options.times == "name") return times_of_names(input.views);
  return times_of_table(options.times, input.views, report);
}

}  // namespace

CaptureTimes settle_times(SceneInput& input, const SceneOptions& options, SceneReport& report) {
  const bool refused = options.times == "none";
  const bool asked = !options.times.empty() && !refused;
  const bool offered = input.times && !asked && (refused || input.times->on_request);
  if (!asked && (!input.times || offered)) {
    if (!offered) give_clock_of_names(input.views);
    for (View& view : input.views) {
      if (offered) view.clock = view.time;
      view.time = 0;
    }
    if (offered && !refused)
      report.notes.push_back("the frames of " + input.times->source +
                             " have times, and are taken as of one moment (--times frame: what "
                             "moves is learnt as moving)");
    return {};
  }
  const SceneInput::Times found = asked ? asked_times(input, options, report) : *input.times;
  for (View& view : input.views) view.clock = view.time;
  CaptureTimes times;
  times.source = found.source;
  times.seconds = found.seconds;
  const auto [lo, hi] = std::ranges::minmax_element(input.views, {}, &View::time);
  const double first = lo->time, last = hi->time;
  if (asked && !(last > first))
    throw Error(fmt::format("all {} photos have the same time, {:g}", input.views.size(), first),
                "--times " + options.times, "leave it out for a capture in which nothing moves");
  if (asked || first < 0 || last > 1) {
    times.first = first;
    times.last = last;
    for (View& view : input.views) view.time = times.from_unit(view.time);
  }
  if (!(last > first)) return times;
  std::set<double> moments;
  for (const View& view : input.views) moments.insert(view.time);
  report.times = fmt::format("{} moments, {:g} to {:g}{} ({})", moments.size(), first, last,
                             times.seconds ? " s" : "", times.source);
  return times;
}

void describe_held_out(const Scene& scene, SceneReport& report) {
  const std::vector<HeldOut> kinds = held_out_kinds(scene);
  const auto count = [&](HeldOut kind) {
    return std::ranges::count_if(scene.test,
                                 [&](int v) { return kinds[static_cast<size_t>(v)] == kind; });
  };
  const auto space = count(HeldOut::kSpace), time = count(HeldOut::kTime);
  if (space + time == 0) return;
  report.times += "; held out: ";
  if (space > 0)
    report.times += fmt::format("{} of moments that training sees from elsewhere", space);
  if (time > 0)
    report.times +=
        fmt::format("{}{} of moments that training does not see", space > 0 ? ", " : "", time);
}

}  // namespace nerf::internal

namespace nerf {

void check_times_option(const std::string& times) {
  if (times.empty() || times == "none" || times == "frame" || times == "name" ||
      times.ends_with(".json"))
    return;
  const std::array<std::string, 4> known{"none", "frame", "name", "FILE.json"};
  throw Error(fmt::format("'{}' is neither a known word nor a .json file", times), "--times",
              nearest_name_hint(times, known));
}

std::vector<HeldOut> held_out_kinds(const Scene& scene) {
  constexpr double kSame = 1e-6;
  std::vector<HeldOut> kinds(scene.views.size(), HeldOut::kStatic);
  const auto [lo, hi] = std::ranges::minmax_element(scene.views, {}, &View::time);
  if (scene.views.empty() || !(lo->time < hi->time)) return kinds;
  std::vector<double> seen;
  for (const int v : scene.train) seen.push_back(scene.views[static_cast<size_t>(v)].time);
  std::ranges::sort(seen);
  for (size_t v = 0; v < kinds.size(); ++v) {
    const auto next = std::ranges::lower_bound(seen, scene.views[v].time - kSame);
    kinds[v] = next != seen.end() && *next <= scene.views[v].time + kSame ? HeldOut::kSpace
                                                                          : HeldOut::kTime;
  }
  return kinds;
}

}  // namespace nerf
