// Trainings as separate runs of nerf_train, with no other option than a table names.
#pragma once

#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "train_options.h"

namespace nerf::apps {

struct ChildTraining {
  nlohmann::json result;                    // result.json
  std::vector<nlohmann::json> evaluations;  // lines of metrics.jsonl
  nlohmann::json last_step;                 // the last such line of a step
  std::string command;                      // the same training by hand
};

// What such trainings share: the scene and how it is split, seed, threads, and neither evaluation
// nor checkpoint before the end.
std::vector<std::string> training_arguments(const std::filesystem::path& scene, SplitChoice split,
                                            int downscale, uint64_t seed, int threads);

// What nerf_train makes of the arguments, presets applied. Throws Error where it would refuse them,
// before anything is trained.
TrainCommand training_command(const std::vector<std::string>& arguments);

// Runs the nerf_train that stands beside this program (or the one in PATH) with the arguments and
// `-o folder --overwrite`. Throws Error where it fails.
ChildTraining train_in_child(std::vector<std::string> arguments,
                             const std::filesystem::path& folder);

}  // namespace nerf::apps
