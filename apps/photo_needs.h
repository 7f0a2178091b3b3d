// What a capture says that it needs, in place of what is to be found automatically.
#pragma once

#include "nerf/base/cancel.h"
#include "nerf/base/threads.h"
#include "nerf/io/photos.h"
#include "nerf/io/scene.h"
#include "train_options.h"

namespace nerf::apps {

// Whether light differs between photos, found by a short training where the run is long enough.
void look_at_light(TrainCommand& command, bool resumes, const Scene& scene, const PhotoSet& photos,
                   ThreadPool& pool, const Cancel& cancel);
// How what moves is led to one scene, where the photos are of several moments.
void look_at_motion(TrainCommand& command, const Scene& scene);

}  // namespace nerf::apps
