// A run's folder as its report reads it: what is there, and words for what is missing.
#pragma once

#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "nerf/io/depth_image.h"
#include "nerf/model/model_info.h"
#include "run_notes.h"

namespace nerf::apps {

// A line of metrics.jsonl. Counts are of that step alone.
struct MetricsStep {
  double step = 0, seconds = 0, loss = 0, psnr = 0;
  double rays = 0, samples = 0, colours = 0, learning = 0, rows = 0, samples_per_second = 0;
};
struct MetricsEvaluation {
  double step = 0, seconds = 0, psnr = 0, ssim = 0, views = 0;
};

// A held-out view as the last evaluation scored it.
struct RecordedView {
  std::string name;
  int scale = 1;
  std::optional<double> psnr, ssim, aligned_psnr, aligned_ssim;
  std::string held_out;  // "space", "time" or empty
  std::string picture;   // file in eval/; empty where there is none
  DepthRange depth;
};

struct RunRecord {
  std::filesystem::path folder;
  nlohmann::ordered_json options, result;  // objects; empty where they are missing
  RunNotes notes;
  std::vector<MetricsStep> steps;
  std::vector<MetricsEvaluation> evaluations;
  std::vector<RecordedView> views;
  std::optional<ModelInfo> model;
  std::vector<std::string> missing;  // sentences
};

// Throws Error where the folder is missing or holds nothing of a run. Files that are missing or
// damaged are named in RunRecord::missing.
RunRecord read_run(const std::filesystem::path& folder);

}  // namespace nerf::apps
