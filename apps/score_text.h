// An evaluation as lines for a person.
#pragma once

#include <string>
#include <vector>

#include "nerf/train/evaluation.h"

namespace nerf::apps {

// "time" or "space".
const char* held_out_name(HeldOut kind);

// The means of all held-out views, and of those that are held out alike or of one size; empty where
// nothing was measured. Scores from aligned cameras are not among them.
std::vector<std::string> score_lines(const Evaluation& e);

}  // namespace nerf::apps
