#include "appearance.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <optional>
#include <vector>

#include "nerf/base/error.h"
#include "nerf/base/nearest_name.h"
#include "nerf/math/srgb.h"
#include "nerf/model/field.h"

namespace nerf::apps {
namespace {

namespace fs = std::filesystem;
constexpr const char* kOption = "--appearance";

std::vector<std::string> parts_of(const std::string& text) {
  std::vector<std::string> parts;
  size_t begin = 0;
  for (size_t at; (at = text.find("..", begin)) != std::string::npos; begin = at + 2)
    parts.push_back(text.substr(begin, at - begin));
  parts.push_back(text.substr(begin));
  return parts;
}

std::optional<int> exact(const std::string& name, const CodeBooks& books) {
  const auto at = std::ranges::find(books.photos, name);
  if (at == books.photos.end()) return std::nullopt;
  return static_cast<int>(at - books.photos.begin());
}

int photo_of(const std::string& name, const CodeBooks& books) {
  if (const auto found = exact(name, books)) return *found;
  std::vector<int> fitting;
  for (int p = 0; p < books.rows(); ++p) {
    const fs::path photo = books.photos[static_cast<size_t>(p)];
    if (photo.filename() == name || photo.stem() == name) fitting.push_back(p);
  }
  if (fitting.size() == 1) return fitting.front();
  if (fitting.size() > 1)
    throw Error("'" + name + "' fits " + std::to_string(fitting.size()) + " photos", kOption,
                "give the folder too: " + books.photos[static_cast<size_t>(fitting.front())]);
  throw Error("'" + name + "' is no photo that the model was trained on", kOption,
              nearest_name_hint(name, books.photos));
}

}  // namespace

void give_appearance(const std::string& text, const RadianceField& field, RenderPlan& plan) {
  if (text.empty() || text == "mean") return;
  const CodeBooks& books = field.field().codes();
  const auto weights = field.field().all_weights();
  if (books.light() == 0 && books.colours.out == 0)
    throw Error("the model has not learnt the photos' light", kOption,
                "train with --appearance 16, or leave it out");
  if (text == "own") {
    for (PlannedFrame& frame : plan.frames)
      if (const auto photo = exact(frame.name, books))
        frame.appearance = appearance_of(books, weights, *photo);
    return;
  }
  std::vector<Appearance> keys;
  for (const std::string& name : parts_of(text))
    keys.push_back(name == "mean" ? mean_appearance(books, weights)
                                  : appearance_of(books, weights, photo_of(name, books)));
  const double last = static_cast<double>(std::max<size_t>(plan.frames.size(), 2) - 1);
  for (size_t i = 0; i < plan.frames.size(); ++i) {
    const double at = static_cast<double>(i) / last * static_cast<double>(keys.size() - 1);
    const size_t from = std::min(static_cast<size_t>(at), keys.size() - 1);
    const size_t to = std::min(from + 1, keys.size() - 1);
    plan.frames[i].appearance =
        blend(keys[from], keys[to], static_cast<Real>(at - static_cast<double>(from)));
  }
}

void change_exposure(double stops, std::span<Real> rgb) {
  if (stops == 0) return;
  const Real factor = static_cast<Real>(std::exp2(stops));
  for (Real& x : rgb)
    x = std::clamp(linear_to_srgb(factor * srgb_to_linear(std::max(x, 0.0_r))), 0.0_r, 1.0_r);
}

}  // namespace nerf::apps
