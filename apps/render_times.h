// When the frames of a plan are shown: --time, --freeze-time, --freeze-camera.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "nerf/io/camera_path.h"
#include "render_options.h"

namespace nerf::apps {

// The camera of --freeze-camera: that of the photo of this name (whole, without its folder or
// without its ending); no value where the model has none.
std::optional<PathFrame> photo_frame(const std::string& name, const ModelInfo& info);

// Or that of the frame of a path with this number. Throws Error where it is none.
PathFrame numbered_frame(const std::string& number, const CameraPath& path);

// Frames of one camera over all of the capture's times: `count`, or as many as the capture has
// moments.
std::vector<PathFrame> film_of(PathFrame frame, std::optional<int> count, const ModelInfo& info);

// Sets the frames' times as --time and --freeze-time say. `moves`: whether pictures of the model
// depend on time; where not a note says that nothing changes. Throws Error for times that the
// capture does not have.
void set_times(const RenderCommand& command, const ModelInfo& info, bool moves, CameraPath& path);

// Frames per second at which time passes in the film as it did before the camera: of captures that
// know seconds and frames whose times run on. No value elsewhere.
std::optional<double> capture_speed(const ModelInfo& info, const CameraPath& path);

}  // namespace nerf::apps
