// What a training says of the light in its photos: lines, its result's JSON, a part of its report.
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "nerf/train/light_report.h"

namespace nerf::apps {

// For the screen; none where nothing was found.
std::vector<std::string> light_lines(const LightReport& report);

// Of result.json: null where nothing was found.
nlohmann::ordered_json light_json(const LightReport& report);

// "3.1 stops shown for each of EXIF's" and the like; empty where EXIF cannot be compared.
std::string exif_text(std::optional<double> factor, double explained);

}  // namespace nerf::apps
