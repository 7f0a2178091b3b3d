// The subcommands of nerf_bench; argv[0] is the subcommand.
#pragma once

#include <filesystem>
#include <optional>
#include <vector>

#include "nerf/io/scene.h"
#include "nerf/model/radiance_field.h"
#include "nerf/model/renderer.h"

namespace nerf::apps {

int bench_scene(int argc, char** argv);
int bench_render(int argc, char** argv);
int bench_kernels(int argc, char** argv);
int bench_error(int argc, char** argv);
int bench_ablation(int argc, char** argv);
int bench_tables(int argc, char** argv);
int bench_report(int argc, char** argv);

// The held-out views of the capture that a run was trained on; `most_views` of them, spread evenly,
// or all where that is 0, their photos divided by `downscale`, without it as in training. Other
// views are not in it.
Scene held_out_scene(const std::filesystem::path& run, int most_views,
                     std::optional<int> downscale = {});

// What pictures are compared with: everything that leaves work out is off, and products are taken
// in f32.
RenderOptions every_skip_off();

// Finds out where a paper method's model is empty, as if many pictures were to come. Returns how
// many seconds that took; nothing of other models and where no picture could skip more for it.
std::optional<double> bake(RadianceField& field, ThreadPool& pool);

// Renders the held-out views of a run (`views` of them, spread evenly; 0: all) as usual and with
// every_skip_off() and prints how long it took and how much they differ, from each other and in
// PSNR against their photos; usual_only: without the latter. Masked-out pixels count nowhere.
void compare_rendering(const std::filesystem::path& run, int views, int threads,
                       std::optional<int> downscale = {}, bool usual_only = false);

double median(std::vector<double> values);  // not empty

}  // namespace nerf::apps
