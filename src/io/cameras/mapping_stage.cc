#include "io/cameras/mapping_stage.h"

#include <fmt/format.h>

#include <algorithm>
#include <set>
#include <utility>
#include <vector>

#include "io/cameras/lookalikes.h"
#include "io/colmap.h"
#include "io/paths.h"
#include "nerf/base/error.h"
#include "nerf/base/file.h"
#include "nerf/base/threads.h"

namespace nerf::internal {

namespace fs = std::filesystem;

namespace {

// From here on the global mapper, where colmap has one: its time grows with the photos, that of the
// other with more than their square root on top.
constexpr int64_t kManyPhotos = 400;
// The incremental mapper's time grows with about this power of the number of photos.
constexpr double kMappingPower = 1.5;
// Share of the photos that stay placed where pairs of things that look alike are taken away.
constexpr double kEnoughApart = 0.9;
// They are tried without so many times at most: what colmap finds depends on its threads, too.
constexpr int kRoundsApart = 2;

// Below `folder`, the one with the most photos first.
std::vector<MappedModel> models_in(const fs::path& folder) {
  std::vector<MappedModel> models;
  std::error_code ignored;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder, ignored)) {
    const auto photos = static_cast<int64_t>(colmap_image_count(entry.path()));
    if (is_folder(entry.path()) && photos > 0) models.push_back({entry.path(), photos});
  }
  std::ranges::sort(models, [](const MappedModel& a, const MappedModel& b) {
    return a.photos != b.photos ? a.photos > b.photos : a.folder < b.folder;
  });
  return models;
}

void clear_folder(const fs::path& folder) {
  std::error_code failed;
  fs::remove_all(folder, failed);
  if (failed) throw errno_error(failed.value(), "cannot remove", folder);
  make_writable_folder(folder);
}

ColmapProgram::Settings fixed_lenses(const std::string& before) {
  return {{before + "focal_length", "0"},
          {before + "principal_point", "0"},
          {before + "extra_params", "0"}};
}

ColmapProgram::Settings mapper_settings(int64_t count, const MapSettings& map) {
  ColmapProgram::Settings settings{
      {"num_threads", std::to_string(available_processors())},
      {"min_model_size", std::to_string(std::clamp<int64_t>(count / 2, 2, 10))},
      // Stops the adjustment where it no longer changes anything: half of the time.
      {"ba_global_function_tolerance", "1e-6"},
      // Photos and points grow by so much between two adjustments of everything.
      {"ba_global_images_ratio", "1.2"},
      {"ba_global_frames_ratio", "1.2"},
      {"ba_global_points_ratio", "1.2"}};
  if (map.lenses_are_known) {
    const ColmapProgram::Settings fixed = fixed_lenses("ba_refine_");
    settings.insert(settings.end(), fixed.begin(), fixed.end());
  }
  if (map.eager) {
    settings.insert(settings.end(), {{"init_min_num_inliers", "50"},
                                     {"init_min_tri_angle", "8"},
                                     {"abs_pose_min_num_inliers", "15"},
                                     {"abs_pose_min_inlier_ratio", "0.15"},
                                     {"filter_min_tri_angle", "1"}});
  }
  return settings;
}

// The model that holds both, where colmap finds enough photos that they share; else none.
MappedModel merged(const ColmapProgram& colmap, const MappedModel& a, const MappedModel& b,
                   const fs::path& folder, const MapSettings& map) {
  try {
    make_writable_folder(folder / "joined");
    colmap.run("model_merger",
               {"--input_path1", a.folder.string(), "--input_path2", b.folder.string(),
                "--output_path", (folder / "joined").string()},
               {}, [](std::string_view) {});
    if (static_cast<int64_t>(colmap_image_count(folder / "joined")) <= a.photos) return {};
    make_writable_folder(folder / "adjusted");
    colmap.run("bundle_adjuster",
               {"--input_path", (folder / "joined").string(), "--output_path",
                (folder / "adjusted").string()},
               map.lenses_are_known ? fixed_lenses("refine_") : ColmapProgram::Settings(),
               [](std::string_view) {});
  } catch (const Error&) {
    return {};  // they do not join
  }
  return {folder / "adjusted", static_cast<int64_t>(colmap_image_count(folder / "adjusted"))};
}

// Joins what can be joined with the largest.
MappedModel largest_of(const ColmapProgram& colmap, std::vector<MappedModel> models,
                       const fs::path& folder, const MapSettings& map, const Tell& tell) {
  if (models.empty()) return {};
  MappedModel best = models.front();
  for (size_t i = 1; i < models.size(); ++i) {
    const MappedModel joined =
        merged(colmap, best, models[i], folder / fmt::format("join_{}", i), map);
    if (joined.photos > best.photos) {
      if (tell)
        tell(fmt::format("colmap: joined parts of {} and {} photos to one of {}", best.photos,
                         models[i].photos, joined.photos));
      best = joined;
    } else if (tell) {
      tell(
          fmt::format("colmap: a part of {} photos does not join the largest, of {}, and is left "
                      "out; photos that show both would help",
                      models[i].photos, best.photos));
    }
  }
  return best;
}

MappedModel map_once(const ColmapProgram& colmap, const CapturePhotos& photos,
                     const fs::path& database, const fs::path& folder, const MapSettings& map,
                     const Tell& tell) {
  const auto count = static_cast<int64_t>(photos.photos.size());
  const auto run = [&](const char* mapper) {
    clear_folder(folder);
    StageProgress progress(tell, "colmap: placed", "photos", count, 0, kMappingPower);
    int64_t most = 0;  // of all models so far
    // It counts as a failure of colmap's where it finds none, but other settings may find one.
    bool found_none = false;
    try {
      colmap.run(mapper,
                 {"--database_path", database.string(), "--image_path", photos.folder.string(),
                  "--output_path", folder.string()},
                 mapper_settings(count, map), [&](std::string_view line) {
                   found_none |= line.find("failed to create sparse model") != line.npos;
                   // "Registering image #7 (12)"; newer versions add more behind the 12
                   const std::string_view placed =
                       between(between(line, "Registering image #", "\n"), "(", ")");
                   if (placed.empty()) return;
                   most = std::max(most, leading_number(placed));
                   progress.update(std::min(most, count));
                 });
    } catch (const Error&) {
      if (!found_none) throw;
    }
    return models_in(folder);
  };
  std::vector<MappedModel> models;
  if (count >= kManyPhotos && !map.eager && colmap.has_command("global_mapper")) {
    if (tell) tell("colmap: placing all photos at once");
    try {
      models = run("global_mapper");
    } catch (const Error&) {  // some builds lack what it needs
    }
  }
  if (models.empty()) models = run("mapper");
  return largest_of(colmap, std::move(models), folder, map, tell);
}

using VerifiedMatches = std::vector<std::pair<ImageIdPair, std::vector<FeatureMatch>>>;

// Takes away what is verified of these pairs.
VerifiedMatches take_matches(const std::set<ImageIdPair>& pairs, FeatureDatabase& features) {
  VerifiedMatches taken;
  features.begin();
  for (const ImageIdPair& pair : pairs) {
    taken.emplace_back(pair, features.verified_matches(pair));
    features.replace_verified_matches(pair, {});
  }
  features.commit();
  return taken;
}

void put_back(const VerifiedMatches& taken, FeatureDatabase& features) {
  features.begin();
  for (const auto& [pair, matches] : taken) features.replace_verified_matches(pair, matches);
  features.commit();
}

}  // namespace

MappedModel map_photos(const ColmapProgram& colmap, const CapturePhotos& photos,
                       const fs::path& database, const fs::path& folder, const MapSettings& map,
                       const Tell& tell) {
  MappedModel best = map_once(colmap, photos, database, folder, map, tell);
  if (best.photos == 0) return best;
  FeatureDatabase features(database);
  ModelCheck check = check_model(best.folder, features);
  int contradicted = check.contradicted;  // of the best
  const double enough = kEnoughApart * static_cast<double>(best.photos);
  std::set<ImageIdPair> misleading, misled_before_best;
  for (int round = 1; round <= kRoundsApart && !check.misleading.empty(); ++round) {
    misleading.insert(check.misleading.begin(), check.misleading.end());
    if (tell)
      tell(
          fmt::format("colmap: {} photos do not stand where the photos closest to them say; "
                      "placing all again without {} pairs that show what looks alike",
                      check.contradicted, misleading.size()));
    const VerifiedMatches taken = take_matches(misleading, features);
    const MappedModel apart = map_once(
        colmap, photos, database, fs::path(folder) += fmt::format("_apart_{}", round), map, tell);
    put_back(taken, features);  // all models are judged by all pairs
    check = apart.photos > 0 ? check_model(apart.folder, features) : ModelCheck();
    if (static_cast<double>(apart.photos) < enough) break;
    if (check.contradicted < contradicted) {
      best = apart;
      contradicted = check.contradicted;
      misled_before_best = misleading;
    }
  }
  take_matches(misled_before_best, features);  // for what may be tried next
  if (contradicted > 0 && !misleading.empty() && tell)
    tell(
        fmt::format("colmap: {} photos may stand in wrong places, where things look alike (photos "
                    "that show more of their surroundings would help)",
                    contradicted));
  return best;
}

}  // namespace nerf::internal
