// What a training says of the medium that it learnt: lines, its result's JSON, a part of its
// report.
#pragma once

#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "nerf/model/medium.h"

namespace nerf::apps {

// For the screen; none of no medium.
std::vector<std::string> medium_lines(const std::optional<Medium>& medium);

// Of result.json: coefficients by channel, 1 / input unit, the colour, and "option", the medium as
// nerf_render's --medium takes it.
nlohmann::ordered_json medium_json(const Medium& medium);

}  // namespace nerf::apps
