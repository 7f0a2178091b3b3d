// A capture as nerf_train reads it: with lines for a person, a request to stop, and a look at
// memory before anything large is made.
#pragma once

#include <string>

#include "app.h"
#include "nerf/base/threads.h"
#include "nerf/io/depth_points.h"
#include "nerf/io/photos.h"
#include "nerf/io/scene.h"
#include "train_options.h"

namespace nerf::apps {

// Each line of the text as one of the log's.
void log_lines(const std::string& text);

// Throws Cancelled.
void throw_if_stopped(const SignalCancel& stop);

// load_scene() and its report. Throws Error where the training needs more memory than there is;
// Cancelled.
Scene read_scene(const TrainCommand& command, const ThreadPool& pool, const SignalCancel& stop);

// load_photos() with progress. Throws Error, Cancelled.
PhotoSet decode(const Scene& scene, ThreadPool& pool, const SignalCancel& stop);

// What was made of the capture's depth maps; nothing where it has none.
void say_depth(const DepthPoints& depth, const Scene& scene);

}  // namespace nerf::apps
