// ModelInfo as the JSON that stands in the model file.
#pragma once

#include <nlohmann/json.hpp>

#include "model/json_fields.h"
#include "nerf/model/model_info.h"

namespace nerf::internal {

// Numbers read back to the same bits. Names that are not UTF-8 get U+FFFD in the place of what is
// not.
nlohmann::ordered_json model_info_to_json(const ModelInfo& info);

// Throws Error for what is missing, of another type, or no camera, rotation or size at all.
ModelInfo model_info_from_json(const JsonFields& header);

// A rotation as 9 numbers, row by row.
nlohmann::ordered_json rotation_to_json(const Mat3d& r);
Mat3d rotation_from(const JsonFields& f, const char* key);

}  // namespace nerf::internal
